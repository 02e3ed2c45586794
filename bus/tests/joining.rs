//! Which processes may join, and the errors of those that are refused.
#![expect(clippy::unwrap_used, reason = "a test may panic, and so may its helpers")]

mod common;

use std::os::unix::fs::PermissionsExt;

use bytemuck::{Pod, Zeroable};
use common::{join, root, root_of_length};
use equipoise_bus::root::ROOT_BYTES_MAX;
use equipoise_bus::words::Each;
use equipoise_bus::{Bus, BusError, BusSettings, Channel, Participant, Service, Topic};
use equipoise_core::message::layout::{Field, Primitive};
use equipoise_core::message::{AdapterHealth, Message};
use iceoryx2_bb_elementary_traits::zero_copy_send::ZeroCopySend;

/// The health message of another release: same name, same size, other fields.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable, iceoryx2_bb_derive_macros::ZeroCopySend)]
#[type_name("equipoise/Health/2")]
struct OtherHealth {
    received: u64,
    time_ns: u64,
    rest: [u64; 30],
}

impl Message for OtherHealth {
    const TYPE_NAME: &'static str = "equipoise/Health/2";
    const FIELDS: &'static [Field] = &[
        Field { name: "received", primitive: Primitive::U64, count: 1, offset: 0 },
        Field { name: "time_ns", primitive: Primitive::U64, count: 1, offset: 8 },
        Field { name: "rest", primitive: Primitive::U64, count: 30, offset: 16 },
    ];
}

impl Topic for OtherHealth {
    const SERVICE: Service = AdapterHealth::SERVICE;
}

#[test]
fn another_layout_of_one_name_and_size_is_refused() {
    assert_eq!(size_of::<OtherHealth>(), size_of::<AdapterHealth>());
    let root = root();
    let bus = join(root.path(), "ours");
    let _ours = bus.publisher::<AdapterHealth>().unwrap();
    let error = join(root.path(), "theirs").subscriber::<OtherHealth>(1).unwrap_err();
    assert_eq!(
        error.to_string(),
        format!(
            "cannot open equipoise/test/health: it was made by another version of Equipoise (schema 0x{:016x}, \
             here 0x{:016x}); run the same release in all processes of this station",
            AdapterHealth::SCHEMA_HASH,
            OtherHealth::SCHEMA_HASH
        )
    );
}

/// The health message of a release in which a number of the same fields has another meaning.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable, iceoryx2_bb_derive_macros::ZeroCopySend)]
#[type_name("equipoise/Health/2")]
struct OtherWords([u64; 32]);

impl Message for OtherWords {
    const TYPE_NAME: &'static str = AdapterHealth::TYPE_NAME;
    const FIELDS: &'static [Field] = AdapterHealth::FIELDS;
}

impl Topic for OtherWords {
    const SERVICE: Service = AdapterHealth::SERVICE;

    fn words(each: Each<'_>) {
        each("state", "well", 1);
    }
}

#[test]
fn other_words_of_one_layout_are_refused() {
    assert_eq!(OtherWords::SCHEMA_HASH, AdapterHealth::SCHEMA_HASH);
    let root = root();
    let bus = join(root.path(), "ours");
    let _ours = bus.publisher::<AdapterHealth>().unwrap();
    let error = join(root.path(), "theirs").subscriber::<OtherWords>(1).unwrap_err();
    assert!(matches!(error, BusError::OtherSchema { .. }), "{error}");
}

#[test]
fn a_retained_service_outlives_its_users_and_uses_none_of_their_ports() {
    let root = root();
    let holder = join(root.path(), "holder");
    let retained = holder.retain::<AdapterHealth>().unwrap();
    let bus = join(root.path(), "ours");
    for _ in 0..2 {
        let places = AdapterHealth::SERVICE.subscribers_max;
        let readers: Vec<_> = (0..places).map(|_| bus.subscriber::<AdapterHealth>(1).unwrap()).collect();
        assert!(matches!(bus.subscriber::<AdapterHealth>(1), Err(BusError::Full { .. })));
        drop(readers);
    }
    drop(bus);
    // The service exists without users, so it cannot be created with another schema under its name.
    let others = join(root.path(), "theirs");
    assert!(matches!(others.subscriber::<OtherHealth>(1), Err(BusError::OtherSchema { .. })));
    drop(retained);
    others.subscriber::<OtherHealth>(1).unwrap();
}

#[test]
fn names_that_would_break_a_path_are_refused() {
    for station in ["", "a/b", "a b", "ä", "../x", "123456789012345678901234567890123"] {
        let error = Bus::join(&BusSettings::new(station, "role")).unwrap_err();
        assert!(matches!(error, BusError::Name { what: "station", .. }), "{error}");
    }
    let error = Bus::join(&BusSettings::new("station-1", "a/b")).unwrap_err();
    assert!(matches!(error, BusError::Name { what: "role", .. }), "{error}");
}

#[test]
fn the_living_of_a_station_are_known_by_role_and_process() {
    let root = root();
    let one = join(root.path(), "one");
    let _two = join(root.path(), "two");
    let elsewhere = BusSettings { root: root.path().to_owned(), ..BusSettings::new("other", "three") };
    let _other_station = Bus::join(&elsewhere).unwrap();
    let mut there = one.participants().unwrap();
    there.sort_by(|a, b| a.role.cmp(&b.role));
    let process_id = std::process::id();
    let expected = ["one", "two"].map(|role| Participant { role: role.to_owned(), process_id });
    assert_eq!(there, expected);
}

#[test]
fn two_roots_are_two_buses() {
    let (here, there) = (root(), root());
    let publisher = join(here.path(), "writer").publisher::<AdapterHealth>().unwrap();
    let _subscriber = join(there.path(), "reader").subscriber::<AdapterHealth>(1).unwrap();
    assert_eq!(publisher.send(&AdapterHealth::zeroed()).unwrap(), 0);
}

#[test]
fn the_longest_root_works_and_a_longer_one_is_refused() {
    let longest = root_of_length(ROOT_BYTES_MAX);
    join(longest.path(), "role").listener(Channel::Inputs).unwrap();
    let root = root_of_length(ROOT_BYTES_MAX + 1).path().to_owned();
    let error = Bus::join(&BusSettings { root, ..BusSettings::new("test", "role") }).unwrap_err();
    assert!(matches!(error, BusError::Root { .. }), "{error}");
}

#[test]
fn nothing_of_the_bus_is_open_to_other_users() {
    let root = root();
    let bus = join(root.path(), "alone");
    let _writer = bus.publisher::<AdapterHealth>().unwrap();
    let prefix = equipoise_bus::root::shared_memory_prefix(root.path());
    let ours = |entry: &std::fs::DirEntry| entry.file_name().to_string_lossy().starts_with(&prefix);
    let shared: Vec<_> = std::fs::read_dir("/dev/shm").unwrap().map(Result::unwrap).filter(ours).collect();
    assert!(shared.iter().any(|entry| entry.file_name().to_string_lossy().ends_with(".global_mgmt")));
    for entry in shared {
        let mode = entry.metadata().unwrap().permissions().mode();
        assert_eq!(mode & 0o077, 0, "{} has mode {mode:o}", entry.path().display());
    }
}
