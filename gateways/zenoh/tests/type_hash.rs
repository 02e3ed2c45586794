//! Computes the type's hash from the definitions as REP 2016 and rosidl_generator_type_description specify: SHA-256 of
//! the description as JSON with Python's default separators, referenced types sorted by name. With a wrong hash no
//! subscriber matches the topic.
#![expect(clippy::unwrap_used, reason = "a test may panic")]

mod msg;

use std::collections::BTreeSet;

use equipoise_files::Sha256;
use equipoise_gateway_zenoh::ros::TYPE_HASH;
use msg::{Definitions, Many, PRIMITIVES};

fn hash(all: &Definitions, name: &str) -> String {
    let mut referenced = BTreeSet::new();
    reference(all, name, &mut referenced);
    let referenced: Vec<String> = referenced.iter().map(|name| description(all, name)).collect();
    let text = format!(
        "{{\"type_description\": {}, \"referenced_type_descriptions\": [{}]}}",
        description(all, name),
        referenced.join(", ")
    );
    format!("RIHS01_{}", Sha256::of(text.as_bytes()))
}

fn reference(all: &Definitions, name: &str, found: &mut BTreeSet<String>) {
    for field in all[name].iter().filter(|field| all.contains_key(&field.of)) {
        if found.insert(field.of.clone()) {
            reference(all, &field.of, found);
        }
    }
}

fn description(all: &Definitions, name: &str) -> String {
    let fields: Vec<String> = all[name]
        .iter()
        .map(|field| {
            let (base, nested) = match PRIMITIVES.iter().find(|(primitive, _)| *primitive == field.of) {
                Some((_, number)) => (*number, ""),
                None => (1, field.of.as_str()),
            };
            let (more, capacity) = match field.many {
                Many::One => (0, 0),
                Many::Array(count) => (48, count),
                Many::Bounded(most) => (96, most),
                Many::Unbounded => (144, 0),
            };
            format!(
                "{{\"name\": \"{}\", \"type\": {{\"type_id\": {}, \"capacity\": {capacity}, \"string_capacity\": 0, \
                 \"nested_type_name\": \"{nested}\"}}}}",
                field.name,
                base + more
            )
        })
        .collect();
    format!("{{\"type_name\": \"{name}\", \"fields\": [{}]}}", fields.join(", "))
}

// Hashes from the packages of ROS 2 Jazzy.
#[test]
fn the_hashes_of_ros_2_come_out() {
    let all = msg::of_others();
    for (name, known) in [
        ("std_msgs/msg/String", "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"),
        ("std_msgs/msg/Header", "f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01"),
        ("builtin_interfaces/msg/Time", "b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197"),
    ] {
        assert_eq!(hash(&all, name), format!("RIHS01_{known}"), "{name}");
    }
}

#[test]
fn the_gateways_hash_is_that_of_the_definitions() {
    assert_eq!(hash(&msg::definitions(), "equipoise_msgs/msg/State"), TYPE_HASH);
}
