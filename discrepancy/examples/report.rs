//! Writes reports of made-up findings, one per answer, to be looked at: `cargo run -p equipoise-discrepancy --example
//! report -- FOLDER`.

#[path = "../tests/report/sample.rs"]
mod sample;

use std::path::PathBuf;
use std::process::ExitCode;

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
        if let Err(error) = pages.write_to(&folder.join(name)) {
            eprintln!("{error}");
            return ExitCode::FAILURE;
        }
        let page =
            pages.files.iter().find(|(name, _)| name == "report.html").map_or(0, |(_, text)| text.len());
        println!("{}: {} files, report.html {page} bytes", folder.join(name).display(), pages.files.len());
    }
    ExitCode::SUCCESS
}
