//! `equipoise token`: a secret for the page, from the system's own randomness.

use std::fs::OpenOptions;
use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;

use anyhow::Context;

use super::Outcome;

/// As many random bytes as a key has.
const SECRET_BYTES: usize = 32;

/// Make a token for the page ([page] token_file)
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  equipoise token --out page.token\n  (umask 027; equipoise token > page.token)"
)]
pub(super) struct Arguments {
    /// Write it to a new file that only owner and group can read, instead of printing it
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let token = token()?;
    match &arguments.out {
        None => println!("{token}"),
        Some(path) => {
            // Never overwrite a token, which may be in use.
            let file = OpenOptions::new().write(true).create_new(true).mode(0o640).open(path);
            let written = file.and_then(|mut file| writeln!(file, "{token}"));
            written.with_context(|| format!("cannot make {}", path.display()))?;
            println!("{} holds a new token; open the page once with ?token= and it", path.display());
        }
    }
    Ok(Outcome::Done)
}

fn token() -> anyhow::Result<String> {
    let (mut bytes, mut filled) = ([0; SECRET_BYTES], 0);
    while filled < SECRET_BYTES {
        filled += rustix::rand::getrandom(&mut bytes[filled..], rustix::rand::GetRandomFlags::empty())
            .context("the system has no random numbers")?;
    }
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}
