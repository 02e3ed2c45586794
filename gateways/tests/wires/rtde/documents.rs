//! Compares the table of docs/consumers/rtde.md with the code; `EQUIPOISE_WRITE=1` writes it.

use std::fmt::Write as _;
use std::path::Path;

use equipoise_core::message::Validity;
use equipoise_gateways::StationFile;
use equipoise_gateways::config::{RtdeConfig, rtde_values};

#[test]
fn the_documents_name_every_value() {
    let config: RtdeConfig = toml::from_str("robot = \"192.0.2.20:30004\"").unwrap();
    let mut table = String::from(
        "| name | register | default | zero unless `usable` has | is |\n|---|---|---:|---|---|\n",
    );
    for (name, kind, group, says) in rtde_values() {
        let number = config.registers.get(name).map_or(String::new(), u8::to_string);
        writeln!(table, "| `{name}` | {kind} | {number} | {group} | {says} |").unwrap();
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/consumers/rtde.md");
    let (begin, end) = ("<!-- registers: begin -->\n", "<!-- registers: end -->");
    let document = std::fs::read_to_string(&path).unwrap();
    let (before, rest) = document.split_once(begin).unwrap();
    let (copy, after) = rest.split_once(end).unwrap();
    if std::env::var_os("EQUIPOISE_WRITE").is_some() {
        std::fs::write(&path, format!("{before}{begin}\n{table}\n{end}{after}")).unwrap();
        return;
    }
    assert_eq!(
        copy.trim(),
        table.trim(),
        "docs/consumers/rtde.md has another table; EQUIPOISE_WRITE=1 writes it"
    );
}

#[test]
fn the_script_reads_the_registers_that_are_written() {
    let script = include_str!("../../../../clients/ur/equipoise.script");
    let config: RtdeConfig = toml::from_str("robot = \"192.0.2.20:30004\"").unwrap();
    for (name, kind) in [
        ("sequence", "integer"),
        ("state", "integer"),
        ("valid", "integer"),
        ("usable", "integer"),
        ("worst_level", "integer"),
        ("age_s", "float"),
    ] {
        let read = format!("read_input_{kind}_register({})", config.registers[name]);
        assert!(script.contains(&read), "{name}: {read}");
    }
    let torques = Validity::FLAG_SETS.iter().position(|(_, name)| *name == "torques").unwrap();
    assert!(script.contains(&format!("USABLE_TORQUES = {}\n", 1 << torques)));
    assert!(script.contains(&format!("BELOW_LOAD_THRESHOLD = {}\n", Validity::BELOW_LOAD_THRESHOLD.0)));
    let document = include_str!("../../../../docs/consumers/rtde.md");
    assert!(document.contains(&format!("{} for torques", 1 << torques)));
}

#[test]
fn every_configuration_on_the_pages_can_be_used() {
    let pages = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/consumers");
    let folder = tempfile::tempdir().unwrap();
    let mut tried = Vec::new();
    for page in std::fs::read_dir(pages).unwrap() {
        let page = page.unwrap().path();
        let text = std::fs::read_to_string(&page).unwrap();
        let blocks = text.split("```toml\n").skip(1).map(|rest| rest.split_once("```").unwrap().0);
        for block in blocks.filter(|block| block.contains("[gateways.")) {
            let file = folder.path().join("station.toml");
            std::fs::write(&file, format!("station = \"page\"\n{block}")).unwrap();
            if let Err(error) = StationFile::read(&file) {
                panic!("{}: {error}\n{block}", page.display());
            }
            tried.push(page.file_stem().unwrap().to_owned());
        }
    }
    for page in ["foxglove", "mqtt", "opcua", "rtde", "udp", "zenoh"] {
        assert!(tried.iter().any(|tried| tried == page), "{page}.md shows no configuration");
    }
}
