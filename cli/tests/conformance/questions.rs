//! The checks, each performed in turn on one running device.

use std::sync::Arc;

use equipoise_simulator::faults::Faults;

use crate::cases::Case;
use crate::person::Person;
use crate::rig::Rig;

/// The checks, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Question {
    Rate,
    Truth,
    Loss,
    Garbage,
    Reasons,
    Reconnect,
    Monotone,
    Speed,
}

impl Question {
    pub(crate) const ALL: [Question; 8] = [
        Question::Rate,
        Question::Truth,
        Question::Loss,
        Question::Garbage,
        Question::Reasons,
        Question::Reconnect,
        Question::Monotone,
        Question::Speed,
    ];

    /// Title of its column.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Question::Rate => "sample rate",
            Question::Truth => "units and frame",
            Question::Loss => "loss counted",
            Question::Garbage => "over garbage",
            Question::Reasons => "bad input counted as",
            Question::Reconnect => "reconnects",
            Question::Monotone => "stamps rise",
            Question::Speed => "wrong speed named",
        }
    }
}

/// Text of a cell, or the failure.
pub(crate) type Answer = Result<String, String>;

/// Number of samples after which all pending ones have arrived.
const SETTLED: usize = 30;

/// Performs all checks; an error is one of the rig itself.
pub(crate) fn ask(case: &Case, person: &Arc<Person>) -> Result<Vec<(Question, Answer)>, String> {
    let mut rig = Rig::start(case, person)?;
    let mut answers = Vec::new();
    for question in Question::ALL {
        if case.reason_not_tested(question).is_some() {
            continue;
        }
        answers.push((
            question,
            match question {
                Question::Rate => rate(case, &mut rig),
                Question::Truth => truth(case, &mut rig),
                Question::Loss => loss(case, &mut rig),
                Question::Garbage => garbage(case, &mut rig),
                Question::Reasons => reasons(case, &mut rig),
                Question::Reconnect => reconnect(case, &mut rig),
                Question::Monotone => monotone(&rig),
                Question::Speed => speed(case, person),
            },
        ));
        // Without any sample, waiting for more is futile.
        if rig.samples.is_empty() {
            break;
        }
    }
    Ok(answers)
}

fn yes_unless(wrong: Option<String>) -> Answer {
    wrong.map_or_else(|| Ok("yes".into()), Err)
}

/// By the sample times: as many a second as the device measures. Without a disturbance no new session begins.
fn rate(case: &Case, rig: &mut Rig<'_>) -> Answer {
    rig.more("the first samples", SETTLED)?;
    let first = rig.samples.len();
    rig.more("samples of a second and a half", (case.rate_hz * 1.5) as usize)?;
    if rig.samples[first..].windows(2).any(|pair| pair[0].session() != pair[1].session()) {
        return Err("a session ends for no reason".into());
    }
    let timed: Vec<u64> = rig.samples[first..]
        .iter()
        .filter(|sample| sample.is_timed())
        .map(crate::host::Sample::time_ns)
        .collect();
    let [begin, .., end] = timed[..] else { return Err("no sample has a time".into()) };
    let hz = (timed.len() - 1) as f64 / ((end - begin) as f64 * 1e-9);
    let deviation = (hz / case.rate_hz - 1.0).abs();
    if deviation > 0.03 {
        Err(format!("{hz} Hz instead of {}", case.rate_hz))
    } else {
        Ok(format!("{} Hz", case.rate_hz))
    }
}

/// Every sample so far agrees with the person's truth: force, centre of pressure, free moment.
fn truth(case: &Case, rig: &mut Rig<'_>) -> Answer {
    let first = rig.samples.len();
    rig.more("samples to compare", (case.rate_hz * 0.5) as usize)?;
    yes_unless(rig.wrong_since(first.saturating_sub((case.rate_hz * 0.5) as usize)))
}

/// The lost count equals the packets lost on the connection.
fn loss(case: &Case, rig: &mut Rig<'_>) -> Answer {
    let (before, counts_before) = rig.lost();
    rig.set_faults(Faults { loss: case.loss, ..Faults::default() });
    rig.while_measured("samples of which some are lost", (case.rate_hz * 1.5) as u64)?;
    rig.until("a lost sample", |rig| rig.device.fault_counts().lost > counts_before.lost)?;
    rig.set_faults(Faults::default());
    // Enough for samples after the last lost one to arrive.
    rig.while_measured("samples behind the lost ones", (case.rate_hz * 0.25) as u64)?;
    rig.more("samples behind the lost ones", SETTLED)?;
    let (after, counts) = rig.lost();
    let (reported, is) = (after - before, counts.lost - counts_before.lost);
    if reported == is { Ok("yes".into()) } else { Err(format!("{reported} are reported, {is} were lost")) }
}

/// Samples after garbage are as accurate as before.
fn garbage(case: &Case, rig: &mut Rig<'_>) -> Answer {
    let before = rig.device.fault_counts().garbage;
    rig.set_faults(case.garbage);
    rig.until("garbage", |rig| rig.device.fault_counts().garbage > before)?;
    rig.while_measured("samples with garbage between them", (case.rate_hz * 1.5) as u64)?;
    rig.set_faults(Faults::default());
    // A truncated packet continues into the next.
    rig.while_measured("the end of the garbage", (case.rate_hz * 0.1) as u64 + 3)?;
    rig.more("samples after garbage", SETTLED)?;
    let first = rig.samples.len();
    rig.more("samples long after garbage", SETTLED)?;
    yes_unless(rig.wrong_since(first))
}

/// Each reason that the case expects was counted.
fn reasons(case: &Case, rig: &mut Rig<'_>) -> Answer {
    let refused = rig.host.refused();
    // For some noise the refusal reason is random.
    let counted =
        |reasons: &&str| reasons.split(" or ").any(|reason| refused.iter().any(|(name, _)| *name == reason));
    match case.reasons.iter().find(|reason| !counted(reason)) {
        Some(missing) => Err(format!("nothing was refused as {missing}, but {refused:?}")),
        None => Ok(case.reasons.join(", ")),
    }
}

/// After disconnection and reconnection it resumes with correct samples.
fn reconnect(case: &Case, rig: &mut Rig<'_>) -> Answer {
    rig.device.plug(false);
    rig.while_measured("its absence", (case.rate_hz * 0.7) as u64)?;
    rig.device.plug(true);
    rig.more("samples of a device that came back", SETTLED)?;
    let first = rig.samples.len();
    rig.more_timed("samples of a device that is back", SETTLED)?;
    yes_unless(rig.wrong_since(first))
}

/// No sample of a session is older than the previous one.
fn monotone(rig: &Rig<'_>) -> Answer {
    let timed: Vec<_> = rig.samples.iter().filter(|sample| sample.is_timed()).collect();
    let falls = timed
        .windows(2)
        .enumerate()
        .find(|(_, pair)| pair[1].session() == pair[0].session() && pair[1].time_ns() < pair[0].time_ns());
    yes_unless(falls.map(|(at, pair)| {
        format!("sample {at} of {}: {} ns back", timed.len(), pair[0].time_ns() - pair[1].time_ns())
    }))
}

/// A host at another baud rate receives noise, and its message suggests a wrong baud rate, the configured one, and the
/// usual one.
fn speed(case: &Case, person: &Arc<Person>) -> Answer {
    let baud = case.wrong_baud?;
    let keys = format!("[ground.serial]\nbaud = {baud}\n");
    let mut rig = Rig::start_with(case, person, |section| {
        // In place of the device's own.
        let lines = section.lines().filter(|line| !line.starts_with("baud ="));
        lines.map(|line| format!("{line}\n")).collect::<String>().replace("[ground.serial]\n", &keys)
    })?;
    rig.until("a word about the speed", |rig| rig.host.fault().is_some_and(|fault| fault.contains("baud")))?;
    if rig.samples.is_empty() { Ok("yes".into()) } else { Err("noise became samples".into()) }
}
