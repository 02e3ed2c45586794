//! Files crafted to exhaust a machine: each is refused, or read up to its first defect, within 1 GiB of address space.

#[path = "bombs/make.rs"]
mod make;

use std::path::Path;
use std::process::{Command, Output};

use crate::common::describe_output;
use make::{Chunk, Mcap, Pcap};

const MIB: usize = 1 << 20;

/// Runs the program with so little memory that a bomb which takes effect ends it.
fn equipoise(arguments: &[&str]) -> Output {
    let limited = "ulimit -v 1048576 && exec \"$@\"";
    Command::new("sh")
        .args(["-c", limited, "sh", env!("CARGO_BIN_EXE_equipoise")])
        .args(arguments)
        .output()
        .unwrap()
}

/// Gives the file to every command that reads such a file; returns the outputs. Each program must have ended by itself.
fn read_by_all(path: &Path, codes: &[i32]) -> Vec<String> {
    let file = path.to_str().unwrap();
    let results =
        ["html", "result.csv", "result.mcap"].map(|ending| path.with_extension(ending).display().to_string());
    let [page, table, recording] = results.each_ref().map(String::as_str);
    let mut commands = vec![
        vec!["replay", file],
        vec!["report", file, "--out", page],
        vec!["export", file, "--out", table],
        vec!["reconcile", file],
    ];
    if path.extension().is_some_and(|ending| ending != "mcap") {
        commands.push(vec!["import", file, "-o", recording]);
    }
    std::thread::scope(|scope| {
        let start = |arguments| scope.spawn(move || read(arguments, codes));
        let running: Vec<_> = commands.iter().map(|arguments| start(&arguments[..])).collect();
        running.into_iter().map(|command| command.join().unwrap()).collect()
    })
}

/// Runs one command; returns the output.
fn read(arguments: &[&str], codes: &[i32]) -> String {
    let output = equipoise(arguments);
    let describe_output = format!("{}: {}", arguments[0], describe_output(&output));
    assert!(output.status.code().is_some_and(|code| codes.contains(&code)), "{describe_output}");
    assert!(
        describe_output.len() < 4000,
        "{} characters: {}",
        describe_output.len(),
        &describe_output[..2000]
    );
    describe_output
}

#[test]
fn a_chunk_that_unpacks_to_gigabytes_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bomb.mcap");
    // The file declares its size, or declares a small one.
    for claimed in [2048 * MIB, 1000] {
        let mut file = Mcap::create(&path);
        file.our_head();
        let mut chunk = Chunk::default();
        chunk.repeat(0, 2048 * MIB);
        file.chunk_that_claims(&chunk, claimed);
        file.end();
        for output in read_by_all(&path, &[1, 3]) {
            assert!(claimed == 1000 || output.contains("a chunk of 2147483648 bytes"), "{output}");
        }
    }
}

#[test]
fn floods_of_schemas_and_of_topics_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("flood.mcap");
    for flood in [Chunk::schema, Chunk::channel as fn(&mut Chunk, u16, usize)] {
        let mut file = Mcap::create(&path);
        file.our_head();
        for chunk_number in 0..100 {
            let mut chunk = Chunk::default();
            (0..20).for_each(|number| flood(&mut chunk, chunk_number * 20 + number + 1, MIB));
            file.chunk(&chunk);
        }
        file.end();
        for output in read_by_all(&path, &[1, 3]) {
            assert!(output.contains("its topics and schemas have more than 16777216 bytes"), "{output}");
        }
    }
}

#[test]
fn a_flood_of_messages_under_a_long_name_is_read() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("messages.mcap");
    let mut file = Mcap::create(&path);
    file.our_head();
    let mut chunk = Chunk::default();
    chunk.channel(7, 8 * MIB);
    chunk.messages(7, 500_000);
    file.chunk(&chunk);
    file.end();
    for output in read_by_all(&path, &[1]) {
        assert!(output.contains("not of Equipoise: it holds the topics aaa"), "{output}");
    }
}

#[test]
fn a_flood_of_attachments_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("attached.mcap");
    let mut file = Mcap::create(&path);
    (0..1500).for_each(|_| file.attachment("subject.later.toml", MIB));
    file.end();
    for output in read_by_all(&path, &[1]) {
        assert!(output.contains("its attachments have more than"), "{output}");
    }
}

#[test]
fn a_foreign_file_s_names_are_printed_short_and_in_one_line() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("foreign.mcap");
    let mut file = Mcap::create(&path);
    let mut chunk = Chunk::default();
    (1..=100).for_each(|id| chunk.channel_named(id, "/\u{1b}[2Jwiped\n/b"));
    file.chunk(&chunk);
    file.end();
    for output in read_by_all(&path, &[1]) {
        let is_escaped = !output.contains('\u{1b}') && output.contains("\\u{1b}");
        assert!(is_escaped && output.contains("and 92 more"), "{output}");
    }
}

#[test]
fn a_capture_is_read_piece_by_piece() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("long.pcap");
    let mut file = Pcap::create(&path);
    (0..6000).for_each(|_| file.packet_of_nothing(262_144));
    file.end();
    for output in read_by_all(&path, &[1]) {
        assert!(output.contains("6000 packets") && output.contains("no usable sample"), "{output}");
    }

    let path = directory.path().join("block.pcapng");
    Pcap::one_block_of(&path, 1900 * MIB);
    for output in read_by_all(&path, &[1]) {
        assert!(output.contains("a record of more than 67108864 bytes"), "{output}");
    }
}

#[test]
fn incomplete_fragments_are_discarded() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("fragments.pcap");
    let mut file = Pcap::create(&path);
    (0..200_000).for_each(|number| file.last_fragment(number));
    file.end();
    for output in read_by_all(&path, &[1]) {
        assert!(output.contains("200000 packets fragments_missing"), "{output}");
    }
}

/// Each fragment ends more than 32 kB behind the start of the datagram: a buffer for each would exceed the limit.
#[test]
fn fragments_of_one_datagram_share_its_memory() {
    let directory = tempfile::tempdir().unwrap();
    for (name, step, eights) in [("apart.pcap", 2, 1), ("overlapping.pcap", 1, 2)] {
        let path = directory.path().join(name);
        let mut file = Pcap::create(&path);
        (0..30_000_u16).for_each(|number| file.inner_fragment(4000 + number % (4000 / step) * step, eights));
        file.end();
        for output in read_by_all(&path, &[1]) {
            assert!(output.contains("1 packets fragments_missing"), "{output}");
        }
    }
}

#[test]
fn oversized_configurations_and_special_files_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let (vast, pipe) = (directory.path().join("vast.toml"), directory.path().join("pipe.toml"));
    std::fs::File::create(&vast).unwrap().set_len(400 * MIB as u64).unwrap();
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for (path, reason) in [(&vast, "longer than 1048576 bytes"), (&pipe, "no regular file")] {
        let output = equipoise(&["check", path.to_str().unwrap()]);
        assert!(
            output.status.code() == Some(1) && describe_output(&output).contains(reason),
            "{}",
            describe_output(&output)
        );
    }
    for name in ["a.mcap", "a.csv", "a.mvnx", "a.pcap"] {
        let path = directory.path().join(name);
        assert!(Command::new("mkfifo").arg(&path).status().unwrap().success());
        for output in read_by_all(&path, &[1]) {
            assert!(output.contains("no regular file"), "{output}");
        }
    }
}
