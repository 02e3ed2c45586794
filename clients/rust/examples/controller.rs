//! Minimal robot controller: the checks that a controller must make before it uses a value. Prints a line per second.
//!
//! ```sh
//! cargo run --release -p equipoise-client --example controller -- station-1 arm-left
//! ```
use equipoise_client::clock::now_ns;
use equipoise_client::{Consumer, NoReading, Reading};
use equipoise_core::message::{State, Validity};
use equipoise_core::overload::Level;
use std::error::Error;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Longest time that the robot moves without a new state.
const TIMEOUT: Duration = Duration::from_millis(25);
const PRINT_EVERY_NS: u64 = 1_000_000_000;
/// Maximum number of states for the median latency.
const LATENCIES_MAX: usize = 1 << 16;

/// Why the robot has its present speed.
enum Situation {
    /// There is a current state, which yields this speed.
    Current(Box<Reading>, u32),
    /// There is none: the robot stops.
    Nothing(NoReading),
}

/// The robot's speed for this state, percent.
fn speed_percent(state: &State) -> u32 {
    let reasons = state.validity();
    if reasons == Validity::BELOW_LOAD_THRESHOLD {
        return 100; // A valid result: no load is carried.
    }
    let Some(levels) = state.unless(Validity::INVALIDATES_TORQUES, state.joint_level) else {
        return 25; // Torques are invalid: slow down.
    };
    // An undecided joint counts as the worst, because its number is the highest.
    match levels.into_iter().max().and_then(Level::from_number) {
        Some(Level::Green) => 100,
        Some(Level::Orange) => 60,
        _ => 25,
    }
}

/// Counts over the whole run.
#[derive(Default)]
struct Tally {
    states: u64,
    missed: u64,
    silences: u64,
    restarts: u64,
    latest_due_ns: u64,
    latencies_ns: Vec<u64>,
}

impl Tally {
    /// Counts a reading; returns `false` if it is not later than the previous one, which must never happen.
    fn enter(&mut self, reading: &Reading) -> bool {
        let is_later = reading.state.time_ns > self.latest_due_ns;
        self.latest_due_ns = reading.state.time_ns;
        self.states += 1;
        self.missed += reading.missed;
        self.restarts += u64::from(reading.restarted);
        if self.latencies_ns.len() < LATENCIES_MAX {
            self.latencies_ns.push(reading.received_ns.saturating_sub(reading.state.published_ns));
        }
        is_later
    }

    fn p50_ns(&mut self) -> u64 {
        self.latencies_ns.sort_unstable();
        // Index of the lower median.
        self.latencies_ns.get(self.latencies_ns.len().saturating_sub(1) / 2).copied().unwrap_or(0)
    }

    fn line(&mut self, situation: &Situation) -> String {
        let now_ns = now_ns();
        let what = match situation {
            Situation::Current(reading, speed_percent) => format!(
                "state=current cycle={} due_ns={} age_us={} speed_percent={speed_percent} withheld={}",
                reading.state.cycle,
                reading.state.time_ns,
                now_ns.saturating_sub(reading.state.time_ns) / 1000,
                reading.validity().names().collect::<Vec<_>>().join("+"),
            ),
            Situation::Nothing(NoReading::Silent { .. }) => "state=silent speed_percent=0".to_owned(),
            Situation::Nothing(NoReading::Stale { .. }) => "state=stale speed_percent=0".to_owned(),
            Situation::Nothing(NoReading::OtherClock { .. }) => {
                "state=other_clock speed_percent=0".to_owned()
            }
            Situation::Nothing(NoReading::Bus(_)) => "state=bus speed_percent=0".to_owned(),
        };
        let Tally { states, missed, silences, restarts, .. } = *self;
        let p50_ns = self.p50_ns();
        format!(
            "at_ns={now_ns} {what} states={states} missed={missed} silences={silences} restarts={restarts} p50_ns={p50_ns}"
        )
    }
}

/// Prints the error while the bus cannot be read, when it begins or changes.
fn print_change(before: &mut Option<NoReading>, reading: &Result<Reading, NoReading>) {
    let now = reading.as_ref().err().filter(|reason| matches!(reason, NoReading::Bus(_)));
    if let Some(error) = now.filter(|error| before.as_ref() != Some(error)) {
        eprintln!("{error}");
    }
    *before = now.cloned();
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(station), Some(name)) = (arguments.next(), arguments.next()) else {
        return Err("usage: controller STATION NAME [SECONDS]".into());
    };
    let seconds = arguments.next().map(|text| text.parse::<f64>()).transpose()?;
    let end_ns = seconds.map_or(u64::MAX, |seconds| now_ns() + (1e9 * seconds) as u64);
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    let mut consumer = Consumer::join(&station, &name)?;
    if let Some(refusal) = consumer.report_refusal() {
        eprintln!("{refusal}; reading goes on");
    }
    let (mut tally, mut due_ns) = (Tally::default(), now_ns() + PRINT_EVERY_NS);
    let mut bus_error = None;
    while !stop.load(Ordering::Relaxed) && now_ns() < end_ns {
        let reading = consumer.next(TIMEOUT);
        print_change(&mut bus_error, &reading);
        let situation = match reading {
            Ok(reading) => {
                if !tally.enter(&reading) {
                    return Err(format!("an old state as new: cycle {}", reading.state.cycle).into());
                }
                let speed_percent = speed_percent(&reading.state);
                Situation::Current(Box::new(reading), speed_percent)
            }
            Err(reason) => {
                tally.silences += 1;
                Situation::Nothing(reason)
            }
        };
        // A real controller would command the speed here.
        if now_ns() >= due_ns {
            println!("{}", tally.line(&situation));
            due_ns += PRINT_EVERY_NS;
        }
    }
    let p50_ns = tally.p50_ns();
    let Tally { states, missed, silences, restarts, .. } = tally;
    println!("end states={states} missed={missed} silences={silences} restarts={restarts} p50_ns={p50_ns}");
    Ok(())
}
