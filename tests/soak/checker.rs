//! Checks that every value reported as valid is true.
//!
//! The simulator's truth is queried at the state's sample time. The clock fit between device time and host time has a
//! limited accuracy: the core accepts time errors up to 20 ms. A value is therefore wrong if it deviates by more than 6
//! σ, by the state's own σ, plus a floor from the truth of *every* instant within 20 ms. The floors cover errors
//! without a σ: the suit's own errors, which displace a hand by centimetres, and the load fractions of hands and feet.

use std::collections::BTreeMap;

use bytemuck::Zeroable;
use equipoise_core::body::{JOINTS, Joint, SEGMENTS, Segment};
use equipoise_core::message::layout::{Message, Primitive};
use equipoise_core::message::{State, Validity};
use equipoise_simulator::simulation::SimulationHandle;
use equipoise_simulator::truth::Truth;
use nalgebra::{Vector2, Vector3};

/// Errors beyond this many σ are not due to chance.
const SIGMAS: f64 = 6.0;
/// `CLOCK_SIGMA_MAX_NS` of the core.
const DATED_WITHIN_S: f64 = 0.020;
/// Floors, m, N, kg, N m.
const COP_FLOOR_M: f64 = 0.020;
const COM_FLOOR_M: f64 = 0.060;
const SEGMENT_FLOOR_M: f64 = 0.25;
const FORCE_FLOOR_N: f64 = 25.0;
const MASS_FLOOR_KG: f64 = 2.0;
const TORQUE_FLOOR_NM: f64 = 10.0;
const BACK_FLOOR_NM: f64 = 10.0;
/// Weight of the simulated person, N.
const BODY_N: f64 = 72.0 * 9.81;
const COMPRESSION_FLOOR_N: f64 = BACK_FLOOR_NM / EXTENSOR_LEVER_M;
/// Lever of the back's extensors about L5/S1 in the cantilever model of Chaffin, Andersson & Martin, m.
const EXTENSOR_LEVER_M: f64 = 0.06;
/// Silence that must have been reported: two periods of the slowest stream that the faults may have established, the
/// tolerance, and, for values of the suit, its wait for the plate and half a window.
const SILENT_AT_MOST_NS: [u64; 2] = [350_000_000, 250_000_000];
/// Tolerance of sample times against the newest sent one, since they are readings of two clocks.
const AHEAD_AT_MOST_NS: u64 = 25_000_000;

/// Values that must have been checked, in at least one of this many states since identification. Faults invalidate the
/// rest.
const VALUES: [&str; 10] = [
    "measured cop",
    "ground force",
    "com",
    "estimated cop",
    "segments",
    "external force",
    "lifted mass",
    "torques",
    "low back",
    "compression",
];
const CHECKED_ONE_IN: u64 = 5;
/// Fraction of the bound from which the report includes the other published values.
const CONTEXT_ABOVE: f64 = 0.8;
/// At most one of this many states may be missed by the test's subscriber.
const MISSED_ONE_IN: u64 = 50;

/// Time the clock fit takes to recover after the sensors were delayed: a break must last a second before it counts as
/// one.
const HELD_UP_FOR_NS: u64 = 3_000_000_000;

/// The streams that a value depends on: suit, ground.
type Needs = [bool; 2];
const SUIT: Needs = [true, false];
const GROUND: Needs = [false, true];
const BOTH: Needs = [true, true];

/// One value that was wrong.
#[derive(Debug, Clone)]
pub(crate) struct Wrong {
    pub(crate) what: &'static str,
    during: &'static str,
    cycle: u64,
    error: f64,
    bound: f64,
    /// Other reported values, and the invalid reasons raised.
    context: String,
}

/// The largest ratio of a value's error to its bound.
struct Worst {
    bound_ratio: f64,
    during: &'static str,
    /// As for a wrong value, if the ratio is large enough.
    context: String,
}

/// Checks every state.
pub(crate) struct Checker {
    pub(crate) state: State,
    pub(crate) during: &'static str,
    pub(crate) states: u64,
    pub(crate) missed: u64,
    /// States received while a simulated sensor was delayed by the host, or just after; suit, ground.
    pub(crate) excluded: [u64; 2],
    held_up: [bool; 2],
    /// Invalid reason required in every state at present.
    pub(crate) required_reason: Option<Validity>,
    pub(crate) published: BTreeMap<&'static str, u64>,
    worst: BTreeMap<&'static str, Worst>,
    pub(crate) wrong: Vec<Wrong>,
    truths: (u64, Vec<Truth>),
    worst_joint: usize,
    /// σ of the estimated centre of pressure when it was last published, m.
    com_sigma_m: f64,
}

impl Checker {
    pub(crate) fn new() -> Checker {
        Checker {
            state: State::zeroed(),
            during: "identification",
            states: 0,
            missed: 0,
            excluded: [0; 2],
            held_up: [false; 2],
            required_reason: None,
            published: BTreeMap::new(),
            worst: BTreeMap::new(),
            wrong: Vec::new(),
            truths: (0, Vec::new()),
            worst_joint: JOINTS,
            com_sigma_m: 0.0,
        }
    }

    /// Checks the next state.
    pub(crate) fn check(&mut self, state: State, person: &SimulationHandle) {
        assert!(numbers(&state).all(f64::is_finite), "not a number: {state:?}");
        assert!(state.cycle > self.state.cycle, "cycle {} after {}", state.cycle, self.state.cycle);
        self.states += 1;
        self.missed += if self.state.cycle > 0 { state.cycle - self.state.cycle - 1 } else { 0 };
        self.state = state;
        // A simulated sensor delayed by the overloaded host sends old samples as new ones, which is indistinguishable
        // from a late device, so its values are excluded. Values of the other sensor are checked all the same.
        let now_ns = state.time_ns.max(person.sent_at_ns()[1]);
        self.held_up = person.held_up_ns().map(|at_ns| now_ns < at_ns + HELD_UP_FOR_NS);
        for (excluded, held_up) in self.excluded.iter_mut().zip(self.held_up) {
            *excluded += u64::from(held_up);
        }
        if let Some(reason) = self.required_reason {
            self.compare_with_bound("another clock", f64::from(!state.validity().any_of(reason)), 0.5);
        }
        self.ages(person);
        self.values(person);
    }

    /// Starts counting: the model is identified from here on.
    pub(crate) fn begin_to_count(&mut self) {
        (self.states, self.missed, self.excluded) = (0, 0, [0; 2]);
        self.published.clear();
    }

    /// A value that was checked too rarely for a verdict, or too many states that were missed.
    pub(crate) fn insufficient(&self) -> Option<String> {
        let published = |value: &&str| self.published.get(value).copied().unwrap_or(0);
        if let Some(rare) = VALUES.iter().find(|value| published(value) * CHECKED_ONE_IN < self.states) {
            return Some(format!("{rare} was checked in {} of {} states only", published(rare), self.states));
        }
        (self.missed * MISSED_ONE_IN > self.states)
            .then(|| format!("{} states were missed and {} seen", self.missed, self.states))
    }

    /// Silence and age are checked even while the host delays the sensors.
    fn ages(&mut self, person: &SimulationHandle) {
        let (state, sent_ns, sent_at_ns) = (self.state, person.sent_ns(), person.sent_at_ns());
        let streams = [
            (state.suit_age_ns, Validity::SUIT_STALE, "suit's age", "suit's silence"),
            (state.ground_age_ns, Validity::GROUND_STALE, "ground's age", "ground's silence"),
        ];
        for (sensor, (age_ns, stale, of_age, of_silence)) in streams.into_iter().enumerate() {
            if state.validity().any_of(stale) || age_ns == u64::MAX {
                continue;
            }
            // The send times are read after the state was received, so they can only be newer. For a delayed sample the
            // upper limit is its send time.
            let newest_ns = state.time_ns - age_ns;
            let sent_ns = if self.held_up[sensor] { sent_at_ns[sensor] } else { sent_ns[sensor] };
            let ahead_ns = newest_ns.saturating_sub(sent_ns);
            self.compare_with_bound(of_age, ahead_ns as f64 * 1e-9, AHEAD_AT_MOST_NS as f64 * 1e-9);
            let silent_ns = state.time_ns.saturating_sub(sent_at_ns[sensor]);
            self.compare_with_bound(
                of_silence,
                silent_ns as f64 * 1e-9,
                SILENT_AT_MOST_NS[sensor] as f64 * 1e-9,
            );
        }
    }

    fn values(&mut self, person: &SimulationHandle) {
        let state = self.state;
        let valid = state.validity();
        let suit_published = !valid.any_of(Validity::SUIT_STALE) && state.suit_sample_time_ns > 0;
        // Without the suit only the ground is reported, at its own newest sample time.
        let about_ns = match suit_published {
            true => state.suit_sample_time_ns,
            false if state.ground_age_ns < u64::MAX => state.time_ns - state.ground_age_ns,
            false => return,
        };
        if self.truths.0 != about_ns {
            let about_s = (about_ns as f64 - person.start_ns() as f64) * 1e-9;
            self.truths = (about_ns, vec![person.truth_at(about_s)]);
        }
        self.ground_values(person);
        // While device time is not tied to host time, the state's sample time is undefined.
        if !suit_published || valid.any_of(Validity::CLOCK_UNSYNCHRONISED) {
            return;
        }
        self.body_values(person);
        self.load_values(person);
        self.torques(person);
        self.low_back(person);
    }

    /// Whether a value is valid, and no sensor that it depends on was delayed by the host.
    fn is_checked(&self, invalidating: Validity, needs: Needs) -> bool {
        !self.state.validity().any_of(invalidating)
            && !(0..2).any(|sensor| needs[sensor] && self.held_up[sensor])
    }

    /// Centre of pressure and force of the plate.
    fn ground_values(&mut self, person: &SimulationHandle) {
        let state = self.state;
        if self.is_checked(Validity::INVALIDATES_COP_MEASURED, GROUND) {
            let bound_m = COP_FLOOR_M + SIGMAS * norm(state.cop_measured_sigma_m);
            self.compare("measured cop", person, bound_m, |truth| {
                (Vector2::from(state.cop_measured_m) - truth.cop_m).norm()
            });
        }
        if self.is_checked(Validity::INVALIDATES_GROUND_FORCE, GROUND) {
            self.compare("ground force", person, FORCE_FLOOR_N, |truth| {
                (state.ground_force_n[2] - truth.ground.force_n.z).abs()
            });
        }
    }

    /// Centre of mass, centre of pressure without the load, and segments.
    fn body_values(&mut self, person: &SimulationHandle) {
        let state = self.state;
        if self.is_checked(Validity::INVALIDATES_COM, SUIT) {
            // In motion too fast for the centre of pressure the state has no σ; the model error of the body is the same
            // as before.
            if state.cop_sigma_m != [0.0; 2] {
                self.com_sigma_m = norm(state.cop_sigma_m);
            }
            let bound_m = COM_FLOOR_M + SIGMAS * self.com_sigma_m;
            self.compare("com", person, bound_m, |truth| {
                (Vector3::from(state.com_m) - truth.com_m).xy().norm()
            });
        }
        if self.is_checked(Validity::INVALIDATES_COP_ESTIMATED, SUIT) {
            let bound_m = COP_FLOOR_M + SIGMAS * norm(state.cop_sigma_m);
            self.compare("estimated cop", person, bound_m, |truth| {
                (Vector2::from(state.cop_estimated_m) - truth.cop_without_load_in_motion_m).norm()
            });
        }
        if self.is_checked(Validity::INVALIDATES_COM, SUIT) {
            self.compare("segments", person, SEGMENT_FLOOR_M, |truth| {
                let error_m =
                    |i: usize| (Vector3::from(state.segment_origin_m[i]) - truth.body.origin_m[i]).norm();
                (0..SEGMENTS).map(error_m).fold(0.0, f64::max)
            });
        }
    }

    /// External force and lifted mass.
    fn load_values(&mut self, person: &SimulationHandle) {
        let state = self.state;
        if self.is_checked(Validity::INVALIDATES_DELTA_F, BOTH) {
            let bound_n = FORCE_FLOOR_N + SIGMAS * state.delta_f_sigma_n;
            self.compare("external force", person, bound_n, |truth| {
                (state.delta_f_n[2] + truth.load_force_in_motion_n.z).abs()
            });
        }
        if self.is_checked(Validity::INVALIDATES_LIFTED_MASS.and(Validity::NOT_IDENTIFIED), BOTH) {
            let bound_kg = MASS_FLOOR_KG + SIGMAS * state.lifted_mass_sigma_kg;
            self.compare("lifted mass", person, bound_kg, |truth| {
                (state.lifted_mass_kg - truth.body.load_kg).abs()
            });
        }
    }

    /// Torques of all joints, by the one with the largest error.
    fn torques(&mut self, person: &SimulationHandle) {
        let state = self.state;
        if self.is_checked(Validity::INVALIDATES_TORQUES, BOTH) {
            let bound_ratio = |truth: &Truth, j: usize| {
                let error_nm = (Vector3::from(state.torque_nm[j]) - truth.overload_in_motion_nm[j]).norm();
                error_nm / (torque_floor_nm(Joint::ALL[j]) + SIGMAS * state.torque_sigma_nm[j])
            };
            let now = &self.truths.1[0];
            let worst = (0..JOINTS).max_by(|a, b| bound_ratio(now, *a).total_cmp(&bound_ratio(now, *b)));
            self.worst_joint = worst.unwrap_or(JOINTS);
            self.compare("torques", person, 1.0, |truth| {
                (0..JOINTS).map(|j| bound_ratio(truth, j)).fold(0.0, f64::max)
            });
        }
        self.worst_joint = JOINTS;
    }

    /// Moment and compression at L5/S1.
    fn low_back(&mut self, person: &SimulationHandle) {
        let state = self.state;
        if self.is_checked(Validity::INVALIDATES_LOW_BACK, BOTH) {
            let bound_nm = BACK_FLOOR_NM + SIGMAS * state.l5s1_moment_sigma_nm;
            self.compare("low back", person, bound_nm, |truth| {
                (state.l5s1_moment_nm - truth.back.moment_nm.xy().norm()).abs()
            });
            let bound_n = COMPRESSION_FLOOR_N + SIGMAS * state.l5s1_compression_sigma_n;
            self.compare("compression", person, bound_n, |truth| {
                let muscle_n = truth.back.moment_nm.xy().norm() / EXTENSOR_LEVER_M;
                (state.l5s1_compression_n - (muscle_n + truth.back.axial_n).max(0.0)).abs()
            });
        }
    }

    /// Compares the error of a reported value with its bound; neighbouring instants are queried only if the nearest
    /// truth is too far.
    fn compare(
        &mut self,
        what: &'static str,
        person: &SimulationHandle,
        bound: f64,
        error: impl Fn(&Truth) -> f64,
    ) {
        let mut least = error(&self.truths.1[0]);
        if least > bound {
            if self.truths.1.len() == 1 {
                let about_s = self.truths.1[0].time_s;
                for step in [-1.0, -0.5, 0.5, 1.0] {
                    self.truths.1.push(person.truth_at(about_s + step * DATED_WITHIN_S));
                }
            }
            least = self.truths.1.iter().map(&error).fold(least, f64::min);
        }
        *self.published.entry(what).or_default() += 1;
        self.compare_with_bound(what, least, bound);
    }

    fn compare_with_bound(&mut self, what: &'static str, error: f64, bound: f64) {
        let bound_ratio = error / bound;
        if self.worst.get(what).is_none_or(|worst| bound_ratio > worst.bound_ratio) {
            let context = if bound_ratio > CONTEXT_ABOVE { self.context() } else { String::new() };
            self.worst.insert(what, Worst { bound_ratio, during: self.during, context });
        }
        if bound_ratio > 1.0 {
            let (during, cycle, context) = (self.during, self.state.cycle, self.context());
            self.wrong.push(Wrong { what, during, cycle, error, bound, context });
        }
    }

    /// The raised reasons, the true load, and the joint with the largest torque error.
    fn context(&self) -> String {
        let (state, joint) = (&self.state, self.worst_joint);
        let reasons: Vec<_> = state.validity().names().collect();
        let about = self.truths.1.first();
        let torque = Joint::ALL.get(joint).zip(about).map_or(String::new(), |(named, truth)| {
            let (published, sigma) = (state.torque_nm[joint], state.torque_sigma_nm[joint]);
            let (force_n, sigma_n) = (state.delta_f_n[2], state.delta_f_sigma_n);
            let is: [f64; 3] = truth.overload_in_motion_nm[joint].into();
            let is_n = -truth.load_force_in_motion_n.z;
            let name = named.name();
            format!(
                ", {name} {published:.1?} ± {sigma:.1} N m is {is:.1?}, force {force_n:.1} ± {sigma_n:.1} N is {is_n:.1}, feet carry {:.2?}, ankles at {:.3?} and {:.3?} m, CoP {:.3?} and {:.3?} ± {:.3?} m, truly {:.3?} and {:.3?} m",
                state.foot_load_fraction,
                state.segment_origin_m[Segment::LeftFoot.index()],
                state.segment_origin_m[Segment::RightFoot.index()],
                state.cop_measured_m,
                state.cop_estimated_m,
                state.cop_sigma_m,
                <[f64; 2]>::from(truth.cop_m),
                <[f64; 2]>::from(truth.cop_without_load_in_motion_m),
            )
        });
        let load_kg = about.map_or(0.0, |truth| truth.body.load_kg);
        let (force_n, sigma_n) = (state.ground_force_n[2], state.delta_f_sigma_n);
        let forces_n: Vec<_> =
            self.truths.1.iter().map(|truth| (truth.time_s, truth.ground.force_n.z)).collect();
        let ages_ms = [state.suit_age_ns, state.ground_age_ns].map(|age_ns| age_ns as f64 * 1e-6);
        let (skew_s, skew_sigma_s) = (state.suit_skew_s, state.suit_skew_sigma_s);
        format!(
            "{reasons:?}, load {load_kg:.1} kg, ground force {force_n:.1} N (of the external force ± {sigma_n:.1} N), truly {forces_n:.3?} (s, N), suit and ground {ages_ms:.1?} ms old, skew {skew_s:.4} ± {skew_sigma_s:.4} s{torque}"
        )
    }

    /// The wrong values in words, each run of cycles once.
    pub(crate) fn report(&self) -> Vec<String> {
        let mut runs: Vec<(Wrong, u64, f64)> = Vec::new();
        for wrong in &self.wrong {
            match runs.iter_mut().find(|(run, last, _)| run.what == wrong.what && wrong.cycle <= last + 100) {
                Some((_, last, most)) => (*last, *most) = (wrong.cycle, most.max(wrong.error)),
                None => runs.push((wrong.clone(), wrong.cycle, wrong.error)),
            }
        }
        let line = |(first, last, most): &(Wrong, u64, f64)| {
            format!(
                "{} during {}: cycles {} to {last}, {:.4} (most {most:.4}) where {:.4} is allowed; {}",
                first.what, first.during, first.cycle, first.error, first.bound, first.context
            )
        };
        runs.iter().map(line).collect()
    }

    pub(crate) fn worst(&self) -> String {
        let line = |(what, Worst { bound_ratio, during, context }): (&&str, &Worst)| {
            let published = self.published.get(what).copied().unwrap_or(self.states);
            format!(
                "  {what:<16} published {published:>8} times, at worst {:>3.0} % of its bound ({during}) {context}",
                100.0 * bound_ratio
            )
        };
        self.worst.iter().map(line).collect::<Vec<_>>().join("\n")
    }
}

/// The floor of a joint's torque, N m. A leg's includes the effect of the centre of pressure's floor on half the body
/// weight, which acts at the estimated centre of pressure.
fn torque_floor_nm(joint: Joint) -> f64 {
    let is_leg = ["Hip", "Knee", "Ankle", "BallFoot"].iter().any(|part| joint.name().ends_with(part));
    TORQUE_FLOOR_NM + if is_leg { COP_FLOOR_M * 0.5 * BODY_N } else { 0.0 }
}

fn norm(pair: [f64; 2]) -> f64 {
    pair[0].hypot(pair[1])
}

/// Every number of a state.
fn numbers(state: &State) -> impl Iterator<Item = f64> {
    let bytes = bytemuck::bytes_of(state);
    let fields = State::FIELDS.iter().filter(|field| field.primitive == Primitive::F64);
    fields.flat_map(move |field| {
        let numbers = bytes[field.offset..field.offset + 8 * field.count].chunks_exact(8);
        numbers.map(|eight| f64::from_ne_bytes(eight.try_into().expect("eight bytes")))
    })
}

#[cfg(test)]
mod tests;
