//! `clients/python/equipoise/_messages.py` is generated from the tables of core and bus:
//! `EQUIPOISE_WRITE=1 cargo test -p equipoise-client --test python_module` writes it; without the variable the test
//! compares it.
#![expect(clippy::unwrap_used, reason = "a test may panic")]

#[path = "common/flag_sets.rs"]
mod flag_sets;
#[path = "common/names.rs"]
mod names;

use equipoise_bus::command::REQUEST_SETTINGS;
use equipoise_bus::event::{EVENT_NUMBER_MAX, EVENTS_SCHEMA};
use equipoise_bus::root::{DEFAULT_ROOT, ROOT_BYTES_MAX, ROOT_VARIABLE};
use equipoise_bus::service::{BORROWED_MAX, LISTENERS_MAX, NODES_MAX, NOTIFIERS_MAX, SCHEMA_KEY};
use equipoise_bus::{Channel, Event, Request, Topic};
use equipoise_core::body::{JOINTS, Joint, SEGMENTS};
use equipoise_core::cycle::{BodyRejection, BodySource};
use equipoise_core::handover::{MASS_KG, PLACE_MAX_M, WIDTH_M};
use equipoise_core::message::consumer_receipt::{BUCKETS, SUB_BUCKETS};
use equipoise_core::message::handover::{CurrentFrame, CurrentStatus, HandoverRefusal};
use equipoise_core::message::layout::{Field, Primitive};
use equipoise_core::message::state::{
    AccelerationSource, FootOutlineSource, Phase, SharingSource, Unavailable,
};
use equipoise_core::message::{
    ConsumerReceipt, EarlyState, GroundDevice, HandoverPlan, HandoverRequest, Message, State, Validity,
};
use equipoise_core::overload::Level;
use names::constant_case;
use std::fmt::{Debug, Write as _};

const HEAD: &str = r#""""Layout of shared memory. Generated from the tables of core and bus: do not edit.

    EQUIPOISE_WRITE=1 cargo test -p equipoise-client --test python_module
"""

from __future__ import annotations

import ctypes
import enum
from typing import NamedTuple, Optional

from ._flags import Flags


class Service(NamedTuple):
    """A service: every process must open it with the same settings."""

    suffix: str
    schema: str
    publishers_max: int
    subscribers_max: int
    depth: int
    depth_max: int
    history: int
    deadline_ns: Optional[int]


class RequestService(NamedTuple):
    """A request-response service: every process must open it with the same settings."""

    suffix: str
    schema: str
    overflow_requests: bool
    overflow_responses: bool
    fire_and_forget: bool
    active_requests_max: int
    loaned_requests_max: int
    responses_max: int
    borrowed_responses_max: int
    servers_max: int
    clients_max: int


"#;

/// Names of a number type in ctypes and in Python.
fn words(primitive: Primitive) -> (&'static str, &'static str) {
    match primitive {
        Primitive::U8 => ("ctypes.c_uint8", "int"),
        Primitive::U32 => ("ctypes.c_uint32", "int"),
        Primitive::U64 => ("ctypes.c_uint64", "int"),
        Primitive::F64 => ("ctypes.c_double", "float"),
    }
}

fn structure<M: Message>(out: &mut String, name: &str, doc: &str) {
    let type_name = M::TYPE_NAME;
    writeln!(out, "class {name}(ctypes.Structure):\n    \"\"\"{doc}\"\"\"\n").unwrap();
    for Field { name, primitive, count, .. } in M::FIELDS {
        let (number, word) = words(*primitive);
        match count {
            1 => writeln!(out, "    {name}: {word}").unwrap(),
            _ => writeln!(out, "    {name}: ctypes.Array[{number}]").unwrap(),
        }
    }
    writeln!(out, "\n    _fields_ = [").unwrap();
    for Field { name, primitive, count, .. } in M::FIELDS {
        let number = words(*primitive).0;
        match count {
            1 => writeln!(out, "        (\"{name}\", {number}),").unwrap(),
            _ => writeln!(out, "        (\"{name}\", {number} * {count}),").unwrap(),
        }
    }
    writeln!(out, "    ]\n\n    @staticmethod\n    def type_name() -> str:").unwrap();
    writeln!(out, "        \"\"\"The name that iceoryx2 compares.\"\"\"\n        return \"{type_name}\"\n\n")
        .unwrap();
    writeln!(out, "assert ctypes.sizeof({name}) == {}\n\n", size_of::<M>()).unwrap();
}

fn service<M: Topic>(out: &mut String, name: &str) {
    let row = M::SERVICE;
    let deadline = row.deadline.map_or("None".to_owned(), |deadline| deadline.as_nanos().to_string());
    writeln!(
        out,
        "{name} = Service(\n    suffix=\"{}\",\n    schema=\"0x{:016x}\",\n    publishers_max={},\n    \
         subscribers_max={},\n    depth={},\n    depth_max={},\n    history={},\n    deadline_ns={deadline},\n)",
        row.suffix,
        M::schema(),
        row.publishers_max(),
        row.subscribers_max,
        row.depth,
        row.depth_max,
        row.history,
    )
    .unwrap();
}

fn request_service<Q: Request>(out: &mut String, name: &str) {
    let row = REQUEST_SETTINGS;
    let flag = |is_set: bool| if is_set { "True" } else { "False" };
    writeln!(
        out,
        "{name} = RequestService(\n    suffix=\"{}\",\n    schema=\"{}\",\n    overflow_requests={},\n    \
         overflow_responses={},\n    fire_and_forget={},\n    active_requests_max={},\n    loaned_requests_max={},\n    \
         responses_max={},\n    borrowed_responses_max={},\n    servers_max={},\n    clients_max={},\n)",
        Q::SUFFIX,
        Q::schema(),
        flag(row.overflow_requests),
        flag(row.overflow_responses),
        flag(row.fire_and_forget),
        row.active_requests_max,
        row.loaned_requests_max,
        row.responses_max,
        row.borrowed_responses_max,
        row.servers_max,
        row.clients_max,
    )
    .unwrap();
}

fn enumeration(out: &mut String, name: &str, doc: &str, members: impl IntoIterator<Item = (String, u64)>) {
    writeln!(out, "class {name}:\n    \"\"\"{doc}\"\"\"\n").unwrap();
    for (member, value) in members {
        writeln!(out, "    {member} = {value}").unwrap();
    }
    out.push_str("\n\n");
}

fn numbered(name_of: impl Fn(u32) -> Option<&'static str>) -> Vec<(String, u64)> {
    let named = (0..).map_while(|number| name_of(number).map(|name| (number, constant_case(name))));
    named.map(|(number, name)| (name, u64::from(number))).collect()
}

/// Members with the names of the Rust variants.
fn variants<E: Debug>(from_number: fn(u32) -> Option<E>) -> Vec<(String, u64)> {
    let members = (0..).map_while(|number| from_number(number).map(|member| (number, member)));
    members.map(|(number, member)| (constant_case(&format!("{member:?}")), u64::from(number))).collect()
}

fn enumerations(out: &mut String) {
    reasons(out);
    measurements(out);
    body_sources(out);
    handover(out);
    let joints = Joint::ALL.into_iter().map(|joint| (constant_case(joint.name()), joint.index() as u64));
    enumeration(out, "Joint(enum.IntEnum)", "Indices of a state's arrays per joint.", joints);
}

/// Invalid reasons, and which of them invalidate a value.
fn reasons(out: &mut String) {
    let reasons = Validity::NAMES.iter().map(|(reason, name)| (constant_case(name), reason.0));
    enumeration(out, "Reason(Flags)", "Invalid reasons: bits of `State.valid`.", reasons);
    for (set, name) in flag_sets::all() {
        writeln!(out, "INVALIDATES_{} = Reason({})", constant_case(name), set.0).unwrap();
    }
    out.push_str("\n\n");
}

fn measurements(out: &mut String) {
    let phases = numbered(|number| Phase::from_number(number).map(Phase::name));
    enumeration(out, "Phase(enum.IntEnum)", "Phase of the pipeline: `State.phase`.", phases);
    let levels = numbered(|number| Level::from_number(number).map(Level::name));
    enumeration(out, "Level(enum.IntEnum)", "Overload level of a joint: `State.joint_level`.", levels);
    let sources = numbered(|number| SharingSource::from_number(number).map(SharingSource::name));
    enumeration(
        out,
        "Sharing(enum.IntEnum)",
        "Source of `State.foot_load_fraction`: `State.sharing_source`.",
        sources,
    );
    let given = Unavailable::NAMES.map(|(what, name)| (constant_case(name), u64::from(what as u32)));
    enumeration(
        out,
        "Unavailable(Flags)",
        "Quantities that the station's sensors do not provide: bits of `State.unavailable`.",
        given,
    );
    let devices = GroundDevice::NAMES.map(|(device, name)| (constant_case(name), u64::from(device as u32)));
    enumeration(
        out,
        "GroundDevice(Flags)",
        "Devices in the ground sample: bits of `State.ground_devices`.",
        devices,
    );
}

fn body_sources(out: &mut String) {
    for (name, doc, members) in [
        (
            "BodySource(enum.IntEnum)",
            "Source of the segment lengths: `State.body_source`.",
            numbered(|number| BodySource::from_number(number).map(BodySource::name)),
        ),
        (
            "BodyRejected(enum.IntEnum)",
            "Reason why the suit's null pose is not used: `State.body_rejected`.",
            numbered(|number| BodyRejection::from_number(number).map(BodyRejection::name)),
        ),
        (
            "FootOutline(enum.IntEnum)",
            "Source of the foot outlines: `State.foot_outline_source`.",
            numbered(|number| FootOutlineSource::from_number(number).map(FootOutlineSource::name)),
        ),
        (
            "Acceleration(enum.IntEnum)",
            "Source of the body's accelerations: `State.acceleration_source`.",
            numbered(|number| AccelerationSource::from_number(number).map(AccelerationSource::name)),
        ),
    ] {
        enumeration(out, name, doc, members);
    }
}

fn handover(out: &mut String) {
    for (name, doc, members) in [
        (
            "CurrentFrame(enum.IntEnum)",
            "Frame of the current place of a part: the station's world, or relative to the feet as a plan's `place_m`.",
            variants(CurrentFrame::from_number),
        ),
        (
            "CurrentStatus(enum.IntEnum)",
            "Prediction at the current place of a part.",
            variants(CurrentStatus::from_number),
        ),
        (
            "HandoverRefusal(enum.IntEnum)",
            "Reason why there is no plan of a handover; see core/src/message/handover.rs.",
            variants(HandoverRefusal::from_number),
        ),
    ] {
        enumeration(out, name, doc, members);
    }
}

fn module() -> String {
    let mut out = HEAD.to_owned();
    for (name, value) in [
        ("JOINTS", JOINTS),
        ("SEGMENTS", SEGMENTS),
        ("SUB_BUCKETS", SUB_BUCKETS as usize),
        ("BUCKETS", BUCKETS),
        ("NODES_MAX", NODES_MAX),
        ("BORROWED_MAX", BORROWED_MAX),
        ("LISTENERS_MAX", LISTENERS_MAX),
        ("NOTIFIERS_MAX", NOTIFIERS_MAX),
        ("EVENT_NUMBER_MAX", EVENT_NUMBER_MAX),
        ("NOTIFIER_DIED", Event::NotifierDied as usize),
        ("ROOT_BYTES_MAX", ROOT_BYTES_MAX),
    ] {
        writeln!(out, "{name} = {value}").unwrap();
    }
    for (name, range) in [("HANDOVER_MASS_KG", MASS_KG), ("HANDOVER_WIDTH_M", WIDTH_M)] {
        writeln!(out, "{name} = ({:?}, {:?})", range.start(), range.end()).unwrap();
    }
    writeln!(out, "HANDOVER_PLACE_MAX_M = {PLACE_MAX_M:?}").unwrap();
    for (name, value) in [
        ("ROOT_VARIABLE", ROOT_VARIABLE),
        ("DEFAULT_ROOT", DEFAULT_ROOT),
        ("SCHEMA_KEY", SCHEMA_KEY),
        ("EVENTS", Channel::Results.suffix()),
        ("EVENTS_SCHEMA", EVENTS_SCHEMA),
    ] {
        writeln!(out, "{name} = \"{value}\"").unwrap();
    }
    service::<State>(&mut out, "STATE");
    service::<EarlyState>(&mut out, "EARLY_STATE");
    service::<ConsumerReceipt>(&mut out, "CONSUMER_RECEIPT");
    request_service::<HandoverRequest>(&mut out, "HANDOVER");
    out.push_str("\n\n");
    structure::<State>(&mut out, "State", "Result of one cycle; see core/src/message/state.rs.");
    structure::<EarlyState>(
        &mut out,
        "EarlyState",
        "Result about the newest suit sample; see core/src/message/early_state.rs.",
    );
    structure::<ConsumerReceipt>(
        &mut out,
        "ConsumerReceipt",
        "Latency of the states received by one consumer; see core/src/message/consumer_receipt.rs.",
    );
    structure::<HandoverRequest>(
        &mut out,
        "HandoverRequest",
        "Request for the place at which a part relieves the worker; see core/src/message/handover.rs.",
    );
    structure::<HandoverPlan>(
        &mut out,
        "HandoverPlan",
        "The plan of a `HandoverRequest`; see core/src/message/handover.rs.",
    );
    enumerations(&mut out);
    out.trim_end().to_owned() + "\n"
}

#[test]
fn the_python_module_is_what_the_tables_say() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../python/equipoise/_messages.py");
    let (written, module) = (std::fs::read_to_string(path).unwrap_or_default(), module());
    if std::env::var_os("EQUIPOISE_WRITE").is_some() {
        std::fs::write(path, module).unwrap();
        return;
    }
    let differs = written.lines().zip(module.lines()).position(|(is, should)| is != should);
    assert!(
        written == module,
        "clients/python/equipoise/_messages.py differs from the tables from line {} on: rewrite it, see the head \
         of this test",
        differs.map_or(written.lines().count().min(module.lines().count()), |line| line) + 1
    );
}
