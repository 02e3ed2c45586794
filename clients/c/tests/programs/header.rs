//! `equipoise.h` says what the library is: a C program prints what the compiler makes of it.

use equipoise_c::{EarlyReading, Options, Outcome, Reading, layout};
use equipoise_core::body::{JOINTS, Joint, SEGMENTS};
use equipoise_core::cycle::{BodyRejection, BodySource};
use equipoise_core::message::layout::{Field, Primitive};
use equipoise_core::message::state::{
    AccelerationSource, FootOutlineSource, Phase, SharingSource, Unavailable,
};
use equipoise_core::message::{EarlyState, GroundDevice, Message, State, Validity};
use equipoise_core::overload::Level;
use std::fmt::Write as _;
use std::mem::offset_of;
use std::process::Command;

use crate::compiler::{Link, compile, stdout_of};
use crate::flag_sets;
use crate::names::constant_case;

/// A C expression, and what it must be.
struct Fact {
    expression: String,
    value: u64,
}

fn fact(expression: String, value: impl TryInto<u64>) -> Fact {
    Fact { expression, value: value.try_into().ok().unwrap() }
}

fn facts_of_field(of: &str, name: &str, offset: usize, bytes: usize) -> [Fact; 2] {
    [fact(format!("offsetof({of}, {name})"), offset), fact(format!("sizeof((({of} *)0)->{name})"), bytes)]
}

fn facts_of_state() -> Vec<Fact> {
    let mut facts = vec![
        fact("sizeof(equipoise_state)".to_owned(), size_of::<State>()),
        fact("EQUIPOISE_LAYOUT".to_owned(), layout::layout()),
        fact(format!("strcmp(EQUIPOISE_STATE_TYPE, \"{}\")", State::TYPE_NAME), 0_u64),
        fact("EQUIPOISE_JOINTS".to_owned(), JOINTS),
        fact("EQUIPOISE_SEGMENTS".to_owned(), SEGMENTS),
    ];
    for field in State::FIELDS {
        let (name, number) = (field.name, field.primitive);
        facts.extend(facts_of_field("equipoise_state", name, field.offset, field.count * number.size()));
    }
    facts.push(fact("sizeof(equipoise_early_state)".to_owned(), size_of::<EarlyState>()));
    for field in EarlyState::FIELDS {
        let bytes = field.count * field.primitive.size();
        facts.extend(facts_of_field("equipoise_early_state", field.name, field.offset, bytes));
    }
    facts
}

fn facts_of_structs() -> Vec<Fact> {
    let mut facts = vec![
        fact("sizeof(equipoise_reading)".to_owned(), size_of::<Reading>()),
        fact("sizeof(equipoise_early_reading)".to_owned(), size_of::<EarlyReading>()),
        fact("sizeof(equipoise_options)".to_owned(), size_of::<Options>()),
    ];
    macro_rules! fields {
        ($($of:literal $Type:ident { $($field:ident: $bytes:literal),* })*) => {
            $($(facts.extend(facts_of_field($of, stringify!($field), offset_of!($Type, $field), $bytes));)*)*
        };
    }
    fields! {
        "equipoise_reading" Reading {
            state: 2752, received_ns: 8, age_ns: 8, sample_age_ns: 8, missed: 8, restarted: 4, is_new: 4
        }
        "equipoise_early_reading" EarlyReading {
            early: 960, received_ns: 8, age_ns: 8, sample_age_ns: 8, is_new: 4, reserved: 4
        }
        "equipoise_options" Options { layout: 8, stale_after_ns: 8, depth: 4, no_report: 4 }
    }
    facts
}

fn facts_of_numbers() -> Vec<Fact> {
    let mut facts = Vec::new();
    for (reason, name) in Validity::NAMES {
        facts.push(fact(format!("EQUIPOISE_REASON_{}", constant_case(name)), reason.0));
    }
    for (set, name) in flag_sets::all() {
        facts.push(fact(format!("EQUIPOISE_INVALIDATES_{}", constant_case(name)), set.0));
    }
    for joint in Joint::ALL {
        facts.push(fact(format!("EQUIPOISE_JOINT_{}", constant_case(joint.name())), joint.index()));
    }
    for (outcome, name) in Outcome::ALL {
        facts.push(fact(name.to_owned(), outcome as i32));
    }
    let numbered = |prefix: &str, name_of: &dyn Fn(u32) -> Option<&'static str>| -> Vec<Fact> {
        let named = (0..).map_while(|number| name_of(number).map(|name| (number, constant_case(name))));
        named.map(|(number, name)| fact(format!("EQUIPOISE_{prefix}_{name}"), number)).collect()
    };
    facts.extend(numbered("PHASE", &|number| Phase::from_number(number).map(Phase::name)));
    facts.extend(numbered("LEVEL", &|number| Level::from_number(number).map(Level::name)));
    facts.extend(numbered("BODY_SOURCE", &|number| BodySource::from_number(number).map(BodySource::name)));
    facts.extend(numbered("BODY_REJECTED", &|number| {
        BodyRejection::from_number(number).map(BodyRejection::name)
    }));
    facts.extend(numbered("FOOT_OUTLINE", &|number| {
        FootOutlineSource::from_number(number).map(FootOutlineSource::name)
    }));
    facts.extend(numbered("ACCELERATION", &|number| {
        AccelerationSource::from_number(number).map(AccelerationSource::name)
    }));
    for (what, name) in Unavailable::NAMES {
        facts.push(fact(format!("EQUIPOISE_UNAVAILABLE_{}", constant_case(name)), what as u32));
    }
    for (device, name) in GroundDevice::NAMES {
        facts.push(fact(format!("EQUIPOISE_GROUND_{}", constant_case(name)), device as u32));
    }
    facts.extend(numbered("SHARING", &|number| SharingSource::from_number(number).map(SharingSource::name)));
    facts
}

#[test]
fn the_header_says_what_the_library_is() {
    let facts: Vec<Fact> =
        [facts_of_state(), facts_of_structs(), facts_of_numbers()].into_iter().flatten().collect();
    let mut program = String::from(
        "#include \"equipoise.h\"\n#include <inttypes.h>\n#include <stddef.h>\n#include <stdio.h>\n\
         #include <string.h>\n\
         int main(void) {\n",
    );
    for Fact { expression, .. } in &facts {
        writeln!(program, "printf(\"%\" PRIu64 \"\\n\", (uint64_t)({expression}));").unwrap();
    }
    program.push_str("return 0;\n}\n");
    let scratch = tempfile::tempdir().unwrap();
    let source = scratch.path().join("facts.c");
    std::fs::write(&source, program).unwrap();
    let compiled = compile(&source, Link::Static, scratch.path());
    let printed = stdout_of(&Command::new(compiled).output().unwrap());
    let wrong: Vec<String> = printed
        .lines()
        .zip(&facts)
        .filter(|(line, fact)| **line != fact.value.to_string())
        .map(|(line, Fact { expression, value })| {
            format!("{expression} is {line}, in Rust {value} (0x{value:x})")
        })
        .collect();
    assert_eq!(printed.lines().count(), facts.len());
    assert!(wrong.is_empty(), "equipoise.h and the library differ:\n{}", wrong.join("\n"));
}

/// Offsets and sizes do not tell a double from an integer of 8 bytes.
#[test]
fn every_field_is_declared_as_the_number_it_is() {
    declares("equipoise_state", State::FIELDS);
    declares("equipoise_early_state", EarlyState::FIELDS);
}

fn declares(of: &str, fields: &[Field]) {
    let header = include_str!("../../equipoise.h");
    let declared =
        header.split_once(&format!("typedef struct {of} {{")).unwrap().1.split_once("\n}").unwrap().0;
    for Field { name, primitive, count, .. } in fields {
        let kind = match primitive {
            Primitive::U8 => "uint8_t",
            Primitive::U32 => "uint32_t",
            Primitive::U64 => "uint64_t",
            Primitive::F64 => "double",
        };
        let field = format!("    {kind} {name}{}", if *count == 1 { ';' } else { '[' });
        let lines = declared.lines().filter(|line| line.starts_with(&field)).count();
        assert_eq!(lines, 1, "{of}: {field}");
    }
}
