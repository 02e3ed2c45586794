//! Writes reports of made-up findings, one per answer, for visual checks: `cargo run -p equipoise-discrepancy --example
//! report -- FOLDER`.

#[path = "../tests/report/sample.rs"]
mod sample;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::{fs, io};

use equipoise_discrepancy::report::Pages;

fn main() -> ExitCode {
    let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) else {
        eprintln!("report FOLDER: where to write the reports");
        return ExitCode::from(2);
    };
    let samples = [
        ("named", sample::named(90.0)),
        ("none", sample::none(90.0)),
        ("ambiguous", sample::ambiguous(90.0)),
        ("unexplained", sample::unexplained(90.0)),
        ("long", sample::named(20.0 * 3600.0)),
    ];
    for (name, sample) in samples {
        let pages = sample.report().pages();
        if let Err(error) = write(&folder.join(name), &pages) {
            eprintln!("cannot write to {}: {error}", folder.join(name).display());
            return ExitCode::FAILURE;
        }
        let page =
            pages.files.iter().find(|(name, _)| name == "report.html").map_or(0, |(_, text)| text.len());
        println!("{}: {} files, report.html {page} bytes", folder.join(name).display(), pages.files.len());
    }
    ExitCode::SUCCESS
}

fn write(folder: &Path, pages: &Pages) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    pages.files.iter().try_for_each(|(name, text)| fs::write(folder.join(name), text))
}
