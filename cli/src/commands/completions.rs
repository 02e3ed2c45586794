//! Shell completions and man pages, generated from the definitions of the commands.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Context;
use clap::CommandFactory;
use clap_complete::Shell;

use super::{Cli, Outcome};

/// Print the completion script of a shell; packages install those of bash, zsh and fish
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: equipoise completions bash > ~/.local/share/bash-completion/completions/equipoise"
)]
pub(super) struct Arguments {
    /// Shell that runs the script
    shell: Shell,
}

/// Write a man page of each command, for packages
#[derive(Debug, clap::Args)]
pub(super) struct ManPagesArguments {
    /// Created if it does not exist
    directory: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    // The generator panics on a write error: it writes to memory.
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut Cli::command(), "equipoise", &mut script);
    std::io::stdout().write_all(&script)?;
    Ok(Outcome::Done)
}

pub(super) fn man_pages(arguments: &ManPagesArguments) -> anyhow::Result<Outcome> {
    let directory = &arguments.directory;
    std::fs::create_dir_all(directory)
        .and_then(|()| clap_mangen::generate_to(Cli::command(), directory))
        .with_context(|| format!("cannot write man pages to {}", directory.display()))?;
    Ok(Outcome::Done)
}
