//! Moment about the vertical through the centre of pressure, from ground samples: states do not hold it.

use equipoise_adapters::recording::{Entry, TimedEntry};
use equipoise_core::cycle::Tare;
use equipoise_core::cycle::alignment::GAP_MAX_NS;
use equipoise_core::message::command::CommandKind;
use equipoise_core::message::{Component, GroundSample};

/// The tare in use over time: adapters publish samples without it.
#[derive(Debug, Default)]
pub(super) struct TareHistory {
    /// Times, CLOCK_MONOTONIC ns, and the tare from then on; `None` if it is unavailable.
    changes: Vec<(u64, Option<Tare>)>,
}

impl TareHistory {
    /// Ingests an entry: a checkpoint holds the tare, a tare command replaces it.
    pub(super) fn ingest(&mut self, timed: &TimedEntry) {
        match &timed.entry {
            Entry::Checkpoint(checkpoint) => {
                let tare = checkpoint.memory().map(|memory| (timed.log_time_ns, Some(*memory.tare())));
                self.changes.extend(tare);
            }
            Entry::Cycle(cycle) if cycle.command == CommandKind::Tare as u32 => {
                self.changes.push((cycle.due_ns, None));
            }
            _ => {}
        }
    }

    /// The tare at the begin: that of the first checkpoint unless a command replaced it before; without a checkpoint
    /// `first`. A replay begins with the same tare and repeats the commands.
    pub(super) fn begin_with(&mut self, first: Option<Tare>) {
        self.changes.sort_by_key(|(time_ns, _)| *time_ns);
        if self.changes.iter().all(|(_, tare)| tare.is_none()) {
            self.changes.splice(..0, first.map(|tare| (0, Some(tare))));
        } else if let Some((time_ns, Some(_))) = self.changes.first_mut() {
            *time_ns = 0;
        }
    }

    fn at(&self, time_ns: u64) -> Option<&Tare> {
        let after = self.changes.partition_point(|(from_ns, _)| *from_ns <= time_ns);
        self.changes[..after].last()?.1.as_ref()
    }
}

/// Free moment at each instant: the mean of the ground samples around it, or with a slower ground the value between the
/// two samples that enclose it.
#[derive(Debug)]
pub(super) struct FreeMoments {
    /// Times of the instants on the clock of the ground, CLOCK_MONOTONIC ns, and their numbers; ascending.
    times_ns: Vec<(u64, usize)>,
    /// Half the interval between instants, ns.
    half_ns: u64,
    /// By the number of the instant.
    moments: Vec<Moment>,
    /// Time, CLOCK_MONOTONIC ns, and moment, N m, of the last sample; `None` if that is unavailable.
    last: Option<(u64, f64)>,
    /// Height of the walking surface, m; NaN before the first sample.
    surface_z_m: f64,
}

/// Free moment at one instant.
#[derive(Debug, Clone, Copy)]
struct Moment {
    /// Sum of the moments around it, N m, and number of samples.
    sum_nm: f64,
    count: u32,
    /// Value between the enclosing samples, N m; NaN without them.
    between_nm: f64,
}

impl FreeMoments {
    /// `times_ns`: times of the instants on the clock of the ground; one without a time has no moment.
    pub(super) fn new(times_ns: &[Option<u64>], half_ns: u64) -> FreeMoments {
        let none = Moment { sum_nm: 0.0, count: 0, between_nm: f64::NAN };
        let moments = vec![none; times_ns.len()];
        let with_time = times_ns.iter().enumerate().filter_map(|(index, time_ns)| Some(((*time_ns)?, index)));
        let mut times_ns: Vec<(u64, usize)> = with_time.collect();
        // A change of the lag may change the order.
        times_ns.sort_unstable();
        FreeMoments { times_ns, half_ns, moments, last: None, surface_z_m: f64::NAN }
    }

    /// Ingests a ground sample, with the tare not yet subtracted.
    pub(super) fn ingest(&mut self, sample: &GroundSample, tares: &TareHistory) {
        if self.surface_z_m.is_nan() {
            self.surface_z_m = sample.surface_z_m;
        }
        let time_ns = sample.sample_time_ns;
        let tare = tares.at(time_ns);
        let measured = tare.and_then(|tare| free_moment_nm(sample, tare)).map(|nm| (time_ns, nm));
        let last = std::mem::replace(&mut self.last, measured);
        let Some((_, moment_nm)) = measured else { return };
        let after = self.times_ns.partition_point(|(instant_ns, _)| *instant_ns < time_ns);
        let distance_ns = |index: &usize| self.times_ns[*index].0.abs_diff(time_ns);
        let around = after.saturating_sub(1)..(after + 1).min(self.times_ns.len());
        if let Some(nearest) = around.min_by_key(distance_ns).filter(|at| distance_ns(at) <= self.half_ns) {
            let moment = &mut self.moments[self.times_ns[nearest].1];
            moment.sum_nm += moment_nm;
            moment.count += 1;
        }
        // As the loop interpolates the force.
        let Some((last_ns, last_nm)) =
            last.filter(|(last_ns, _)| time_ns.saturating_sub(*last_ns) <= GAP_MAX_NS)
        else {
            return;
        };
        let first = self.times_ns.partition_point(|(instant_ns, _)| *instant_ns < last_ns);
        for (instant_ns, index) in self.times_ns.get(first..after).unwrap_or_default() {
            let fraction = (instant_ns - last_ns) as f64 / (time_ns - last_ns) as f64;
            self.moments[*index].between_nm = last_nm + fraction * (moment_nm - last_nm);
        }
    }

    /// Height of the walking surface, m; NaN without a ground sample.
    pub(super) fn surface_z_m(&self) -> f64 {
        self.surface_z_m
    }

    /// Free moment at an instant, N m; NaN without a sample.
    pub(super) fn at(&self, instant: usize) -> f64 {
        self.moments.get(instant).map_or(f64::NAN, |moment| match moment.count {
            0 => moment.between_nm,
            count => moment.sum_nm / f64::from(count),
        })
    }
}

/// Free moment of a sample, N m; `None` if its devices do not measure it or no person is on the plate.
fn free_moment_nm(sample: &GroundSample, tare: &Tare) -> Option<f64> {
    let tared = GroundSample {
        force_n: std::array::from_fn(|axis| sample.force_n[axis] - tare.force_n[axis]),
        moment_nm: std::array::from_fn(|axis| sample.moment_nm[axis] - tare.moment_nm[axis]),
        ..*sample
    };
    let [x, y] = tared.cop_m().ok()?;
    let [fx, fy, _] = tared.force_n;
    let is_measured = tared.measures(Component::Shear) && tared.measures(Component::FreeMoment);
    is_measured.then_some(tared.moment_nm[2] - (x * fy - y * fx))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use equipoise_core::cycle::{Checkpoint, Memory, Settings};
    use equipoise_core::message::CycleRecord;

    /// A sample of a force at a point of the surface with a free moment, plus an offset of the plate.
    fn sample(time_ns: u64, free_moment_nm: f64, offset: &Tare) -> GroundSample {
        let ([x, y, z], [fx, fy, fz]) = ([0.1, -0.2, 0.03], [15.0, -25.0, 700.0]);
        let moment_nm = [y * fz - z * fy, z * fx - x * fz, x * fy - y * fx + free_moment_nm];
        GroundSample {
            sample_time_ns: time_ns,
            force_n: std::array::from_fn(|axis| [fx, fy, fz][axis] + offset.force_n[axis]),
            moment_nm: std::array::from_fn(|axis| moment_nm[axis] + offset.moment_nm[axis]),
            surface_z_m: z,
            ..GroundSample::zeroed()
        }
    }

    fn history(first: Option<Tare>, tared_ns: &[u64]) -> TareHistory {
        let mut history = TareHistory::default();
        for due_ns in tared_ns {
            let cycle =
                CycleRecord { due_ns: *due_ns, command: CommandKind::Tare as u32, ..Zeroable::zeroed() };
            history.ingest(&TimedEntry { log_time_ns: *due_ns, entry: cycle.into() });
        }
        history.begin_with(first);
        history
    }

    #[test]
    fn the_free_moment_is_what_the_force_at_its_point_does_not_explain() {
        let offset = Tare { force_n: [1.0, -2.0, 30.0], moment_nm: [4.0, 5.0, -6.0], ..Tare::zeroed() };
        let tares = history(Some(offset), &[]);
        let mut moments = FreeMoments::new(&[Some(100), Some(200)], 50);
        for (time_ns, moment_nm) in [(60, 2.0), (140, 4.0), (199, -1.0), (300, 99.0)] {
            moments.ingest(&sample(time_ns, moment_nm, &offset), &tares);
        }
        assert!((moments.at(0) - 3.0).abs() < 1e-9 && (moments.at(1) + 1.0).abs() < 1e-9);
        assert!(moments.at(2).is_nan() && moments.surface_z_m() == 0.03);
        for not_measured in [Component::Shear as u32, Component::Tilt as u32, Component::FreeMoment as u32] {
            let part = GroundSample { not_measured, ..sample(0, 1.0, &offset) };
            assert_eq!(free_moment_nm(&part, &offset), None);
        }
    }

    #[test]
    fn between_samples_of_a_slower_ground_the_free_moment_is_interpolated() {
        const NS_PER_MS: u64 = 1_000_000;
        let tares = history(Some(Tare::zeroed()), &[]);
        let times_ns = [4, 8, 12, 16, 40, 71].map(|ms| (ms != 8).then_some(ms * NS_PER_MS));
        let mut moments = FreeMoments::new(&times_ns, 2 * NS_PER_MS);
        for (time_ns, moment_nm) in
            [(0, 0.0), (10 * NS_PER_MS, 10.0), (20 * NS_PER_MS, 20.0), (81 * NS_PER_MS, 81.0)]
        {
            moments.ingest(&sample(time_ns, moment_nm, &Tare::zeroed()), &tares);
        }
        let expected = [Some(4.0), None, Some(10.0), Some(16.0), None, None];
        for (instant, expected) in expected.into_iter().enumerate() {
            let moment_nm = Some(moments.at(instant)).filter(|moment_nm| moment_nm.is_finite());
            let is_equal =
                moment_nm.zip(expected).map_or(moment_nm == expected, |(a, b)| (a - b).abs() < 1e-9);
            assert!(is_equal, "{instant}: {moment_nm:?}");
        }
    }

    #[test]
    fn after_a_tare_command_the_free_moment_is_unavailable_until_a_checkpoint() {
        let tares = history(Some(Tare::zeroed()), &[150]);
        let mut moments = FreeMoments::new(&[Some(100), Some(200)], 50);
        for time_ns in [100, 200] {
            moments.ingest(&sample(time_ns, 1.0, &Tare::zeroed()), &tares);
        }
        assert!((moments.at(0) - 1.0).abs() < 1e-9 && moments.at(1).is_nan());
        assert!(history(None, &[]).at(100).is_none(), "no checkpoint: the tare is unavailable");
    }

    #[test]
    fn a_replay_begins_with_the_tare_of_the_first_checkpoint() {
        let tare = Tare { force_n: [1.0, -2.0, 30.0], ..Tare::zeroed() };
        let mut memory = bytemuck::zeroed_box::<Memory>();
        memory.start(&Settings::for_height(1.77));
        memory.resume_tare(&tare);
        let mut checkpoint = bytemuck::zeroed_box::<Checkpoint>();
        checkpoint.take(1, &memory);
        let mut history = TareHistory::default();
        history.ingest(&TimedEntry { log_time_ns: 500, entry: Entry::Checkpoint(checkpoint) });
        history.begin_with(Some(Tare::zeroed()));
        assert_eq!([0, 900].map(|time_ns| history.at(time_ns)), [Some(&tare); 2]);
    }
}
