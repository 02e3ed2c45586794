//! A session as a recording: the samples of suit and plate in order of time.

use std::path::Path;

use bytemuck::Zeroable;
use equipoise_adapters::recording::{Recorder, RecordingHeader, WriteError};
use equipoise_core::body::Sex;
use equipoise_core::message::{GroundSample, SuitSample};
use equipoise_simulator::burden::Burden;
use equipoise_simulator::colour::{PlateColour, SuitColour, SuitColours};
use equipoise_simulator::dynamics::Wrench;
use equipoise_simulator::kinematics::centre_m;
use equipoise_simulator::noise::{PlateNoise, Suit};
use equipoise_simulator::random::Random;
use equipoise_simulator::realism::Realism;
use equipoise_simulator::scene::{Hidden, Scene, SensedPlate};
use nalgebra::Vector2;

use super::scenario::Script;
use crate::sensors::{EPOCH_NS, sample_time_ns};
use crate::subject::Subject;

/// Suit samples per second.
pub const SUIT_HZ: u32 = 60;
/// Plate samples per second.
pub const PLATE_HZ: u32 = 250;
/// 1-σ of every sample's time, ns.
const TIME_SIGMA_NS: u64 = 1_000;
/// Number of plate samples between evaluations of the hidden effect's size.
const LOOK_EVERY: u32 = 25;

/// Size of the coloured noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Coloured errors relative to the ordinary ones.
    pub factor: f64,
    /// Its name.
    pub name: &'static str,
}

impl Noise {
    /// Ordinary suits and plates.
    pub const ORDINARY: Noise = Noise { factor: 1.0, name: "ordinary" };
    /// A stress case: slow errors two and a half times as large.
    pub const COLOURED: Noise = Noise { factor: 2.5, name: "coloured" };
}

/// One session, ready to be recorded.
#[derive(Debug, Clone)]
pub struct Station {
    scene: Scene,
    plate: SensedPlate,
    length_s: f64,
}

impl Station {
    /// A script with hidden effects; the noise is independent of them, and before the experiments also of these.
    pub fn new(script: &Script, mut hidden: Hidden, noise: Noise, seed: u64) -> Station {
        let colours = SuitColours::ORDINARY.times(noise.factor);
        let (unasked_s, length_s) = (script.unasked_s + 1.0, script.length_s + 1.0);
        let mut suit_colour = SuitColour::new(colours, seed, unasked_s);
        suit_colour.extend(length_s);
        let suit = Suit::new(Realism::REALISTIC.suit_noise(), seed).with_colour(suit_colour);
        let mut colour = PlateColour::new(noise.factor, seed, unasked_s);
        colour.extend(seed, length_s);
        for (burden, _) in &mut hidden.burdens {
            if let Burden::Push(_, _, variation) = burden {
                variation.extend(&mut Random::new(seed, "push, continued"), length_s);
            }
        }
        let plate = SensedPlate::new(&hidden, colour, PlateNoise::ORDINARY, seed);
        Station {
            scene: Scene { worker: script.worker.clone(), suit, hidden },
            plate,
            length_s: script.length_s,
        }
    }

    /// Passes every sample to `take`, in order of time.
    ///
    /// # Errors
    /// The error of `take`.
    pub fn play<E>(&mut self, mut take: impl FnMut(Sample) -> Result<(), E>) -> Result<(), E> {
        let (mut suit, mut ground) = (0, 0);
        loop {
            let (suit_ns, ground_ns) = (sample_time_ns(suit, SUIT_HZ), sample_time_ns(ground, PLATE_HZ));
            let time_s = (suit_ns.min(ground_ns) - EPOCH_NS) as f64 * 1e-9;
            if time_s > self.length_s {
                return Ok(());
            }
            if ground_ns <= suit_ns {
                take(self.ground_sample(ground))?;
                ground += 1;
            } else {
                take(Sample::Suit(Box::new(self.suit_sample(suit))))?;
                suit += 1;
            }
        }
    }

    fn suit_sample(&self, number: u32) -> SuitSample {
        let time_ns = sample_time_ns(number, SUIT_HZ);
        let (origin_m, rotation) = self.scene.seen(f64::from(number) / f64::from(SUIT_HZ));
        // A suit's datagrams hold single precision.
        let single = |value: f64| f64::from(value as f32);
        SuitSample {
            sample_time_ns: time_ns,
            sample_time_sigma_ns: TIME_SIGMA_NS,
            arrival_ns: time_ns,
            published_ns: time_ns,
            sequence: u64::from(number) + 1,
            device_counter: number,
            device_time_ms: ((time_ns - EPOCH_NS) / 1_000_000) as u32,
            position_m: origin_m.map(|origin| [single(origin.x), single(origin.y), single(origin.z)]),
            orientation_wxyz: rotation.map(|q| [q.w, q.i, q.j, q.k].map(single)),
            ..Zeroable::zeroed()
        }
    }

    fn ground_sample(&mut self, number: u32) -> Sample {
        let (time_ns, time_s) = (sample_time_ns(number, PLATE_HZ), f64::from(number) / f64::from(PLATE_HZ));
        let faulty = self.plate.faulty(self.scene.ground_reaction(time_s), time_s);
        let published = self.plate.noisy(faulty, time_s, number);
        let message = GroundSample {
            sample_time_ns: time_ns,
            sample_time_sigma_ns: TIME_SIGMA_NS,
            arrival_ns: time_ns,
            published_ns: time_ns,
            sequence: u64::from(number) + 1,
            device_counter: number,
            force_n: published.force_n.into(),
            moment_nm: published.moment_nm.into(),
            ..Zeroable::zeroed()
        };
        Sample::Ground { message: Box::new(message), number, time_s, faulty }
    }

    /// Distance of the centre of pressure from the centre of mass caused by motion, m.
    fn motion_m(&self, time_s: f64) -> Vector2<f64> {
        let body = self.scene.body(time_s);
        let centre_m = centre_m(&self.scene.worker.person().segment_mass_kg, &body.com_m);
        self.scene.ground_reaction(time_s).cop_m() - centre_m.xy()
    }

    /// Centre of mass of the body by the suit's data, with the true masses, m.
    fn centre_seen_m(&self, time_s: f64) -> Vector2<f64> {
        let person = self.scene.worker.person();
        let (origin_m, rotation) = self.scene.seen(time_s);
        let com_m: Vec<_> =
            (0..origin_m.len()).map(|i| origin_m[i] + rotation[i] * person.com_m[i]).collect();
        centre_m(&person.segment_mass_kg, &com_m).xy()
    }
}

/// One sample.
#[derive(Debug)]
pub enum Sample {
    /// Of the suit.
    Suit(Box<SuitSample>),
    /// Of the plate.
    Ground {
        /// The message as published.
        message: Box<GroundSample>,
        /// Number of the sample.
        number: u32,
        /// Time, s.
        time_s: f64,
        /// Without the plate's noise.
        faulty: Wrench,
    },
}

/// Writes a session. Returns the size of the hidden effect in the work, mm ([`super::truth::Truth::effect_mm`]).
///
/// # Errors
/// The file exists or cannot be written.
pub fn write(
    path: &Path,
    config_toml: String,
    station: &mut Station,
    clean: &Station,
    (work_s, without_inertia): ([f64; 2], bool),
) -> Result<f64, WriteError> {
    let header = RecordingHeader {
        software_version: env!("CARGO_PKG_VERSION").to_owned(),
        started_unix_ns: 0,
        started_monotonic_ns: EPOCH_NS,
        config_toml,
        ..RecordingHeader::default()
    };
    let mut recorder = Recorder::create(path, &header)?;
    let mut looks: Vec<(f64, Vector2<f64>)> = Vec::new();
    station.play(|sample| match sample {
        Sample::Suit(message) => recorder.write(message.published_ns, &*message),
        Sample::Ground { message, number, time_s, faulty } => {
            if number % LOOK_EVERY == 0 && (work_s[0]..work_s[1]).contains(&time_s) {
                looks.push((time_s, faulty.cop_m()));
            }
            recorder.write(message.published_ns, &*message)
        }
    })?;
    recorder.finish()?;
    let square_m2: f64 = looks
        .iter()
        .map(|(time_s, cop_m)| {
            let with = cop_m - station.centre_seen_m(*time_s);
            let without = clean.scene.ground_reaction(*time_s).cop_m() - clean.centre_seen_m(*time_s);
            // For a model without inertia, the whole effect of motion is missing.
            if without_inertia { clean.motion_m(*time_s) } else { with - without }.norm_squared()
        })
        .sum();
    Ok(1e3 * (square_m2 / looks.len().max(1) as f64).sqrt())
}

/// The configuration in a recording: the station's data of worker, suit and plate.
pub fn config_toml(subject: &Subject, id: &str, poses_min: usize, without_inertia: bool) -> String {
    let sex = match subject.sex {
        Sex::Female => "female",
        Sex::Male => "male",
        Sex::Unstated => "unstated",
    };
    // Resolution of scales and measuring tapes.
    let (mass_kg, height_m) =
        ((subject.mass_kg * 10.0).round() / 10.0, (subject.height_m * 100.0).round() / 100.0);
    let motion = if without_inertia { "\n[overload]\nmotion = \"paper\"\n" } else { "" };
    format!(
        "station = \"bench\"\n\n[suit]\nsource = \"mvn-udp\"\n\n[ground]\nsource = \"ati-rdt\"\n\
         counts_per_newton = 1000000\ncounts_per_newton_metre = 1000000\n\n[subject]\nid = \"{id}\"\n\
         mass_kg = {mass_kg:.1}\nheight_m = {height_m:.2}\nsex = \"{sex}\"\nsave_profile = false\n\n\
         [identification]\nposes_min = {poses_min}\n{motion}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hidden::ladder::nominal;
    use crate::hidden::make::{Plan, draw};
    use crate::hidden::scenario::Experiment;
    use equipoise_core::cycle::{Inputs, Memory, Settings, Tick, step};
    use equipoise_core::message::{State, Validity};
    use equipoise_core::pose_suggestion::library::LIBRARY;
    use std::collections::BTreeSet;

    /// The loop's states over a session, each with its time.
    fn watch(plan: &Plan, hidden: Hidden, mut see: impl FnMut(f64, &State)) -> crate::hidden::make::Session {
        let session = draw(plan, true);
        let mut station = Station::new(&session.script, hidden, session.noise, plan.seed);
        let subject = session.subject;
        let settings = Settings {
            sex: subject.sex,
            mass_kg: Some(subject.mass_kg),
            library: LIBRARY,
            ..Settings::for_height(subject.height_m)
        };
        let mut memory = bytemuck::zeroed_box::<Memory>();
        memory.start(&settings);
        let mut cycle = 0;
        let mut pass = |due_ns: u64, suit: &[SuitSample], ground: &[GroundSample]| {
            cycle += 1;
            step(
                &settings,
                &mut memory,
                Tick { cycle, due_ns },
                Inputs { suit, ground, body: None, command: None },
            );
            see((memory.state.suit_sample_time_ns as f64 - EPOCH_NS as f64) * 1e-9, &memory.state);
        };
        station
            .play(|sample| {
                match sample {
                    Sample::Suit(sample) => pass(sample.published_ns, std::slice::from_ref(&sample), &[]),
                    Sample::Ground { message, .. } => {
                        pass(message.published_ns, &[], std::slice::from_ref(&message));
                    }
                }
                Ok::<(), ()>(())
            })
            .unwrap();
        session
    }

    fn plan(kind: &'static str, size: f64, seed: u64) -> Plan {
        Plan { session: "session".into(), kind, size, seed }
    }

    #[test]
    fn the_loop_learns_a_clean_session_s_worker_and_follows_the_steps() {
        for seed in [11, 12] {
            let plan = plan("clean", 1.0, seed);
            let work_s = draw(&plan, true).script.spans.work;
            let (mut square_m2, mut count, mut poses) = (0.0, 0.0, 0);
            let mut stances = BTreeSet::new();
            let session = watch(&plan, Hidden::default(), |time_s, state| {
                poses = state.poses_used;
                stances.insert(state.stance);
                let invalid = Validity::INVALIDATES_COP_MEASURED.and(Validity::INVALIDATES_COP_ESTIMATED);
                if !state.validity().any_of(invalid) && (work_s[0]..work_s[1]).contains(&time_s) {
                    let gap_m = Vector2::from(state.cop_measured_m) - Vector2::from(state.cop_estimated_m);
                    square_m2 += gap_m.norm_squared();
                    count += 1.0;
                }
            });
            let gap_mm = 1e3 * f64::sqrt(square_m2 / count);
            let steps = 2 * (session.script.places.len() - 1);
            assert!(poses >= 6 && (1.0..20.0).contains(&gap_mm), "seed {seed}: {poses} poses, {gap_mm} mm");
            assert!(stances.len() > steps, "seed {seed}: {} stances for {steps} steps", stances.len());
        }
    }

    #[test]
    fn a_recording_differs_from_its_clean_twin_by_what_the_truth_says_and_by_nothing_else() {
        let plan = plan("plate_offset", 2.0, 21);
        let session = draw(&plan, true);
        let effect = &session.drawn.effects[0];
        let by_m = Vector2::new(effect.parameters["dx_m"], effect.parameters["dy_m"]);
        assert!((by_m.norm() - 2.0 * 1e-3 * nominal("plate_offset")).abs() < 1e-12);
        let all = |hidden: Hidden| {
            let mut samples = Vec::new();
            let mut station = Station::new(&session.script, hidden, session.noise, plan.seed);
            let keep = |sample| {
                samples.push(sample);
                Ok::<(), ()>(())
            };
            station.play(keep).unwrap();
            samples
        };
        let (hidden, clean) = (all(session.drawn.hidden.clone()), all(Hidden::default()));
        assert_eq!(hidden.len(), clean.len());
        let (mut with, mut without) = (0, 0);
        for pair in hidden.iter().zip(&clean) {
            match pair {
                (Sample::Suit(one), Sample::Suit(other)) => assert_eq!(one, other),
                (Sample::Ground { message, time_s, .. }, Sample::Ground { message: other, .. }) => {
                    assert_eq!(message.force_n, other.force_n);
                    let [one, other] =
                        [message, other].map(|message| Vector2::from(message.cop_m().unwrap()));
                    let within = |from_s: f64, to_s: f64| (from_s..=to_s).contains(time_s);
                    if within(effect.span_s[0] + 1.0, effect.span_s[1] - 1.0) && effect.flips_at_s.is_none() {
                        with += 1;
                        // The white noise of the force is not shifted with it: some 3 N of 600, to 2 σ.
                        assert!(
                            (one - other - by_m).norm() < 1e-2 * by_m.norm(),
                            "{time_s} s: {:?}",
                            one - other
                        );
                    } else if !within(effect.span_s[0], effect.span_s[1]) {
                        without += 1;
                        assert_eq!(one, other, "{time_s} s");
                    }
                }
                _ => panic!("the streams lie otherwise"),
            }
        }
        assert!(with > 1000 && (without > 1000 || effect.from_beginning), "{with} {without}");
    }

    #[test]
    fn an_experiment_continues_the_recording_and_changes_nothing_before() {
        let plan = plan("hand_contact", 2.0, 22);
        let session = draw(&plan, true);
        let ask = Experiment { turn_deg: 90.0, poses: vec![LIBRARY[5].name.into()], ..Experiment::default() };
        let longer = session.script.clone().continued(&ask);
        assert!(longer.length_s > session.script.length_s + 8.0, "{} s", longer.length_s);
        let samples = |script: &Script| {
            let mut samples = Vec::new();
            let mut station = Station::new(script, session.drawn.hidden.clone(), session.noise, plan.seed);
            let keep = |sample| {
                samples.push(match sample {
                    Sample::Suit(message) => bytemuck::bytes_of(&*message).to_vec(),
                    Sample::Ground { message, .. } => bytemuck::bytes_of(&*message).to_vec(),
                });
                Ok::<(), ()>(())
            };
            station.play(keep).unwrap();
            samples
        };
        let (before, after) = (samples(&session.script), samples(&longer));
        // Accelerations are differences of positions, so that the last instants depend on what follows.
        let settled = before.len() - (SUIT_HZ + PLATE_HZ) as usize / 20;
        let differs = before[..settled].iter().zip(&after).position(|(one, other)| one != other);
        assert_eq!(differs, None, "of {} samples", before.len());
        assert!(after.len() > before.len() + 8 * (SUIT_HZ + PLATE_HZ) as usize);
        let last = longer.places.last().unwrap();
        assert!((last.heading_deg - session.script.places.last().unwrap().heading_deg - 90.0).abs() < 1e-9);
    }

    #[test]
    fn what_is_hidden_in_the_suit_leaves_the_plate_alone_and_turns_only_its_segment() {
        let plan = plan("segment_heading T8", 4.0, 5);
        let session = draw(&plan, true);
        let radians = session.drawn.effects[0].parameters["psi_rad"];
        let station = |hidden| Station::new(&session.script, hidden, session.noise, plan.seed);
        let (hidden, clean) = (station(session.drawn.hidden.clone()), station(Hidden::default()));
        let span_s = session.drawn.effects[0].span_s;
        let number = ((span_s[0] + 2.0) * f64::from(SUIT_HZ)) as u32;
        let (seen, without) = (hidden.suit_sample(number), clean.suit_sample(number));
        let turn = |sample: &SuitSample, i: usize| {
            let [w, x, y, z] = sample.orientation_wxyz[i];
            nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z))
        };
        for segment in equipoise_core::body::Segment::ALL {
            let i = segment.index();
            let angle = turn(&seen, i).angle_to(&turn(&without, i));
            let expected = if segment == equipoise_core::body::Segment::T8 { radians.abs() } else { 0.0 };
            assert!((angle - expected).abs() < 2e-3, "{segment:?}: {angle}");
        }
        // Everything distal to the rotated trunk moves with it; the feet stay.
        let hand = equipoise_core::body::Segment::LeftHand.index();
        assert_ne!(seen.position_m[hand], without.position_m[hand]);
    }
}
