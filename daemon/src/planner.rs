//! Plans handovers for controllers, and learns from those that the worker performs.
//!
//! A thread of its own without a deadline, because a plan takes many cycles. It reads the published states like any
//! consumer, and the identified body from the copies of the saving thread.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use bytemuck::Zeroable;
use equipoise_bus::{Bus, BusError, BusSettings, HandoverServer, Subscriber};
use equipoise_core::body::JOINTS;
use equipoise_core::cycle::identification::StoredSubject;
use equipoise_core::cycle::{Identification, Settings};
use equipoise_core::handover::experience::Experience;
use equipoise_core::handover::hold::HoldDetector;
use equipoise_core::handover::search::{PlacePrediction, Planning};
use equipoise_core::handover::{Body, FootPlacement, Infeasible, MASS_KG, PLACE_MAX_M, Part, WIDTH_M};
use equipoise_core::message::handover::{CurrentFrame, CurrentStatus, HandoverRefusal};
use equipoise_core::message::{HandoverPlan, HandoverRequest, State, Validity};
use equipoise_core::overload::TorqueLimits;
use nalgebra::Vector3;
use tracing::debug;

use crate::active_configuration::SharedConfiguration;
use crate::realtime::now_ns;
use crate::rings::LoopControl;
use crate::subjects::Subjects;

/// Polling interval for requests and states.
const POLL_INTERVAL: Duration = Duration::from_millis(5);
/// Interval of attempts after a failure of the bus.
const RETRY_INTERVAL: Duration = Duration::from_secs(1);
/// Maximum age of the state of a plan, ns: that at which a controller stops (docs/cobot.md).
const STATE_AGE_MAX_NS: u64 = 50_000_000;
/// Flags that invalidate the feet's positions, the subject that they belong to, or the copied identification, which the
/// saving thread renews late while the disk is slow.
const INVALIDATES_PLAN: Validity = Validity::NOT_IDENTIFIED
    .and(Validity::MASS_UNKNOWN)
    .and(Validity::BODY_UNKNOWN)
    .and(Validity::SUIT_STALE)
    .and(Validity::SUIT_IMPLAUSIBLE)
    .and(Validity::POSITION_UNKNOWN)
    .and(Validity::FEET_OFF_PLATE)
    .and(Validity::MODEL_CHANGED);

/// The stored data of the subject in use, from the saving thread to the planner.
#[derive(Debug, Default)]
pub struct SharedWorker(Mutex<Option<Copied>>);

#[derive(Debug)]
struct Copied {
    /// Number of the subject.
    number: u64,
    /// Increments with every change.
    version: u64,
    stored: Box<StoredSubject>,
}

impl SharedWorker {
    /// Replaces the data, if they differ.
    pub fn set(&self, number: u64, stored: &StoredSubject) {
        let mut shared = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let copied = shared.get_or_insert_with(|| Copied {
            number: u64::MAX,
            version: 0,
            stored: bytemuck::zeroed_box(),
        });
        if copied.number != number || bytemuck::bytes_of(&*copied.stored) != bytemuck::bytes_of(stored) {
            (copied.number, *copied.stored) = (number, *stored);
            copied.version += 1;
        }
    }
}

/// The subject in use as plans need it.
struct Worker {
    number: u64,
    version: u64,
    /// Limits in the settings of the body.
    limits: TorqueLimits,
    /// The identified body without fatigue, or why there is none.
    body: Result<Body, HandoverRefusal>,
    /// Stature, m.
    height_m: f64,
}

/// The planner with its ports on the bus.
pub struct Planner {
    server: HandoverServer,
    states: Subscriber<State>,
    newest: Option<State>,
    shared: Arc<SharedWorker>,
    worker: Option<Worker>,
    holds: HoldDetector,
    subjects: Arc<Subjects>,
    active_configuration: Arc<SharedConfiguration>,
    control: Arc<LoopControl>,
    // Ports must be dropped before the node that they depend on.
    _bus: Bus,
}

impl Planner {
    /// Joins the bus and opens the station's only handover server.
    ///
    /// # Errors
    /// The bus cannot be joined, or another process serves this station.
    pub fn open(
        station: &str,
        shared: Arc<SharedWorker>,
        subjects: Arc<Subjects>,
        active_configuration: Arc<SharedConfiguration>,
        control: Arc<LoopControl>,
    ) -> Result<Planner, BusError> {
        let bus = Bus::join(&BusSettings::new(station, "planner"))?;
        Ok(Planner {
            server: bus.handover_server()?,
            states: bus.subscriber(1)?,
            newest: None,
            shared,
            worker: None,
            holds: HoldDetector::default(),
            subjects,
            active_configuration,
            control,
            _bus: bus,
        })
    }

    /// Plans and measures handovers until the daemon stops. A failure of the bus is logged; the bus is tried again.
    pub fn run(mut self) {
        let mut logged = String::new();
        while !self.control.is_stopping() {
            self.update_worker();
            match self.serve() {
                Ok(is_served) => {
                    logged.clear();
                    if !is_served {
                        std::thread::sleep(POLL_INTERVAL);
                    }
                }
                Err(error) => {
                    let text = error.to_string();
                    if text != logged {
                        tracing::warn!("handovers are not planned: {text}; next attempt in 1 s");
                        logged = text;
                    }
                    std::thread::sleep(RETRY_INTERVAL);
                }
            }
        }
    }

    /// Updates the experience by the newest state and answers one request; returns whether there was one.
    fn serve(&mut self) -> Result<bool, BusError> {
        if let Some(state) = self.states.latest()? {
            self.learn(&state);
            self.newest = Some(state);
        }
        let Planner { server, newest, worker, subjects, .. } = self;
        // The copy of a subject who was just loaded comes once the saving thread has time.
        let worker = worker.as_ref().filter(|worker| worker.number == subjects.in_use());
        server.poll(|request| {
            let destination = worker.and_then(|worker| subjects.get(worker.number));
            let (subject, experience) = destination.map(|it| (it.subject, it.experience)).unwrap_or_default();
            let plan = plan_of(request, newest.as_ref(), now_ns(), worker, &experience);
            HandoverPlan { subject: padded(&subject), ..plan }
        })
    }

    /// Restores the identified body when it, the torque limits or the stature have changed.
    fn update_worker(&mut self) {
        let settings = self.active_configuration.settings();
        let shared = self.shared.0.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(copied) = &*shared else { return };
        let is_current = |worker: &Worker| {
            (worker.version, worker.limits, worker.height_m)
                == (copied.version, settings.limits, settings.height_m)
        };
        if self.worker.as_ref().is_some_and(is_current) {
            return;
        }
        let (number, version, stored) = (copied.number, copied.version, copied.stored.clone());
        drop(shared);
        let mut identification = bytemuck::zeroed_box::<Identification>();
        let body = if stored.identified != 1 || !identification.restore(&stored, &settings) {
            Err(HandoverRefusal::NotIdentified)
        } else if stored.mass_kg <= 0.0 {
            Err(HandoverRefusal::MassUnknown)
        } else {
            Ok(identification.handover_body(&settings, [0.0; JOINTS]))
        };
        if self.worker.as_ref().is_none_or(|worker| worker.number != number) {
            self.holds = HoldDetector::default();
        }
        let Settings { limits, height_m, .. } = settings;
        self.worker = Some(Worker { number, version, limits, body, height_m });
    }

    /// Adds a handover to the worker's experience once it is measured.
    fn learn(&mut self, state: &State) {
        let Some(Worker { number, body: Ok(body), height_m, .. }) = &self.worker else { return };
        if *number != self.subjects.in_use() {
            return;
        }
        let Some(hold) = self.holds.ingest(state, &body.grip_m) else { return };
        self.subjects.update_experience(*number, |experience| {
            let is_added = hold.add_to(experience, body, *height_m);
            debug!("handover measured, {}: {hold:?}", if is_added { "used" } else { "not used" });
        });
    }
}

/// The plan of a request. `subject` is left empty.
fn plan_of(
    request: &HandoverRequest,
    newest: Option<&State>,
    now_ns: u64,
    worker: Option<&Worker>,
    experience: &Experience,
) -> HandoverPlan {
    let of_state = newest.map_or(HandoverPlan::zeroed(), |state| HandoverPlan {
        cycle: state.cycle,
        sample_time_ns: state.suit_sample_time_ns,
        valid: state.valid,
        ..HandoverPlan::zeroed()
    });
    let refused = |why: HandoverRefusal| HandoverPlan { refused: why as u32, ..of_state };
    if !is_in_range(request) {
        return refused(HandoverRefusal::Request);
    }
    let is_recent = |state: &&State| now_ns.saturating_sub(state.time_ns) <= STATE_AGE_MAX_NS;
    let Some(state) = newest.filter(is_recent) else { return refused(HandoverRefusal::Stale) };
    let Some(worker) = worker else { return refused(HandoverRefusal::NotIdentified) };
    let body = match &worker.body {
        Ok(body) => Body { fatigue: state.fatigue, ..*body },
        Err(why) => return refused(*why),
    };
    if state.validity().any_of(INVALIDATES_PLAN) {
        return refused(HandoverRefusal::Invalid);
    }
    let (feet, height_m) = (FootPlacement::of_segments(&state.segment_origin_m), worker.height_m);
    let part = Part {
        mass_kg: request.mass_kg,
        mass_sigma_kg: request.mass_sigma_kg,
        width_m: request.width_m,
        slope_rad: None,
    };
    let planning = Planning { body: &body, height_m, feet: &feet, part: &part, experience };
    let Some((best, Ok((worst, ratio)))) = planning.best().map(|best| (best, best.predicted)) else {
        return refused(HandoverRefusal::Infeasible);
    };
    let mut plan = HandoverPlan {
        handovers: experience.count() as u32,
        worst_joint: worst.index() as u32,
        position_m: best.position_m.into(),
        place_m: best.place_m.into(),
        slope_rad: best.slope_rad.unwrap_or_default(),
        feet_heading_rad: feet.heading_rad(),
        limit_ratio: ratio.value,
        limit_ratio_sigma: ratio.sigma,
        ..of_state
    };
    let current_m = Vector3::from(request.current_m);
    let slope_rad = (request.current_is_sloped == 1).then_some(request.current_slope_rad);
    match CurrentFrame::from_number(request.current_frame) {
        Some(CurrentFrame::Station) => {
            set_current(&mut plan, &planning.at(feet.place_m(current_m, height_m), slope_rad));
        }
        Some(CurrentFrame::Feet) => set_current(&mut plan, &planning.at(current_m, slope_rad)),
        Some(CurrentFrame::None) | None => {}
    }
    plan
}

fn set_current(plan: &mut HandoverPlan, current: &PlacePrediction) {
    let status = match current.predicted {
        Ok((worst, ratio)) => {
            plan.current_worst_joint = worst.index() as u32;
            (plan.current_limit_ratio, plan.current_limit_ratio_sigma) = (ratio.value, ratio.sigma);
            CurrentStatus::Predicted
        }
        Err(Infeasible::OutOfReach) => CurrentStatus::OutOfReach,
        Err(Infeasible::OutOfBalance) => CurrentStatus::OutOfBalance,
    };
    plan.current_status = status as u32;
}

/// False for a number that is not finite, too.
fn is_in_range(request: &HandoverRequest) -> bool {
    let current_max_m = match CurrentFrame::from_number(request.current_frame) {
        None => return false,
        Some(CurrentFrame::None) => f64::INFINITY,
        // Farther from its origin than any place in a station.
        Some(CurrentFrame::Station) => 1000.0,
        Some(CurrentFrame::Feet) => PLACE_MAX_M,
    };
    MASS_KG.contains(&request.mass_kg)
        && (0.0..=request.mass_kg).contains(&request.mass_sigma_kg)
        && WIDTH_M.contains(&request.width_m)
        && request.current_is_sloped <= 1
        && request.current_slope_rad.abs() <= core::f64::consts::PI
        && request.current_m.iter().all(|metres| metres.abs() <= current_max_m)
}

/// A pseudonym as a field of a message; the bus's names are shorter than the field.
fn padded(subject: &str) -> [u8; 64] {
    let mut field = [0; 64];
    for (to, from) in field.iter_mut().zip(subject.bytes()) {
        *to = from;
    }
    field
}

#[cfg(test)]
mod tests {
    use equipoise_core::body::{Anthropometry, Sex, Side, Skeleton};
    use equipoise_core::handover::experience::Handover;
    use equipoise_core::sesc::Phi;

    use super::*;

    const HEIGHT_M: f64 = 1.77;
    const REQUEST: HandoverRequest = HandoverRequest {
        mass_kg: 6.0,
        mass_sigma_kg: 0.0,
        width_m: 0.35,
        current_m: [0.5, 0.0, 1.2],
        current_frame: CurrentFrame::Feet as u32,
        current_is_sloped: 0,
        current_slope_rad: 0.0,
    };

    fn worker() -> Worker {
        let skeleton = Skeleton::nominal(HEIGHT_M);
        let table = Anthropometry::de_leva(&skeleton, HEIGHT_M, Sex::Male);
        let body = Body {
            skeleton,
            grip_m: Side::BOTH.map(|side| table.grip_m(side.hand())),
            phi: Phi::of(&skeleton, &table),
            cop_sigma_m: 0.005,
            mass_kg: 75.0,
            limits: TorqueLimits::of(Sex::Male),
            fatigue: [0.0; JOINTS],
        };
        Worker { number: 0, version: 1, limits: body.limits, body: Ok(body), height_m: HEIGHT_M }
    }

    /// A worker 2 m ahead of the station's origin, who faces its Y axis.
    fn state() -> State {
        let turned = |[x, y, z]: [f64; 3]| [2.0 - y, x, z + 1.0];
        State {
            cycle: 7,
            time_ns: 1_000_000_000,
            suit_sample_time_ns: 900_000_000,
            segment_origin_m: Skeleton::nominal(HEIGHT_M).t_pose_m().map(turned),
            ..State::zeroed()
        }
    }

    fn planned(request: &HandoverRequest, state: &State, experience: &Experience) -> HandoverPlan {
        plan_of(request, Some(state), state.time_ns, Some(&worker()), experience)
    }

    #[test]
    fn a_plan_refers_to_the_feet_fatigue_and_experience_of_the_state() {
        let (state, none) = (state(), Experience::default());
        let fresh = planned(&REQUEST, &state, &none);
        assert_eq!(
            (fresh.refused, fresh.cycle, fresh.sample_time_ns, fresh.handovers),
            (0, 7, 900_000_000, 0)
        );
        let [forward, left, _] = fresh.place_m;
        assert!((fresh.feet_heading_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-9, "{fresh:?}");
        assert!((fresh.position_m[1] - forward).abs() < 0.05, "{fresh:?}");
        assert!((fresh.position_m[0] - (2.0 - left)).abs() < 0.05, "{fresh:?}");
        assert!(fresh.limit_ratio <= fresh.current_limit_ratio && fresh.limit_ratio_sigma > 0.0);

        let feet = FootPlacement::of_segments(&state.segment_origin_m);
        let in_station = HandoverRequest {
            current_m: feet.world_m(REQUEST.current_m.into(), HEIGHT_M).into(),
            current_frame: CurrentFrame::Station as u32,
            ..REQUEST
        };
        let same = planned(&in_station, &state, &none);
        assert!((same.current_limit_ratio - fresh.current_limit_ratio).abs() < 1e-6);

        let tired = planned(&REQUEST, &State { fatigue: [0.5; JOINTS], ..state }, &none);
        assert!((tired.limit_ratio - 2.0 * fresh.limit_ratio).abs() < 1e-9);

        let mut experience = Experience::default();
        experience.add(Handover { place_m: fresh.place_m, excess: 2.0, sigma: 0.0 });
        let corrected = planned(&REQUEST, &state, &experience);
        assert!(corrected.handovers == 1 && corrected.place_m != fresh.place_m, "{corrected:?}");
    }

    #[test]
    fn a_refusal_gives_the_reason_and_no_place() {
        let (state, none) = (state(), Experience::default());
        let refused = |plan: HandoverPlan, why: HandoverRefusal| {
            assert_eq!((plan.refused, plan.position_m, plan.limit_ratio), (why as u32, [0.0; 3], 0.0));
        };
        let changes: [fn(&mut HandoverRequest); 8] = [
            |request| request.mass_kg = 0.0,
            |request| request.mass_kg = f64::NAN,
            |request| request.mass_sigma_kg = -1.0,
            |request| request.width_m = f64::INFINITY,
            |request| request.current_m[1] = f64::NAN,
            |request| request.current_m[1] = 4.0,
            |request| request.current_frame = 3,
            |request| (request.current_frame, request.current_m[2]) = (0, f64::NAN),
        ];
        for change in changes {
            let mut request = REQUEST;
            change(&mut request);
            refused(planned(&request, &state, &none), HandoverRefusal::Request);
        }
        let late_ns = state.time_ns + STATE_AGE_MAX_NS + 1;
        refused(plan_of(&REQUEST, Some(&state), late_ns, Some(&worker()), &none), HandoverRefusal::Stale);
        refused(plan_of(&REQUEST, None, 0, Some(&worker()), &none), HandoverRefusal::Stale);
        refused(plan_of(&REQUEST, Some(&state), 0, None, &none), HandoverRefusal::NotIdentified);
        let unknown = Worker { body: Err(HandoverRefusal::MassUnknown), ..worker() };
        refused(plan_of(&REQUEST, Some(&state), 0, Some(&unknown), &none), HandoverRefusal::MassUnknown);
        let unplaced = State { valid: Validity::POSITION_UNKNOWN.0, ..state };
        let plan = planned(&REQUEST, &unplaced, &none);
        refused(plan, HandoverRefusal::Invalid);
        assert_eq!(plan.valid, unplaced.valid);
        // Lighter than the part, the worker would fall.
        let light = worker().body.map(|body| Body { mass_kg: 15.0, ..body });
        let heavy = HandoverRequest { mass_kg: 50.0, ..REQUEST };
        let light = Worker { body: light, ..worker() };
        refused(plan_of(&heavy, Some(&state), 0, Some(&light), &none), HandoverRefusal::Infeasible);
    }

    #[test]
    fn a_current_place_that_cannot_be_reached_is_reported() {
        let far = HandoverRequest { current_m: [2.0, 0.0, 1.0], ..REQUEST };
        let plan = planned(&far, &state(), &Experience::default());
        assert_eq!((plan.refused, plan.current_status), (0, CurrentStatus::OutOfReach as u32));
        assert_eq!(plan.current_limit_ratio, 0.0);
    }
}
