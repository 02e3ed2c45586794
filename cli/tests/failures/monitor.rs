//! A subscriber inside the test: receives every state and the adapters' counters.

use std::time::{Duration, Instant};

use bytemuck::Zeroable;
use equipoise_adapters::ground::GroundRefusal;
use equipoise_adapters::suit::SuitRefusal;
use equipoise_bus::{Bus, BusSettings, Subscriber};
use equipoise_core::message::{AdapterHealth, Incident, Incidents, State, Validity};
use equipoise_simulator::simulation::SimulationHandle;

use crate::process::{TIMEOUT, wait_for};
use crate::station::{NAME, Station};

/// Time for which a pose is held before another is tried.
const HOLD: Duration = Duration::from_secs(8);

pub(crate) struct Monitor {
    states: Subscriber<State>,
    health: Subscriber<AdapterHealth>,
    incidents: Subscriber<Incidents>,
    board: Incidents,
    pub(crate) state: State,
    /// Latest health messages of suit and ground.
    adapters: [AdapterHealth; 2],
    bus: Bus,
}

impl Monitor {
    pub(crate) fn open(station: &Station) -> Monitor {
        let settings =
            BusSettings { station: NAME.to_owned(), role: "test".to_owned(), root: station.root() };
        let bus = Bus::join(&settings).expect("the bus");
        Monitor {
            states: bus.subscriber(256).expect("a subscriber"),
            health: bus.subscriber(16).expect("a subscriber"),
            incidents: bus.subscriber(1).expect("a subscriber"),
            board: Incidents::zeroed(),
            state: State::zeroed(),
            adapters: [AdapterHealth::zeroed(); 2],
            bus,
        }
    }

    /// Whether a participant with that role is on the bus.
    pub(crate) fn has_participant(&self, role: &str) -> bool {
        self.bus.participants().is_ok_and(|all| all.iter().any(|one| one.role == role))
    }

    /// Ingests all received states; every number must be finite.
    pub(crate) fn update(&mut self) -> &State {
        while let Some(state) = self.states.receive().expect("the bus") {
            assert!(numbers(&state).all(f64::is_finite), "not a number: {state:?}");
            self.state = state;
        }
        while let Some(health) = self.health.receive().expect("the bus") {
            self.adapters[health.stream as usize - 1] = health;
        }
        if let Some(board) = self.incidents.latest().expect("the bus") {
            self.board = board;
        }
        &self.state
    }

    /// Receives until a condition holds.
    #[track_caller]
    pub(crate) fn until(&mut self, what: &str, mut condition: impl FnMut(&Monitor) -> bool) -> State {
        let started = Instant::now();
        loop {
            self.update();
            if condition(self) {
                return self.state;
            }
            assert!(
                started.elapsed() < TIMEOUT,
                "waited in vain for {what}: {} {:?}, {} poses, {:?}; suit {:?}, ground {:?}",
                self.state.phase_name(),
                self.reasons(),
                self.state.poses_used,
                self.board.active().map(Incident::name).collect::<Vec<_>>(),
                self.adapters[0],
                self.adapters[1]
            );
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Receives for a duration.
    pub(crate) fn during(&mut self, time: Duration, mut observe: impl FnMut(&Monitor)) {
        let started = Instant::now();
        while started.elapsed() < time {
            self.update();
            observe(self);
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// The invalid reasons in the newest state.
    pub(crate) fn reasons(&self) -> Vec<&'static str> {
        self.state.validity().names().collect()
    }

    pub(crate) fn has(&self, reason: Validity) -> bool {
        self.state.validity().any_of(reason)
    }

    /// Whether an incident is in progress.
    pub(crate) fn is_active(&self, kind: Incident) -> bool {
        self.board.active().any(|active| active == kind)
    }

    /// Number of times an incident has begun since the daemon's start.
    pub(crate) fn count(&self, kind: Incident) -> u64 {
        self.board.begun[kind as usize]
    }

    pub(crate) fn both_fresh(&self) -> bool {
        self.state.cycle > 0 && !self.has(Validity::SUIT_STALE.and(Validity::GROUND_STALE))
    }

    pub(crate) fn suit(&self) -> &AdapterHealth {
        &self.adapters[0]
    }

    pub(crate) fn ground(&self) -> &AdapterHealth {
        &self.adapters[1]
    }

    pub(crate) fn suit_refused(&self, reason: SuitRefusal) -> u64 {
        self.adapters[0].refused[reason.index()]
    }

    pub(crate) fn ground_refused(&self, reason: GroundRefusal) -> u64 {
        self.adapters[1].refused[reason.index()]
    }

    /// Tares until the plate measures less than a force: the loop refuses without a reply if one of its latest readings
    /// is late or loaded.
    #[track_caller]
    pub(crate) fn until_tared(&mut self, station: &Station, below_n: f64) {
        wait_for("zero after a tare", || {
            let tare = station.run(&["tare"]);
            let mut is_zero = false;
            self.during(Duration::from_secs(1), |monitor| {
                let is_measured = monitor.both_fresh() && !monitor.has(Validity::INVALIDATES_GROUND_FORCE);
                is_zero |= is_measured && monitor.state.ground_force_n[2].abs() < below_n;
            });
            (is_zero && tare.stdout.contains("zero from now on")).then_some(())
        });
    }

    /// The person goes through the library until this number of poses has been used.
    #[track_caller]
    pub(crate) fn until_poses(&mut self, person: &SimulationHandle, count: u32) {
        let started = Instant::now();
        let (mut pose, mut started_pose) = (0, None::<(Instant, u32)>);
        while self.update().poses_used < count {
            assert!(started.elapsed() < 3 * TIMEOUT, "{} poses, {:?}", self.state.poses_used, self.reasons());
            if started_pose
                .is_none_or(|(since, previous)| since.elapsed() > HOLD || self.state.poses_used > previous)
            {
                person.take_pose(pose).expect("a pose of the library");
                pose += 1;
                started_pose = Some((Instant::now(), self.state.poses_used));
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

fn numbers(state: &State) -> impl Iterator<Item = f64> {
    let plane = state.cop_measured_m.into_iter().chain(state.cop_estimated_m).chain(state.cop_sigma_m);
    let space = state.com_m.into_iter().chain(state.ground_force_n).chain(state.delta_f_n);
    let fractions = state.foot_load_fraction.into_iter().chain(state.hand_load_fraction);
    let single = [
        state.mass_kg,
        state.load_hand_distance_m,
        state.variance_max_m2,
        state.predicted_cop_sigma_m,
        state.nis,
        state.pose_mismatch_rad,
        state.lifted_mass_kg,
        state.reach_m,
        state.l5s1_moment_nm,
        state.l5s1_compression_n,
        state.dose_damage,
        state.dose_probability,
        state.advice_gain_nm_per_cm,
    ];
    let joints = state.torque_nm.into_iter().flatten().chain(state.torque_sigma_nm).chain(state.fatigue);
    let segments = state.segment_origin_m.into_iter().flatten();
    plane.chain(space).chain(fractions).chain(single).chain(joints).chain(segments)
}
