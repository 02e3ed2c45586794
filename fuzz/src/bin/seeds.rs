//! Writes the inputs to begin with: `EQUIPOISE_CORPUS=CORPUS seeds` fills CORPUS/LAW/.
//!
//! It begins as a target does and never becomes one: what is instrumented must be linked with libFuzzer.
#![no_main]

use std::path::PathBuf;
use std::{env, fs, io, process};

fn write() -> io::Result<()> {
    let corpus = PathBuf::from(env::var_os("EQUIPOISE_CORPUS").unwrap_or_else(|| "corpus".into()));
    for (law, seeds) in equipoise_fuzz::seeds() {
        let folder = corpus.join(law);
        fs::create_dir_all(&folder)?;
        for (number, seed) in seeds.iter().enumerate() {
            fs::write(folder.join(format!("seed-{number}")), seed)?;
        }
    }
    Ok(())
}

/// Does not return; libFuzzer's macro would not have that said in its type.
fn write_and_end() {
    let written = write();
    if let Err(error) = &written {
        eprintln!("seeds: {error}");
    }
    process::exit(i32::from(written.is_err()))
}

libfuzzer_sys::fuzz_target!(init: write_and_end(), |_bytes: &[u8]| {});
