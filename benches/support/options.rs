//! Command line options: `cargo bench -p equipoise-benches --bench NAME -- [--quick] [--rounds N] [--seconds S] [--only
//! PART]`.

use std::str::FromStr;

/// Extent of the measurement.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Only check that it works, within seconds.
    pub quick: bool,
    /// Rounds; each has every contender once.
    pub rounds: usize,
    /// Length of one contender's turn, s.
    pub turn_s: f64,
    /// Only the parts whose names contain this.
    pub only: String,
}

impl Options {
    /// Reads the command line over a bench's own defaults; exits with a message if it is invalid.
    pub fn read(rounds: usize, turn_s: f64) -> Options {
        let mut options = Options { quick: false, rounds, turn_s, only: String::new() };
        let mut arguments = std::env::args().skip(1);
        while let Some(argument) = arguments.next() {
            match argument.as_str() {
                "--quick" => (options.quick, options.rounds, options.turn_s) = (true, 1, 0.3),
                "--rounds" => options.rounds = number("--rounds", arguments.next()),
                "--seconds" => options.turn_s = number("--seconds", arguments.next()),
                "--only" => options.only = arguments.next().unwrap_or_default(),
                // Added by cargo.
                "--bench" => {}
                other => refuse(&format!(
                    "{other} is not known; there are --quick, --rounds N, --seconds S, --only PART"
                )),
            }
        }
        options
    }

    /// Whether a part of the bench is selected.
    pub fn asks_for(&self, part: &str) -> bool {
        part.contains(&self.only)
    }
}

fn number<T: FromStr>(name: &str, value: Option<String>) -> T {
    let read = value.and_then(|text| text.parse().ok());
    read.unwrap_or_else(|| refuse(&format!("{name} needs a number")))
}

fn refuse(why: &str) -> ! {
    eprintln!("{why}");
    std::process::exit(2)
}
