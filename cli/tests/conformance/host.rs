//! The host side: the daemon's sources, opened from a configuration, and their samples compared with the truth.

use equipoise_adapters::ground::GroundRefusal;
use equipoise_adapters::source::SuitSource;
use equipoise_adapters::suit::SuitRefusal;
use equipoise_config::Config;
use equipoise_core::message::{AdapterHealth, Component, FootFrame, GroundSample, SuitSample};
use equipoise_daemon::sensors::Ground;
use equipoise_simulator::devices::load::OnFeet;
use equipoise_simulator::suit_sender::Streams;

use crate::person::Person;

/// A station's configuration with one tested section; the other side is external.
fn whole(section: &str) -> String {
    let rest = if section.starts_with("[suit]") {
        "[ground]\nsource = \"external\"\n"
    } else {
        // A LabAmp at 1 kHz collects its scans for 100 ms; the daemon would reject that next to a suit without delay.
        "[suit]\nsource = \"external\"\nlatency_ms = 60.0\n"
    };
    format!("station = \"conformance\"\n{rest}[subject]\nid = \"anon-1\"\nheight_m = 1.77\n{section}")
}

/// A source of either kind.
pub(crate) enum Host {
    Ground(Ground),
    Suit(Box<SuitSource>),
}

impl Host {
    /// Opens the source that a section configures.
    pub(crate) fn open(section: &str) -> Result<Host, String> {
        let text = whole(section);
        let config = Config::parse(&text, "conformance.toml").map_err(|error| format!("{error}\n{text}"))?;
        if section.starts_with("[suit]") {
            let settings = config.suit.mvn_settings().map_err(|error| error.to_string())?;
            let source = SuitSource::open(&settings).map_err(|error| error.to_string())?;
            return Ok(Host::Suit(Box::new(source)));
        }
        Ok(Host::Ground(Ground::open(&config.ground).map_err(|error| error.to_string())?))
    }

    /// Samples that arrive within a short time.
    pub(crate) fn receive(&mut self) -> Result<Vec<Sample>, String> {
        match self {
            Host::Ground(source) => {
                let mut samples = Vec::new();
                source.receive(&mut samples).map_err(|error| error.to_string())?;
                Ok(samples.into_iter().map(Sample::Ground).collect())
            }
            Host::Suit(source) => {
                let sample = source.receive().map_err(|error| error.to_string())?;
                Ok(sample.into_iter().map(|sample| Sample::Suit(Box::new(sample))).collect())
            }
        }
    }

    /// Refused samples, by reason, and lost ones, as published on the bus.
    pub(crate) fn health(&mut self) -> AdapterHealth {
        match self {
            Host::Ground(source) => source.health(),
            Host::Suit(source) => source.health(),
        }
    }

    /// Names of the refusal reasons that occurred, with their counts, in their order.
    pub(crate) fn refused(&mut self) -> Vec<(&'static str, u64)> {
        let counts = self.health().refused;
        let names: Vec<&'static str> = match self {
            Host::Ground(_) => GroundRefusal::ALL.iter().map(|reason| reason.name()).collect(),
            Host::Suit(_) => SuitRefusal::ALL.iter().map(|reason| reason.name()).collect(),
        };
        names.into_iter().zip(counts).filter(|(_, count)| *count > 0).collect()
    }

    /// Its present fault message.
    pub(crate) fn fault(&self) -> Option<String> {
        match self {
            Host::Ground(source) => source.fault(),
            Host::Suit(_) => None,
        }
    }
}

/// A received sample.
#[derive(Debug)]
pub(crate) enum Sample {
    Ground(GroundSample),
    Suit(Box<SuitSample>),
}

/// Tolerance of a sample: force (N), centre of pressure or position (m).
pub(crate) struct Tolerance {
    pub(crate) force_n: f64,
    pub(crate) cop_m: f64,
    /// Each foot must be reported separately.
    pub(crate) feet: bool,
}

/// Single precision on the wire, and the person's rotation within a sample time error of 1 ms.
const TURN_RAD: f64 = 0.01;

impl Sample {
    pub(crate) fn time_ns(&self) -> u64 {
        match self {
            Sample::Ground(sample) => sample.sample_time_ns,
            Sample::Suit(sample) => sample.sample_time_ns,
        }
    }

    /// Whether its time is that of a fitted clock.
    pub(crate) fn is_timed(&self) -> bool {
        match self {
            Sample::Ground(sample) => sample.sample_time_sigma_ns != u64::MAX,
            Sample::Suit(sample) => sample.sample_time_sigma_ns != u64::MAX,
        }
    }

    pub(crate) fn session(&self) -> u32 {
        match self {
            Sample::Ground(sample) => sample.session,
            Sample::Suit(sample) => sample.session,
        }
    }

    /// Its deviation from the truth at its own sample time.
    pub(crate) fn wrong(&self, person: &Person, start_ns: u64, tolerance: &Tolerance) -> Option<String> {
        let time_s = (self.time_ns() as f64 - start_ns as f64) * 1e-9;
        match self {
            Sample::Ground(sample) => ground_wrong(sample, person, time_s, tolerance),
            Sample::Suit(sample) => {
                let truth = person.suit_frame(Streams::NONE, time_s, 0, 0);
                let deviation = (sample.position_m.iter().flatten())
                    .zip(truth.position_m.iter().flatten())
                    .map(|(sent, truth)| (sent - truth).abs())
                    .fold(0.0, f64::max);
                if deviation > tolerance.cop_m {
                    return Some(format!("a segment is {deviation} m off"));
                }
                let turned = (sample.orientation_wxyz.iter())
                    .zip(&truth.orientation_wxyz)
                    .map(|(sent, truth)| turn_rad(sent, truth))
                    .fold(0.0, f64::max);
                (turned > TURN_RAD).then(|| format!("a segment is turned by {turned} rad"))
            }
        }
    }
}

/// The angle between two orientations, rad.
fn turn_rad(one: &[f64; 4], other: &[f64; 4]) -> f64 {
    let cosine: f64 = one.iter().zip(other).map(|(a, b)| a * b).sum();
    2.0 * cosine.abs().min(1.0).acos()
}

fn ground_wrong(
    sample: &GroundSample,
    person: &Person,
    time_s: f64,
    tolerance: &Tolerance,
) -> Option<String> {
    let truth = person.on_feet(time_s);
    if tolerance.feet && sample.per_foot != 1 {
        return Some("the feet are not reported separately".into());
    }
    if !sample.measures(Component::Shear) && sample.per_foot == 1 {
        if sample.measures(Component::Tilt) || sample.measures(Component::FreeMoment) {
            return Some("insoles that say they measure more than what presses on each foot".into());
        }
        return feet_wrong(sample, &truth, tolerance);
    }
    let whole = truth.whole();
    for axis in 0..3 {
        let force_n = sample.force_n[axis];
        let measured = axis == 2 || sample.measures(Component::Shear);
        if measured && (force_n - whole.force_n[axis]).abs() > tolerance.force_n {
            return Some(format!("force {:?}, truth {:?}", sample.force_n, whole.force_n));
        }
    }
    let cop = match sample.cop_m() {
        Ok(cop) => cop,
        Err(reason) => return Some(format!("no centre of pressure: {reason:?}")),
    };
    let deviation = (nalgebra::Vector2::from(cop) - whole.cop_m()).norm();
    if deviation > tolerance.cop_m {
        return Some(format!("pressure at {cop:?}, truth {:?}", whole.cop_m()));
    }
    // The moment about the vertical through the centre of pressure.
    let turn =
        |force: [f64; 3], moment_z: f64, cop: [f64; 2]| moment_z - (cop[0] * force[1] - cop[1] * force[0]);
    let sent = turn(sample.force_n, sample.moment_nm[2], cop);
    let is = turn(whole.force_n.into(), whole.moment_nm.z, whole.cop_m().into());
    if sample.measures(Component::FreeMoment) && (sent - is).abs() > 0.5 {
        return Some(format!("turn {sent}, truth {is}"));
    }
    (sample.per_foot == 1).then(|| feet_wrong(sample, &truth, tolerance)).flatten()
}

/// Each foot's force and centre of pressure, in the frame that the sample names.
fn feet_wrong(sample: &GroundSample, truth: &OnFeet, tolerance: &Tolerance) -> Option<String> {
    for (k, sole) in truth.soles.iter().enumerate() {
        let wrench = &truth.wrench[k];
        let is_m = if sample.foot_frame == FootFrame::Insole as u32 { sole.cop_m } else { wrench.cop_m() };
        let (force_n, cop_m) = (sample.foot_vertical_n[k], sample.foot_cop_m[k]);
        let deviation_m = (nalgebra::Vector2::from(cop_m) - is_m).norm();
        if (force_n - wrench.force_n.z).abs() > tolerance.force_n || deviation_m > tolerance.cop_m {
            return Some(format!(
                "foot {k}: {force_n} N at {cop_m:?}, truth {} N at {is_m:?}",
                wrench.force_n.z
            ));
        }
    }
    None
}
