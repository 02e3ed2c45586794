//! Files generated from the layout table: documentation, C header, Python module.

use std::fmt::Write as _;
use std::path::Path;

use equipoise_core::body::Joint;
use equipoise_core::message::Validity;
use equipoise_core::message::state::Phase;
use equipoise_core::overload::Level;
use equipoise_gateways::udp::encode::STATUSES;
use equipoise_gateways::udp::layout::{FIELDS, Field, Kind, LENGTH, MAGIC, VERSION};

/// Fields with their offsets.
pub(crate) fn placed() -> impl Iterator<Item = (usize, &'static Field)> {
    FIELDS.iter().scan(0, |end, field| {
        let offset = *end;
        *end += field.bytes();
        Some((offset, field))
    })
}

fn group(needs: Option<Validity>) -> &'static str {
    let Some(needs) = needs else { return "" };
    let found = Validity::FLAG_SETS.iter().find(|(invalidating, _)| *invalidating == needs);
    found.expect("a field needs one of the sets that `usable` has a bit for").1
}

fn shape(field: &Field) -> String {
    let dimensions = field.shape.iter().filter(|_| field.kind != Kind::Char);
    dimensions.map(|count| format!("[{count}]")).collect()
}

/// `RightT4Shoulder` as `RIGHT_T4_SHOULDER`.
fn constant_case(name: &str) -> String {
    let letters: Vec<char> = name.chars().collect();
    let mut out = String::new();
    for (at, letter) in letters.iter().enumerate() {
        let follows_a_word = at > 0 && letters[at - 1].is_lowercase();
        let begins_a_word = at > 0 && letters.get(at + 1).is_some_and(|next| next.is_lowercase());
        if letter.is_uppercase() && (follows_a_word || begins_a_word) {
            out.push('_');
        }
        out.extend(letter.to_uppercase());
    }
    out
}

/// The flags of a set, or, if these are fewer, the exceptions from all flags.
fn flags(set: Validity) -> String {
    let given: Vec<_> = set.names().collect();
    let exceptions: Vec<_> = Validity(!set.0).names().collect();
    match exceptions.len() {
        0 => "all".to_owned(),
        count if count < given.len() => format!("all but {}", exceptions.join(", ")),
        _ => given.join(", "),
    }
}

fn documents() -> String {
    let mut out = String::from(
        "| offset | type | name | unit | zero unless `usable` has | meaning |\n|---:|---|---|---|---|---|\n",
    );
    for (offset, field) in placed() {
        let count = field.shape.iter().map(|count| format!("[{count}]")).collect::<String>();
        let (kind, name, unit, meaning) = (field.kind.name(), field.name, field.unit, field.meaning);
        let needs = group(field.needs);
        writeln!(out, "| {offset} | {kind}{count} | `{name}` | {unit} | {needs} | {meaning} |").unwrap();
    }
    writeln!(out, "\n{LENGTH} bytes.\n\n| bit of `usable` | group | its reasons |\n|---:|---|---|").unwrap();
    for (bit, (invalidating, name)) in Validity::FLAG_SETS.iter().enumerate() {
        writeln!(out, "| {bit} | {name} | {} |", flags(*invalidating)).unwrap();
    }
    let bits: Vec<_> =
        Validity::NAMES.iter().map(|(flag, name)| format!("{} {name}", flag.0.trailing_zeros())).collect();
    writeln!(out, "\nBits of `valid`: {}.", bits.join(", ")).unwrap();
    let joints: Vec<_> =
        Joint::ALL.iter().map(|joint| format!("{} {}", joint.index(), joint.name())).collect();
    writeln!(out, "\nJoints, in the order of the arrays: {}.", joints.join(", ")).unwrap();
    out
}

const C_HEAD: &str = r#"/* The datagrams of an Equipoise station's UDP gateway, for any C compiler and any byte order.
 *
 *     cc -std=c11 -I clients/c your_program.c clients/c/udp_reader.c
 *
 * clients/c/udp_controller.c is a complete program; docs/consumers/udp.md lists the checks before a value is used.
 * Generated from the gateway's table: do not edit.
 *
 *     EQUIPOISE_WRITE=1 cargo test -p equipoise-gateways --test wires
 */
#ifndef EQUIPOISE_UDP_H
#define EQUIPOISE_UDP_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

"#;

const C_FOOT: &str = r#"
/* Result of equipoise_udp_take. Only EQUIPOISE_UDP_TAKEN fills *datagram. */
enum equipoise_udp_outcome {
    EQUIPOISE_UDP_TAKEN = 0,
    /* Too short, or another length than that of its header or of this version. */
    EQUIPOISE_UDP_LENGTH = 1,
    /* It does not begin with EQPU. */
    EQUIPOISE_UDP_MAGIC_WRONG = 2,
    /* The datagram has another version than this header. */
    EQUIPOISE_UDP_OTHER_VERSION = 3,
    EQUIPOISE_UDP_CRC_WRONG = 4,
    EQUIPOISE_UDP_OTHER_STATION = 5,
    /* Not later than an accepted one: repeated, out of order, or of an earlier session. */
    EQUIPOISE_UDP_OLD = 6
};

/* Accepts the datagrams of one station, each once and in order. */
typedef struct equipoise_udp_reader {
    /* NULL: any station. */
    const char *station;
    uint64_t session_ns;
    uint64_t sequence;
    /* Time at which the last one was accepted, by the caller's clock, ns; 0: none yet. */
    uint64_t taken_at_ns;
    /* Datagrams accepted, and datagrams missing between them. */
    uint64_t taken;
    uint64_t missed;
    /* Datagrams rejected, by outcome. */
    uint64_t refused[7];
    /* Delay of the last datagram in addition to that of the fastest one of the session, including its time in the socket,
     * ns. equipoise_udp_age_ns adds it; add it to sample_age_ns, too.
     */
    uint64_t late_ns;
    /* Internal: time of the last empty socket, and bounds of the difference of this clock from the station's. */
    uint64_t drained_at_ns;
    uint64_t bounded_at_ns;
    int64_t ahead_min_ns;
    int64_t ahead_max_ns;
    int bounded;
} equipoise_udp_reader;

/* Initialises a reader. station may be NULL; the text must exist as long as the reader. */
void equipoise_udp_begin(equipoise_udp_reader *reader, const char *station);

/* Reports that the socket was empty at now_ns: read the clock, receive without waiting, and call this if there was no
 * datagram. The next datagram arrived later than that, which limits its time in the socket. Before the first call the age
 * of every state is that of the clock.
 */
void equipoise_udp_drained(equipoise_udp_reader *reader, uint64_t now_ns);

/* Validates a datagram; now_ns is the caller's clock, which must be monotonic (CLOCK_MONOTONIC). After a second without a
 * datagram any session is accepted, because the sender's wall clock may have been set back.
 *
 * Empty the socket before acting: the last datagram is the newest.
 */
int equipoise_udp_take(equipoise_udp_reader *reader, const void *bytes, size_t length, uint64_t now_ns,
                       equipoise_udp_datagram *datagram);

/* Present age of the last datagram's state, ns: its age when it was sent, late_ns, and the time since its receipt; without
 * the travel time of the fastest datagram. UINT64_MAX without a state or before the first datagram. Compare it with the
 * maximum age that your robot tolerates.
 */
uint64_t equipoise_udp_age_ns(const equipoise_udp_reader *reader, const equipoise_udp_datagram *datagram,
                              uint64_t now_ns);

/* "taken", "length", "magic", "version", "crc", "station", "old". */
const char *equipoise_udp_outcome_name(int outcome);

#ifdef __cplusplus
}
#endif

#endif
"#;

fn c_enumeration(out: &mut String, doc: &str, prefix: &str, names: impl Iterator<Item = (String, u64)>) {
    let members: Vec<_> =
        names.map(|(name, number)| format!("    EQUIPOISE_UDP_{prefix}_{name} = {number}")).collect();
    let tag = prefix.to_lowercase();
    writeln!(out, "\n/* {doc} */\nenum equipoise_udp_{tag} {{\n{}\n}};", members.join(",\n")).unwrap();
}

fn numbered(name_of: impl Fn(u32) -> Option<&'static str>) -> impl Iterator<Item = (String, u64)> {
    let named = (0..).map_while(move |number| name_of(number).map(|name| (number, constant_case(name))));
    named.map(|(number, name)| (name, u64::from(number)))
}

fn statuses() -> impl Iterator<Item = (String, u64)> {
    (0..).zip(STATUSES).map(|(number, name)| (constant_case(name), number))
}

fn groups() -> impl Iterator<Item = (String, u64)> {
    Validity::FLAG_SETS.iter().enumerate().map(|(bit, (_, name))| (constant_case(name), 1 << bit))
}

fn joints() -> impl Iterator<Item = (String, u64)> {
    Joint::ALL.into_iter().map(|joint| (constant_case(joint.name()), joint.index() as u64))
}

fn c_header() -> String {
    let mut out = C_HEAD.to_owned();
    writeln!(out, "#define EQUIPOISE_UDP_MAGIC \"{}\"", String::from_utf8_lossy(&MAGIC)).unwrap();
    writeln!(out, "#define EQUIPOISE_UDP_VERSION {VERSION}\n#define EQUIPOISE_UDP_BYTES {LENGTH}").unwrap();
    writeln!(out, "#define EQUIPOISE_UDP_JOINTS {}", Joint::ALL.len()).unwrap();
    c_enumeration(&mut out, "status: reason why there is no state.", "STATUS", statuses());
    c_enumeration(&mut out, "phase", "PHASE", numbered(|at| Phase::from_number(at).map(Phase::name)));
    c_enumeration(
        &mut out,
        "joint_level. UNDECIDED: the uncertainty of the torque covers two levels; treat it as the highest.",
        "LEVEL",
        numbered(|at| Level::from_number(at).map(Level::name)),
    );
    let reasons = Validity::NAMES.iter().map(|(reason, name)| (constant_case(name), reason.0));
    c_enumeration(&mut out, "Bits of valid: invalid reasons.", "REASON", reasons);
    c_enumeration(&mut out, "Bits of usable: groups of valid values.", "USABLE", groups());
    c_enumeration(&mut out, "Indices of arrays per joint.", "JOINT", joints());
    out.push_str("\n/* A datagram, in this machine's byte order. A value of a group is 0 while the group's bit of usable is 0. */\n");
    out.push_str("typedef struct equipoise_udp_datagram {\n");
    for (_, field) in placed() {
        let kind = c_type(field.kind);
        let (text, count) = (field.kind == Kind::Char, field.count());
        let shape = if text { format!("[{}]", count + 1) } else { shape(field) };
        let needs = if field.needs.is_some() { " Needs " } else { "" };
        let comment = format!("{}{needs}{}", c_comment(field), group(field.needs).to_uppercase());
        writeln!(out, "    /* {comment} */\n    {kind} {}{shape};", field.name).unwrap();
    }
    out.push_str(
        "} equipoise_udp_datagram;\n\n/* X(type, name, number of elements, offset) for each field. */\n",
    );
    out.push_str("#define EQUIPOISE_UDP_FIELDS(X) \\\n");
    let rows: Vec<_> = placed()
        .map(|(offset, field)| {
            format!("    X({}, {}, {}, {offset})", field.kind.name(), field.name, field.count())
        })
        .collect();
    writeln!(out, "{}", rows.join(" \\\n")).unwrap();
    out + C_FOOT
}

fn c_comment(field: &Field) -> String {
    let unit = if field.unit.is_empty() { String::new() } else { format!(" [{}]", field.unit) };
    let mut text = format!("{}{unit}.", field.meaning.replace('`', ""));
    if let Some(first) = text.get_mut(0..1) {
        first.make_ascii_uppercase();
    }
    text
}

fn c_type(kind: Kind) -> &'static str {
    match kind {
        Kind::Char => "char",
        Kind::U8 => "uint8_t",
        Kind::U16 => "uint16_t",
        Kind::U32 => "uint32_t",
        Kind::U64 => "uint64_t",
        Kind::F32 => "float",
    }
}

const PYTHON_HEAD: &str = r#""""The datagrams of the UDP gateway. Generated from its table: do not edit.

    EQUIPOISE_WRITE=1 cargo test -p equipoise-gateways --test wires
"""

from __future__ import annotations

import enum
from typing import NamedTuple, Tuple

"#;

fn python_enumeration(out: &mut String, head: &str, doc: &str, names: impl Iterator<Item = (String, u64)>) {
    writeln!(out, "\n\nclass {head}:\n    \"\"\"{doc}\"\"\"\n").unwrap();
    for (name, number) in names {
        writeln!(out, "    {name} = {number}").unwrap();
    }
}

fn python_module() -> String {
    let mut out = PYTHON_HEAD.to_owned();
    let format: String = placed()
        .map(|(_, field)| {
            let letter = match field.kind {
                Kind::Char => "s",
                Kind::U8 => "B",
                Kind::U16 => "H",
                Kind::U32 => "I",
                Kind::U64 => "Q",
                Kind::F32 => "f",
            };
            let count = if field.shape.is_empty() { String::new() } else { field.count().to_string() };
            format!(" {count}{letter}")
        })
        .collect();
    writeln!(out, "MAGIC = b\"{}\"", String::from_utf8_lossy(&MAGIC)).unwrap();
    writeln!(out, "VERSION = {VERSION}\nBYTES = {LENGTH}\n# For `struct`.\nFORMAT = (").unwrap();
    let words: Vec<_> = format.split_whitespace().collect();
    for (at, part) in words.chunks(16).enumerate() {
        writeln!(out, "    \"{}{} \"", if at == 0 { "< " } else { "" }, part.join(" ")).unwrap();
    }
    out.push_str(")\n# Number of elements of each field.\nCOUNTS = (\n");
    for (_, field) in placed() {
        let count = if field.kind == Kind::Char { 1 } else { field.count() };
        writeln!(out, "    (\"{}\", {count}),", field.name).unwrap();
    }
    out.push_str(")\n");
    python_enumeration(
        &mut out,
        "Status(enum.IntEnum)",
        "Reason why there is no state: `status`.",
        statuses(),
    );
    let usable = "Groups of valid values: bits of `usable`.";
    python_enumeration(&mut out, "Usable(enum.IntFlag)", usable, groups());
    out.push_str("\n\nclass Datagram(NamedTuple):\n    \"\"\"A datagram. Invalid values are 0.\n\n");
    out.push_str("    Matrices (`torque_nm`: three per joint) are in row-major order.\n    \"\"\"\n\n");
    for (_, field) in placed() {
        let word = match (field.kind, field.shape.is_empty()) {
            (Kind::Char, _) => "bytes",
            (Kind::F32, true) => "float",
            (Kind::F32, false) => "Tuple[float, ...]",
            (_, true) => "int",
            (_, false) => "Tuple[int, ...]",
        };
        writeln!(out, "    {}: {word}", field.name).unwrap();
    }
    out
}

fn compare(path: &str, should: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path);
    let is = std::fs::read_to_string(&path).unwrap_or_default();
    if std::env::var_os("EQUIPOISE_WRITE").is_some() {
        std::fs::write(&path, should).unwrap();
        return;
    }
    assert!(is == should, "{} differs from the table; EQUIPOISE_WRITE=1 writes it", path.display());
}

#[test]
fn the_c_header_is_what_the_table_says() {
    compare("clients/c/equipoise_udp.h", &c_header());
}

#[test]
fn the_python_module_is_what_the_table_says() {
    compare("clients/python/equipoise/_udp_layout.py", &python_module());
}

#[test]
fn the_documents_are_what_the_table_says() {
    let path = "docs/consumers/udp.md";
    let whole = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path);
    let document = std::fs::read_to_string(whole).unwrap();
    let (begin, end) = ("<!-- layout: begin -->\n", "<!-- layout: end -->");
    let (before, rest) = document.split_once(begin).unwrap();
    let (_, after) = rest.split_once(end).unwrap();
    compare(path, &format!("{before}{begin}\n{}\n{end}{after}", documents()));
}

#[test]
fn a_changed_layout_is_a_new_version() {
    let text: String = placed()
        .map(|(offset, field)| {
            format!("{offset} {:?} {:?} {} {}\n", field.kind, field.shape, field.name, field.unit)
        })
        .chain(groups().map(|(name, bit)| format!("{name} {bit}\n")))
        .collect();
    let print = equipoise_gateways::udp::encode::CRC.checksum(text.as_bytes());
    assert_eq!(
        (VERSION, print),
        (2, 3_975_917_358),
        "the table has changed: count VERSION up, then write this print here"
    );
}
