//! Generates sessions: a recording each, and a separate file with the truth.

use std::path::{Path, PathBuf};

use equipoise_simulator::motion::Habits;
use equipoise_simulator::random::Random;

use super::effects::{Circumstances, Drawn};
use super::ladder::{self, RUNGS};
use super::recording::{self, Noise, Station};
use super::scenario::{self, Experiment, Lengths};
use super::truth::Truth;
use crate::subject::{Subject, map_in_parallel};

/// An order for sessions.
#[derive(Debug, Clone)]
pub struct Order {
    /// Destination folder.
    pub out: PathBuf,
    /// Number of sessions.
    pub sessions: usize,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Only kinds whose name starts with this.
    pub only: Option<String>,
    /// Short sessions.
    pub fast: bool,
    /// Also the same sessions without a hidden effect, in `twins`.
    pub twins: bool,
}

/// Plan of one session: kind, size and seed.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Name of the recording without its ending.
    pub session: String,
    /// One of [`ladder::deck`].
    pub kind: &'static str,
    /// One of [`RUNGS`].
    pub size: f64,
    /// Seed of the session.
    pub seed: u64,
}

/// Plans of an order: every kind once before any twice, sizes in turn, all by the seed.
///
/// # Errors
/// No kind's name starts as requested.
pub fn plans(order: &Order) -> Result<Vec<Plan>, String> {
    let wanted = |kind: &&str| order.only.as_deref().is_none_or(|only| kind.starts_with(only));
    let deck: Vec<&'static str> = ladder::deck().into_iter().filter(wanted).collect();
    if deck.is_empty() {
        let kinds = ladder::deck().join(", ");
        return Err(format!(
            "no kind starts with `{}`; available: {kinds}",
            order.only.as_deref().unwrap_or("")
        ));
    }
    let first_rung: Vec<usize> = (0..deck.len())
        .map(|card| {
            let mut random = Random::numbered(order.seed, "first rung", card as u32);
            random.between(0.0, RUNGS.len() as f64) as usize
        })
        .collect();
    let mut dealt = Vec::new();
    for round in 0.. {
        let mut random = Random::numbered(order.seed, "deck", round);
        let mut cards: Vec<(usize, &'static str)> = deck.iter().copied().enumerate().collect();
        for index in 0..cards.len() {
            let other = index + random.between(0.0, (cards.len() - index) as f64) as usize;
            cards.swap(index, other);
        }
        // Each kind passes all rungs before a repetition, and starts on one that the seed chooses.
        dealt.extend(
            cards
                .into_iter()
                .map(|(card, kind)| (kind, RUNGS[(first_rung[card] + round as usize) % RUNGS.len()])),
        );
        if dealt.len() >= order.sessions {
            break;
        }
    }
    dealt.truncate(order.sessions);
    let plan = |(index, (kind, size)): (usize, (&'static str, f64))| Plan {
        session: format!("session-{:04}", index + 1),
        kind,
        size,
        seed: order.seed.wrapping_mul(1_000_003).wrapping_add(index as u64),
    };
    Ok(dealt.into_iter().enumerate().map(plan).collect())
}

/// Generates all sessions, each continued by experiments, in parallel on all processors; `done` is called for each.
///
/// # Errors
/// A message: a folder or file cannot be written, or a name is unknown.
pub fn make(
    order: &Order,
    experiments: &[Experiment],
    done: impl Fn(&Truth) + Sync,
) -> Result<Vec<Truth>, String> {
    let plans = plans(order)?;
    prepare(order)?;
    let made = map_in_parallel(&plans, |plan| {
        let truth = make_one(plan, order, experiments)?;
        done(&truth);
        Ok(truth)
    });
    made.into_iter().collect()
}

/// Makes the folders.
///
/// # Errors
/// A message: one cannot be made.
pub fn prepare(order: &Order) -> Result<(), String> {
    let twins = order.twins.then(|| order.out.join("twins"));
    for folder in [Some(order.out.join("truth")), twins].into_iter().flatten() {
        std::fs::create_dir_all(&folder)
            .map_err(|error| format!("cannot make {}: {error}", folder.display()))?;
    }
    Ok(())
}

/// Makes one session, continued by experiments.
///
/// # Errors
/// A message: a file exists or cannot be written.
pub fn make_one(plan: &Plan, order: &Order, experiments: &[Experiment]) -> Result<Truth, String> {
    let Session { subject, noise, script, mut drawn, reports_reference } = draw(plan, order.fast);
    let without_s = script.length_s;
    let script = experiments.iter().fold(script, scenario::Script::continued);
    for effect in drawn.effects.iter_mut().filter(|effect| effect.span_s[1] >= without_s) {
        effect.span_s[1] = script.length_s;
    }
    let clean = Station::new(&script, Default::default(), noise, plan.seed);
    let mut station = Station::new(&script, drawn.hidden.clone(), noise, plan.seed);
    // Slightly fewer poses than there are, so that identification has ended when free work begins.
    let poses_min = if order.fast { 6 } else { 12 };
    let config =
        |without_inertia| recording::config_toml(&subject, &plan.session, poses_min, without_inertia);
    let in_folder = |folder: &Path| folder.join(format!("{}.mcap", plan.session));
    let written = |error: equipoise_adapters::recording::WriteError| error.to_string();
    let path = in_folder(&order.out);
    let effect_mm = recording::write(
        &path,
        config(drawn.without_inertia),
        &mut station,
        &clean,
        (script.spans.work, drawn.without_inertia),
    )
    .map_err(written)?;
    if order.twins {
        let path = in_folder(&order.out.join("twins"));
        recording::write(&path, config(false), &mut clean.clone(), &clean, (script.spans.work, false))
            .map_err(written)?;
    }
    let truth = Truth {
        session: plan.session.clone(),
        seed: plan.seed,
        kind: plan.kind.to_owned(),
        noise: noise.name.to_owned(),
        height_m: subject.height_m,
        mass_kg: subject.mass_kg,
        spans: script.spans,
        reports_reference,
        length_s: script.length_s,
        places: script.places,
        turned: script.turned,
        effects: drawn.effects,
        effect_mm,
    };
    let path = order.out.join("truth").join(format!("{}.json", plan.session));
    let text = serde_json::to_string_pretty(&truth).map_err(|error| error.to_string())?;
    std::fs::write(&path, text + "\n")
        .map_err(|error| format!("cannot write {}: {error}", path.display()))?;
    Ok(truth)
}

/// All random choices of a session.
#[derive(Debug, Clone)]
pub struct Session {
    /// The subject.
    pub subject: Subject,
    /// Size of the sensors' coloured errors.
    pub noise: Noise,
    /// The activity.
    pub script: scenario::Script,
    /// The hidden effects.
    pub drawn: Drawn,
    /// Whether the program receives the reference span.
    pub reports_reference: bool,
}

/// Draws a session.
pub fn draw(plan: &Plan, fast: bool) -> Session {
    let lengths = if fast { Lengths::FAST } else { Lengths::ORDINARY };
    let subject = Subject::random(plan.seed);
    let mut random = Random::new(plan.seed, "hidden");
    let noise = if plan.kind.ends_with("coloured") { Noise::COLOURED } else { Noise::ORDINARY };
    // Respiration of half a millimetre at the plate.
    let habits = Habits { breathing_m: 0.0015, breathing_hz: random.between(0.2, 0.33), ..subject.habits() };
    let script = scenario::play(&subject, habits, &lengths);
    let person = subject.person();
    let at = Circumstances { person: &person, spans: &script.spans, length_s: script.length_s };
    let drawn = ladder::draw(plan.kind, plan.size, &mut random, &at);
    let known = !drawn.effects.iter().any(|effect| effect.from_beginning);
    let reports_reference = known && !random.happens(0.25);
    Session { subject, noise, script, drawn, reports_reference }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    fn order(out: PathBuf, sessions: usize) -> Order {
        Order { out, sessions, seed: 3, only: None, fast: true, twins: false }
    }

    #[test]
    fn every_kind_comes_once_before_any_comes_twice_and_climbs_all_rungs() {
        let plans = plans(&order(PathBuf::new(), 160)).unwrap();
        let first: BTreeSet<&str> = plans[..40].iter().map(|plan| plan.kind).collect();
        assert_eq!(first, ladder::deck().into_iter().collect());
        for kind in ladder::CATALOGUE {
            let sizes: BTreeSet<u64> =
                plans.iter().filter(|plan| plan.kind == kind).map(|plan| (plan.size * 10.0) as u64).collect();
            assert_eq!(sizes.len(), RUNGS.len(), "{kind}");
        }
        // Short benches of several seeds, too.
        let short = |seed| super::plans(&Order { seed, ..order(PathBuf::new(), 80) }).unwrap();
        let all: Vec<Plan> = (1..=20).flat_map(short).collect();
        for kind in ladder::deck() {
            let sizes: BTreeSet<u64> =
                all.iter().filter(|plan| plan.kind == kind).map(|plan| (plan.size * 10.0) as u64).collect();
            assert_eq!(sizes.len(), RUNGS.len(), "{kind}, 20 seeds");
        }
        let seeds: BTreeSet<u64> = plans.iter().map(|plan| plan.seed).collect();
        assert_eq!(seeds.len(), 160);
        let shorter = super::plans(&order(PathBuf::new(), 20)).unwrap();
        assert_eq!(plans[..20], shorter[..]);
    }

    #[test]
    fn an_unknown_kind_is_named_with_those_there_are() {
        let wrong = Order { only: Some("plate_jaw".into()), ..order(PathBuf::new(), 1) };
        let sentence = plans(&wrong).unwrap_err();
        assert!(sentence.contains("plate_jaw") && sentence.contains("plate_yaw"), "{sentence}");
    }

    #[test]
    fn every_hidden_effect_is_in_the_truth_file_and_in_the_simulation() {
        for (index, kind) in ladder::deck().into_iter().enumerate() {
            for size in RUNGS {
                let plan = Plan { session: "s".into(), kind, size, seed: index as u64 };
                let drawn = draw(&plan, true).drawn;
                let hidden = &drawn.hidden;
                let things = hidden.burdens.len()
                    + hidden.changes.len()
                    + hidden.suit.len()
                    + hidden.suit_lag_s.len()
                    + hidden.plate.len()
                    + usize::from(drawn.without_inertia);
                let published = drawn.effects.len();
                let expected = if kind == "pair" { 2 } else { usize::from(!kind.starts_with("clean")) };
                assert_eq!(published, expected, "{kind}");
                assert!(if expected == 0 { things == 0 } else { things >= published }, "{kind}: {things}");
                for effect in &drawn.effects {
                    assert!(effect.is_in_catalogue() != kind.starts_with("outside"));
                    assert!(effect.span_s[1] - effect.span_s[0] > 10.0, "{effect:?}");
                    assert!(effect.parameters.is_empty() != effect.is_in_catalogue(), "{effect:?}");
                }
            }
        }
    }

    #[test]
    fn the_same_order_makes_the_same_files() {
        let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        for folder in &folders {
            let order = Order { twins: true, ..order(folder.path().to_owned(), 1) };
            let truths = make(&order, &[], |_| {}).unwrap();
            assert!(truths[0].effects.is_empty() || truths[0].effect_mm > 0.0);
        }
        let names = ["session-0001.mcap", "twins/session-0001.mcap", "truth/session-0001.json"];
        let read = |k: usize| names.map(|name: &str| std::fs::read(folders[k].path().join(name)).unwrap());
        assert!(read(0) == read(1));
    }
}
