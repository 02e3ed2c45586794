//! A made-up finding with plausible figures, of any length, for visual checks of reports and for tests of their
//! invariants.

use std::collections::BTreeMap;

use equipoise_discrepancy::block::Phase;
use equipoise_discrepancy::finding::{
    AxisGap, Candidate, Estimate, Finding, Gap, Generic, Named, SetAside, Suspicion, Verdict,
};
use equipoise_discrepancy::picture::{
    PhaseGap, Picture, PosePlot, PosePoint, PredictorPlot, PredictorPoint, Signal, SurpriseBin, TimePlot,
    TimePoint, Unseen, Whiteness, Window,
};
use equipoise_discrepancy::report::{Origin, Recording, Report};
use equipoise_discrepancy::session::Spans;

const BLOCK_S: f64 = 0.3;

/// Inputs of a report.
pub(crate) struct Sample {
    pub(crate) finding: Finding,
    pub(crate) picture: Picture,
    pub(crate) origin: Origin,
    pub(crate) toml: Option<String>,
}

impl Sample {
    pub(crate) fn report(&self) -> Report<'_> {
        let (finding, picture, origin) = (&self.finding, &self.picture, &self.origin);
        Report { finding, picture, origin, model_toml: self.toml.as_deref() }
    }
}

/// Reproducible pseudo-random numbers.
struct PseudoRandom(u64);

impl PseudoRandom {
    /// Approximately normal, σ 1.
    fn next(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }

    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// One block of made-up work.
struct WorkBlock {
    time_s: f64,
    still: bool,
    elevation_deg: f64,
    inclination_deg: f64,
    effect: [f64; 3],
    noise: [f64; 3],
}

const SIGMA: [f64; 3] = [2.6, 2.4, 3.1];

fn blocks(work_s: f64) -> Vec<WorkBlock> {
    let mut random = PseudoRandom(7);
    let mut sway = [0.0; 3];
    let mut pose = [20.0, 5.0];
    let mut goal = pose;
    (0..(work_s / BLOCK_S) as usize)
        .map(|n| {
            let time_s = 262.0 + n as f64 * BLOCK_S;
            if n % 23 == 0 {
                goal = [130.0 * random.uniform(), 55.0 * random.uniform()];
            }
            let far = (goal[0] - pose[0]).abs() + (goal[1] - pose[1]).abs();
            for (pose, goal) in pose.iter_mut().zip(goal) {
                *pose += 0.35 * (goal - *pose);
            }
            let noise = std::array::from_fn(|axis| {
                sway[axis] = 0.8 * sway[axis] + 0.6 * SIGMA[axis] * random.next();
                sway[axis]
            });
            let carried = n as f64 * BLOCK_S / work_s > 0.3;
            let reach = (pose[0].to_radians().sin() * 0.62 + pose[1].to_radians().sin() * 0.45) * 1000.0;
            let effect =
                if carried { [reach * 1.5 / 75.0 + 2.0, -3.6 - 0.02 * pose[0], 14.8] } else { [0.0; 3] };
            WorkBlock {
                time_s,
                still: far < 4.0,
                elevation_deg: pose[0],
                inclination_deg: pose[1],
                effect,
                noise,
            }
        })
        .collect()
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value * value, count + 1.0));
    f64::sqrt(sum / f64::max(count, 1.0))
}

fn autocorrelation(values: &[f64]) -> Vec<f64> {
    let power: f64 = values.iter().map(|value| value * value).sum();
    (1..=40)
        .map(|lag| values.iter().zip(values.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>() / power)
        .collect()
}

impl WorkBlock {
    fn before(&self, axis: usize) -> f64 {
        self.effect[axis] + self.noise[axis]
    }

    /// After a change that removes `fraction` of the effect.
    fn after(&self, axis: usize, fraction: f64) -> f64 {
        (1.0 - fraction) * self.effect[axis] + self.noise[axis]
    }
}

/// A load in the right hand from a third of the work on; the change removes `fraction` of it.
fn picture(work_s: f64, fraction: f64) -> Picture {
    let blocks = blocks(work_s);
    Picture {
        spans_s: Spans {
            identify: [12.0, 96.5],
            reference: Some([104.0, 255.0]),
            work: [262.0, 262.0 + work_s],
            found: true,
        },
        length_s: 268.0 + work_s,
        block_s: BLOCK_S,
        threshold_log_odds: 7.0,
        time: (0..3).map(|axis| time_plot(&blocks, fraction, axis)).collect(),
        pose: [(0, "right arm elevation"), (0, "trunk inclination"), (1, "right arm elevation")]
            .map(|(axis, feature)| pose_plot(&blocks, fraction, axis, feature))
            .into(),
        predictors: if fraction > 0.0 { vec![predictor_plot(&blocks)] } else { Vec::new() },
        whiteness: (0..3).map(|axis| whiteness(&blocks, fraction, axis)).collect(),
        surprise: surprise(&blocks, fraction),
        windows: vec![
            Window {
                from_s: 301.0,
                to_s: 309.5,
                signal: Signal::CopX,
                times_noise_before: 11.2,
                times_noise_after: 1.31,
            },
            Window {
                from_s: 331.5,
                to_s: 337.0,
                signal: Signal::Fz,
                times_noise_before: 4.6,
                times_noise_after: 1.22,
            },
        ],
        phases: (0..3).flat_map(|axis| phase_gaps(&blocks, fraction, axis)).collect(),
        unseen: Vec::new(),
    }
}

fn time_plot(blocks: &[WorkBlock], fraction: f64, axis: usize) -> TimePlot {
    let point = |block: &WorkBlock| TimePoint {
        time_s: block.time_s,
        still: block.still,
        before: block.before(axis),
        after: block.after(axis, fraction),
        noise_sigma: SIGMA[axis] * if block.still { 0.9 } else { 1.3 },
    };
    TimePlot { signal: Signal::ALL[axis], points: blocks.iter().map(point).collect() }
}

fn pose_plot(blocks: &[WorkBlock], fraction: f64, axis: usize, feature: &str) -> PosePlot {
    let value = |block: &WorkBlock| {
        if feature.starts_with("trunk") { block.inclination_deg } else { block.elevation_deg }
    };
    let point = |block: &WorkBlock| PosePoint {
        feature: value(block),
        before: block.before(axis),
        after: block.after(axis, fraction),
    };
    PosePlot {
        signal: Signal::ALL[axis],
        feature: feature.to_owned(),
        unit: "°",
        points: blocks.iter().map(point).collect(),
        noise_sigma: SIGMA[axis],
    }
}

/// The load against what remains of the CoP forwards.
fn predictor_plot(blocks: &[WorkBlock]) -> PredictorPlot {
    let point = |block: &WorkBlock| PredictorPoint { predicted: block.effect[0], residual: block.before(0) };
    let carried = blocks.iter().filter(|block| block.effect[0] != 0.0);
    PredictorPlot {
        effect: "hand_load right".to_owned(),
        signal: Signal::CopX,
        points: carried.map(point).collect(),
        noise_sigma: SIGMA[0],
    }
}

fn whiteness(blocks: &[WorkBlock], fraction: f64, axis: usize) -> Whiteness {
    let white = |colour: f64| -> Vec<f64> {
        let mut random = PseudoRandom(axis as u64 + 3);
        let value = |block: &WorkBlock| random.next() + colour * block.effect[axis] / SIGMA[axis];
        blocks.iter().map(value).collect()
    };
    Whiteness {
        signal: Signal::ALL[axis],
        before: autocorrelation(&white(1.0)),
        after: autocorrelation(&white(1.0 - fraction)),
        bound: 1.96 / (blocks.len() as f64).sqrt(),
    }
}

fn phase_gaps(blocks: &[WorkBlock], fraction: f64, axis: usize) -> [PhaseGap; 3] {
    let (floor, signal) = (SIGMA[axis], Signal::ALL[axis]);
    let gap = |phase, before: f64, after: f64| PhaseGap { phase, signal, before, after, noise_floor: floor };
    [
        gap(Phase::Identify, floor * 0.93, floor * 0.93),
        gap(Phase::Reference, floor * 1.04, floor * 1.04),
        gap(
            Phase::Work,
            rms(blocks.iter().map(|block| block.before(axis))),
            rms(blocks.iter().map(|block| block.after(axis, fraction))),
        ),
    ]
}

fn surprise(blocks: &[WorkBlock], fraction: f64) -> Vec<SurpriseBin> {
    let squares = |fraction: f64| -> Vec<f64> {
        let values =
            blocks.iter().map(|block| ((1.0 - fraction) * block.effect[0] + block.noise[0]) / SIGMA[0]);
        values.map(|value| value * value).collect()
    };
    let (before, after) = (squares(0.0), squares(fraction));
    let part = |values: &[f64], from: f64, to: f64| {
        values.iter().filter(|value| (from..to).contains(*value)).count() as f64 / values.len().max(1) as f64
    };
    let expected = [0.6827, 0.1600, 0.0740, 0.0378, 0.0201, 0.0254];
    (0..6)
        .map(|n| {
            let (from, to) = (n as f64, if n == 5 { f64::INFINITY } else { n as f64 + 1.0 });
            let [before, after] = [&before, &after].map(|values| part(values, from, to));
            SurpriseBin { from, to, before, after, expected: expected[n] }
        })
        .collect()
}

type Wanted = fn(&&TimePoint) -> bool;

fn gap(picture: &Picture) -> Gap {
    let mut per_axis = BTreeMap::new();
    for plot in &picture.time {
        let sets: [(&str, Wanted); 3] = [("", |_| true), ("_still", |p| p.still), ("_moving", |p| !p.still)];
        for (suffix, wanted) in sets {
            let of = |value: fn(&TimePoint) -> f64| rms(plot.points.iter().filter(wanted).map(value));
            let (before, after, noise_floor) = (of(|p| p.before), of(|p| p.after), of(|p| p.noise_sigma));
            let gap = AxisGap { before, after, noise_floor, unit: plot.signal.unit() };
            per_axis.insert(format!("{}{suffix}", plot.signal.axis()), gap);
        }
    }
    let both = |value: fn(&AxisGap) -> f64| value(&per_axis["x"]).hypot(value(&per_axis["y"]));
    let [before_mm, after_mm, noise_floor_mm] =
        [both(|a| a.before), both(|a| a.after), both(|a| a.noise_floor)];
    Gap { before_mm, after_mm, noise_floor_mm, held_out: true, per_axis }
}

fn origin() -> Origin {
    Origin {
        recordings: vec![Recording {
            name: "shift-morning.mcap".to_owned(),
            sha256: "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08".to_owned(),
        }],
        subject: "worker-07".to_owned(),
        station: "press-3".to_owned(),
        date: "2025-03-04T09:12:33Z".to_owned(),
        software: "equipoise 0.1.0".to_owned(),
        command: "equipoise reconcile shift-morning.mcap --out findings/shift-morning".to_owned(),
    }
}

fn candidate(name: &str, log_odds: f64) -> Candidate {
    Candidate { name: name.to_owned(), log_odds: Some(log_odds), probability: 0.0 }
}

fn set_aside(name: &str, log_odds: f64, why: &str) -> SetAside {
    SetAside { name: name.to_owned(), log_odds, why: why.to_owned() }
}

/// A load in the right hand is named.
pub(crate) fn named(work_s: f64) -> Sample {
    let picture = picture(work_s, 0.985);
    let from_s = 262.0 + 0.3 * work_s;
    let finding = Finding {
        verdict: Verdict::Named,
        decided: true,
        effects: vec![hand_load(from_s, 262.0 + work_s)],
        candidates: candidates(),
        set_aside: all_set_aside(),
        unexplained: Vec::new(),
        gap: gap(&picture),
        spans: vec![Suspicion {
            from_s,
            to_s: 262.0 + work_s,
            signal: "cop_x".to_owned(),
            while_: "both".to_owned(),
            segment: Some("RightForearm".to_owned()),
            times_noise: 5.7,
        }],
        ask_next: None,
        ask: None,
        model: Some("findings/shift-morning/model.toml".to_owned()),
    };
    let toml = "version = 1\n\n[provenance]\nrecording_sha256 = \"9f86d081884c7d65…\"\ndate = \"2025-03-04T09:12:33Z\"\n\n\
        [[effect]]\nname = \"hand_load\"\nwhere = { hand = \"right\" }\nspan_s = [289.0, 352.0]\nopen_ended = true\n\
        log_odds = 204.3\n\n[effect.parameters.mass_kg]\nvalue = 1.5134\nsigma = 0.0312\nunit = \"kg\"\n";
    Sample { finding, picture, origin: origin(), toml: Some(toml.to_owned()) }
}

/// The named effect.
fn hand_load(from_s: f64, to_s: f64) -> Named {
    let parameter = |value, sigma, unit| Estimate { value, sigma, unit };
    Named {
        name: "hand_load".to_owned(),
        place: BTreeMap::from([
            ("hand".to_owned(), "right".into()),
            ("from_s".to_owned(), from_s.into()),
            ("to_s".to_owned(), to_s.into()),
        ]),
        parameters: BTreeMap::from([
            ("mass_kg".to_owned(), parameter(1.5134, 0.0312, "kg")),
            ("mx_kg_m".to_owned(), parameter(0.0041, 0.0093, "kg m")),
        ]),
        log_odds: 204.3,
        probability: 0.981,
        runner_up: None,
        family: Vec::new(),
    }
}

fn candidates() -> Vec<Candidate> {
    vec![
        candidate("hand_load right", 204.3),
        candidate("worn_mass RightForearm", 181.9),
        candidate("hand_load both", 96.4),
        candidate("worn_mass RightUpperArm", 88.0),
        candidate("hand_contact right", 61.7),
        candidate("worn_mass T8", 40.2),
        candidate("force_gain", 33.8),
        candidate("plate_offset", 5.1),
        candidate("segment_misalignment RightUpperArm", 2.2),
        candidate("suit_lag", -2.9),
    ]
}

fn all_set_aside() -> Vec<SetAside> {
    vec![
        set_aside(
            "worn_mass RightForearm",
            181.9,
            "the elbow was bent often enough: at the forearm the mass fits worse",
        ),
        set_aside("force_gain", 33.8, "the mass is outside its place"),
        set_aside("hand_contact right", 61.7, "moves with the hand, as a weight does and a bench does not"),
        set_aside("plate_offset", 5.1, "below the negligible size"),
    ]
}

/// No effect is missing in the model.
pub(crate) fn none(work_s: f64) -> Sample {
    let mut sample = named(work_s);
    let picture = &mut sample.picture;
    let still_there = |p: &mut TimePoint| p.before = p.after;
    picture.time.iter_mut().flat_map(|plot| &mut plot.points).for_each(still_there);
    picture.pose.iter_mut().flat_map(|plot| &mut plot.points).for_each(|p| p.before = p.after);
    picture.phases.iter_mut().for_each(|gap| gap.before = gap.after);
    picture.predictors.clear();
    picture.whiteness.iter_mut().for_each(|each| each.before = each.after.clone());
    picture.surprise.iter_mut().for_each(|bin| bin.before = bin.after);
    picture.windows.clear();
    let unseen = |effect: &str, parameter: &str, at_most, unit| Unseen {
        effect: effect.to_owned(),
        parameter: parameter.to_owned(),
        at_most,
        unit,
    };
    picture.unseen = vec![
        unseen("hand_load right", "mass_kg", 0.14, "kg"),
        unseen("plate_yaw", "psi_rad", 0.012, "rad"),
        unseen("plate_gain", "kx", 0.009, ""),
    ];
    let finding = &mut sample.finding;
    finding.verdict = Verdict::None;
    finding.effects.clear();
    finding.candidates = vec![candidate("plate_yaw", 2.4), candidate("worn_mass Pelvis", 0.7)];
    finding.set_aside = vec![set_aside("plate_yaw", 2.4, "below the threshold of 7")];
    finding.spans.clear();
    finding.model = None;
    finding.gap = gap(&sample.picture);
    sample.toml = None;
    sample
}

/// The load may also be at the forearm.
pub(crate) fn ambiguous(work_s: f64) -> Sample {
    let mut sample = named(work_s);
    let finding = &mut sample.finding;
    finding.verdict = Verdict::Ambiguous;
    finding.effects[0].probability = 0.71;
    finding.effects[0].runner_up =
        Some(Candidate { probability: 0.27, ..candidate("worn_mass RightForearm", 181.9) });
    finding.effects[0].family = vec!["worn_mass RightForearm".to_owned()];
    finding.ask_next = Some(
        "Stand on the plate turned by 90° and hold for 5 s: the two then differ by 14 times noise."
            .to_owned(),
    );
    sample
}

/// The catalogue explains a part, and something remains.
pub(crate) fn unexplained(work_s: f64) -> Sample {
    let mut sample = named(work_s);
    sample.picture = picture(work_s, 0.6);
    let finding = &mut sample.finding;
    finding.verdict = Verdict::Unexplained;
    finding.gap = gap(&sample.picture);
    finding.unexplained = vec![Generic {
        what: "a heading error of the right forearm near (0.5, −0.4, 1.0) m".to_owned(),
        log_odds: 26.0,
    }];
    finding.ask_next = Some("Hold the right hand near (0.5, −0.4, 1.0) m, then 30 cm higher.".to_owned());
    sample
}
