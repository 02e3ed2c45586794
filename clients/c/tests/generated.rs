//! `clients/c/equipoise.h` is generated from `equipoise.h.in` and the declarations in Rust, including their comments:
//! `EQUIPOISE_WRITE=1 cargo test -p equipoise-c --test generated` writes it; without the variable the test compares it.
//! `programs/header.rs` tests that a C compiler computes the same layout as the library.
//!
//! cbindgen is not used: messages are declared through a macro of `core`, which cbindgen can expand with a nightly
//! compiler only, and it does not compute sets of validity flags, names of joints and the layout hash.
#![expect(clippy::unwrap_used, reason = "a test may panic")]

#[path = "../../rust/tests/common/flag_sets.rs"]
mod flag_sets;
#[path = "../../rust/tests/common/names.rs"]
mod names;

use equipoise_c::{Outcome, layout};
use equipoise_core::body::{JOINTS, Joint, SEGMENTS};
use equipoise_core::cycle::{BodyRejection, BodySource};
use equipoise_core::message::state::{
    AccelerationSource, FootOutlineSource, Phase, SharingSource, Unavailable,
};
use equipoise_core::message::{EarlyState, GroundDevice, Message, State, Validity};
use equipoise_core::overload::Level;
use names::constant_case;
use std::fmt::Write as _;
use std::path::Path;

const TEMPLATE: &str = include_str!("../equipoise.h.in");
const STATE: &str = include_str!("../../../core/src/message/state.rs");
const EARLY: &str = include_str!("../../../core/src/message/early_state.rs");
const VALIDITY: &str = include_str!("../../../core/src/message/validity.rs");
const GROUND: &str = include_str!("../../../core/src/message/ground.rs");
const OUTCOME: &str = include_str!("../src/outcome.rs");
/// Maximum line length of the header.
const WIDTH: usize = 116;

/// Rust terms in comments, and their replacements for C.
const WORDS: [(&str, &str); 15] = [
    ("a `core::message::state::AccelerationSource`", "an enum equipoise_acceleration"),
    ("`State::cycle`", "equipoise_state.cycle"),
    ("bits of [`Validity`]", "EQUIPOISE_REASON_…"),
    ("a union of [`Unavailable`] bits", "EQUIPOISE_UNAVAILABLE_…"),
    ("a union of `GroundDevice` bits", "EQUIPOISE_GROUND_…"),
    ("A [`Phase`]", "An enum equipoise_phase"),
    ("a [`SharingSource`]", "an enum equipoise_sharing"),
    ("a [`FootOutlineSource`]", "an enum equipoise_foot_outline"),
    ("an [`AccelerationSource`]", "an enum equipoise_acceleration"),
    ("a `core::cycle::BodySource`", "an enum equipoise_body_source"),
    ("a `core::cycle::BodyRejection`", "an enum equipoise_body_rejected"),
    ("a `core::overload::Level`", "an enum equipoise_level"),
    ("`core::pose_suggestion::LIBRARY`", "the library of poses"),
    ("`u32::MAX`", "UINT32_MAX"),
    ("`", ""),
];

/// Doc comments with the declarations that they precede, from a part of a Rust file.
fn documented(text: &str) -> Vec<(String, &str)> {
    let (mut doc, mut found) = (String::new(), Vec::new());
    for line in text.lines().map(str::trim) {
        if let Some(more) = line.strip_prefix("///") {
            doc.push_str(more);
        } else if !line.is_empty() {
            found.push((std::mem::take(&mut doc).trim().to_owned(), line));
        }
    }
    found
}

fn between<'a>(text: &'a str, begin: &str, end: &str) -> &'a str {
    text.split_once(begin).unwrap().1.split_once(end).unwrap().0
}

fn comment(out: &mut String, indent: &str, doc: &str) {
    let mut text = doc.to_owned();
    for (rust, c) in WORDS {
        text = text.replace(rust, c);
    }
    assert!(!text.is_empty() && !text.contains("[`"), "{text:?} is no comment for C");
    let mut line = format!("{indent}/*");
    for word in text.split_whitespace() {
        if line.chars().count() + 1 + word.chars().count() + 3 > WIDTH {
            writeln!(out, "{line}").unwrap();
            line = format!("{indent}  ");
        }
        line.push(' ');
        line.push_str(word);
    }
    writeln!(out, "{line} */").unwrap();
}

fn layout() -> String {
    format!(
        "#define EQUIPOISE_JOINTS {JOINTS}\n#define EQUIPOISE_SEGMENTS {SEGMENTS}\n\n/* Hash of the \
         fields of all structs and of all names and numbers. See equipoise_options. */\n#define EQUIPOISE_STATE_TYPE \
         \"{}\"\n#define EQUIPOISE_LAYOUT UINT64_C(0x{:016x})\n",
        State::TYPE_NAME,
        layout::layout()
    )
}

fn reasons() -> String {
    let mut out = String::new();
    let declared = documented(between(VALIDITY, "reasons! {", "\n}"));
    for (reason, name) in Validity::NAMES {
        let quoted = format!("\"{name}\"");
        let (doc, _) = declared.iter().find(|(_, line)| line.contains(&quoted)).unwrap();
        comment(&mut out, "", doc);
        let (name, bit) = (constant_case(name), reason.0.trailing_zeros());
        writeln!(out, "#define EQUIPOISE_REASON_{name} (UINT64_C(1) << {bit})").unwrap();
    }
    out
}

fn invalidating() -> String {
    let mut out = String::new();
    for (set, name) in flag_sets::all() {
        write!(out, "#define EQUIPOISE_INVALIDATES_{} \\\n    (", constant_case(name)).unwrap();
        let names: Vec<_> =
            set.names().map(|name| format!("EQUIPOISE_REASON_{}", constant_case(name))).collect();
        for (at, two) in names.chunks(2).enumerate() {
            let before = if at == 0 { "" } else { " | \\\n     " };
            write!(out, "{before}{}", two.join(" | ")).unwrap();
        }
        out.push_str(")\n");
    }
    out
}

/// Bit constants with the comments of their declarations in Rust.
fn bits(prefix: &str, names: &[(u32, &str)], docs: &str) -> String {
    let mut out = String::new();
    for ((bit, name), (doc, _)) in names.iter().zip(documented(docs)) {
        comment(&mut out, "", &doc);
        let (name, bit) = (constant_case(name), bit.trailing_zeros());
        writeln!(out, "#define EQUIPOISE_{prefix}_{name} (UINT32_C(1) << {bit})").unwrap();
    }
    out
}

fn enumeration(tag: &str, members: &[(String, u32)]) -> String {
    let members: Vec<_> =
        members.iter().map(|(name, number)| format!("    EQUIPOISE_{name} = {number}")).collect();
    format!("enum equipoise_{tag} {{\n{}\n}};\n", members.join(",\n"))
}

fn numbered(tag: &str, name_of: impl Fn(u32) -> Option<&'static str>) -> String {
    let prefix = tag.to_uppercase();
    let named = (0..).map_while(|number| name_of(number).map(|name| (number, constant_case(name))));
    let members: Vec<_> = named.map(|(number, name)| (format!("{prefix}_{name}"), number)).collect();
    enumeration(tag, &members)
}

fn joints() -> String {
    let members =
        Joint::ALL.map(|joint| (format!("JOINT_{}", constant_case(joint.name())), joint.index() as u32));
    enumeration("joint", &members)
}

fn outcomes() -> String {
    let declared = documented(between(OUTCOME, "pub enum Outcome {", "\n}"));
    let mut out = String::from("enum equipoise_outcome {\n");
    for (at, (outcome, name)) in Outcome::ALL.into_iter().enumerate() {
        let number = outcome as i32;
        let (doc, _) = declared.iter().find(|(_, line)| line.ends_with(&format!("= {number},"))).unwrap();
        comment(&mut out, "    ", doc);
        let comma = if at + 1 == Outcome::ALL.len() { "" } else { "," };
        writeln!(out, "    {name} = {number}{comma}").unwrap();
    }
    out + "};\n"
}

/// Converts `[[f64; 3]; SEGMENTS]` to `double` and `[EQUIPOISE_SEGMENTS][3]`.
fn declared(rust: &str) -> (&'static str, String) {
    if let Some(inner) = rust.strip_prefix('[').and_then(|rust| rust.strip_suffix(']')) {
        let (inner, count) = inner.rsplit_once("; ").unwrap();
        let (number, rest) = declared(inner);
        let named = count.chars().next().is_some_and(char::is_alphabetic);
        return (number, format!("[{}{count}]{rest}", if named { "EQUIPOISE_" } else { "" }));
    }
    let number = match rust {
        "u32" => "uint32_t",
        "u64" => "uint64_t",
        "f64" => "double",
        other => panic!("no C type for {other}"),
    };
    (number, String::new())
}

/// Fields of a message with the comments of their declarations.
fn structure<M: Message>(declarations: &str) -> String {
    let mut out = String::new();
    let fields = documented(declarations);
    assert_eq!(fields.len(), M::FIELDS.len());
    for ((doc, line), field) in fields.iter().zip(M::FIELDS) {
        let (name, rust) = line.strip_prefix("pub ").unwrap().trim_end_matches(',').split_once(": ").unwrap();
        assert_eq!(name, field.name);
        comment(&mut out, "    ", doc);
        let (number, shape) = declared(rust);
        writeln!(out, "    {number} {name}{shape};").unwrap();
    }
    out
}

fn header() -> String {
    let mut out = TEMPLATE.to_owned();
    for (mark, text) in [
        ("LAYOUT", layout()),
        ("REASONS", reasons()),
        ("INVALIDATES", invalidating()),
        ("PHASE", numbered("phase", |at| Phase::from_number(at).map(Phase::name))),
        ("LEVEL", numbered("level", |at| Level::from_number(at).map(Level::name))),
        ("SHARING", numbered("sharing", |at| SharingSource::from_number(at).map(SharingSource::name))),
        (
            "UNAVAILABLE",
            bits(
                "UNAVAILABLE",
                &Unavailable::NAMES.map(|(what, name)| (what as u32, name)),
                between(STATE, "pub enum Unavailable {", "\n}"),
            ),
        ),
        (
            "GROUND",
            bits(
                "GROUND",
                &GroundDevice::NAMES.map(|(device, name)| (device as u32, name)),
                between(GROUND, "pub enum GroundDevice {", "\n}"),
            ),
        ),
        ("BODY_SOURCE", numbered("body_source", |at| BodySource::from_number(at).map(BodySource::name))),
        (
            "BODY_REJECTED",
            numbered("body_rejected", |at| BodyRejection::from_number(at).map(BodyRejection::name)),
        ),
        (
            "FOOT_OUTLINE",
            numbered("foot_outline", |at| FootOutlineSource::from_number(at).map(FootOutlineSource::name)),
        ),
        (
            "ACCELERATION",
            numbered("acceleration", |at| AccelerationSource::from_number(at).map(AccelerationSource::name)),
        ),
        ("JOINT", joints()),
        ("OUTCOME", outcomes()),
    ] {
        let mark = format!("@{mark}@\n");
        assert!(out.contains(&mark), "equipoise.h.in lacks {mark}");
        out = out.replace(&mark, &format!("{text}\n"));
    }
    let early = structure::<EarlyState>(between(EARLY, "pub struct EarlyState {", "\n    }"));
    let state = structure::<State>(between(STATE, "pub struct State {", "\n    }"));
    let out = out.replace("@EARLY_STATE@\n", &early).replace("@STATE@\n", &state);
    assert!(!out.contains('@'), "a placeholder of equipoise.h.in without a text");
    out
}

#[test]
fn the_header_is_what_the_declarations_say() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("equipoise.h");
    let (is, should) = (std::fs::read_to_string(&path).unwrap_or_default(), header());
    if std::env::var_os("EQUIPOISE_WRITE").is_some() {
        std::fs::write(&path, should).unwrap();
        return;
    }
    let line = is.lines().zip(should.lines()).position(|(is, should)| is != should);
    assert!(
        is == should,
        "equipoise.h differs from line {:?} on: EQUIPOISE_WRITE=1 writes it",
        line.map(|at| at + 1)
    );
}
