//! Time of each joint at each level, and its closest approach to the limit.

use equipoise_core::body::{JOINTS, Joint};
use equipoise_core::message::{State, Validity};
use equipoise_core::overload::Level;
use equipoise_view::levels::severity;
use equipoise_view::words;

use crate::constants::COLUMN_S;

/// Number of levels, including `none` and `undecided`.
pub const LEVELS: usize = 6;

/// The closest approach of a joint to its limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Time since the start of the recording, s.
    pub time_s: f64,
    /// Magnitude of the overload torque, N m.
    pub torque_nm: f64,
    /// Its 1-σ, N m.
    pub sigma_nm: f64,
    /// Torque divided by the joint's limit.
    pub limit_ratio: f64,
    /// Mass and reach of the load at that time, kg and m; `None` if the mass was invalid.
    pub load: Option<[f64; 2]>,
}

impl Peak {
    /// The limit ratio with its 1-σ in per cent, as text; without σ for a zero torque, whose limit is unavailable.
    pub fn percent(&self) -> String {
        let Peak { limit_ratio, sigma_nm, torque_nm, .. } = *self;
        if torque_nm > 0.0 {
            format!("{:.0} % ± {:.0} %", 100.0 * limit_ratio, 100.0 * limit_ratio * sigma_nm / torque_nm)
        } else {
            format!("{:.0} %", 100.0 * limit_ratio)
        }
    }
}

/// Exposure of one joint.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct JointExposure {
    /// Time at each level while torques were valid, by the level's number, s.
    pub level_s: [f64; LEVELS],
    /// Time as the joint closest to its limit, s.
    pub worst_s: f64,
    /// Closest approach to the limit.
    pub peak: Option<Peak>,
    /// Final fatigue, 0 to 1.
    pub fatigue: f64,
    /// Largest fatigue, 0 to 1.
    pub fatigue_max: f64,
}

/// The highest level of every joint in one interval; `None` without a valid torque.
pub type Column = [Option<Level>; JOINTS];

/// All joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Exposure {
    /// In the order of the joints' indices.
    pub joints: [JointExposure; JOINTS],
    /// Time of each level as the highest of all joints, by the level's number, s.
    pub highest_level_s: [f64; LEVELS],
    /// Duration of valid torques, s.
    pub valid_s: f64,
    /// Intervals of `COLUMN_S` by their number since the start of the recording.
    pub columns: Vec<(i64, Column)>,
}

impl Default for Exposure {
    fn default() -> Exposure {
        Exposure {
            joints: [JointExposure::default(); JOINTS],
            highest_level_s: [0.0; LEVELS],
            valid_s: 0.0,
            columns: Vec::new(),
        }
    }
}

impl Exposure {
    /// Adds one state, which represents `step_s`.
    pub fn ingest(&mut self, state: &State, time_s: f64, step_s: f64) {
        for (joint, fatigue) in self.joints.iter_mut().zip(state.fatigue) {
            joint.fatigue = fatigue;
            joint.fatigue_max = joint.fatigue_max.max(fatigue);
        }
        let Some(worst) = state.unless(Validity::INVALIDATES_TORQUES, state.worst_joint) else { return };
        self.valid_s += step_s;
        let number = (time_s / COLUMN_S).floor() as i64;
        if self.columns.last().is_none_or(|(last, _)| *last != number) {
            self.columns.push((number, [None; JOINTS]));
        }
        let mut highest_level = Level::None;
        for joint in Joint::ALL {
            let index = joint.index();
            let level = Level::from_number(state.joint_level[index]).unwrap_or(Level::None);
            if severity(level) > severity(highest_level) {
                highest_level = level;
            }
            let exposure = &mut self.joints[index];
            exposure.level_s[level as usize] += step_s;
            exposure.ingest_joint(state, joint, time_s);
            if worst as usize == index {
                exposure.worst_s += step_s;
            }
            if let Some((_, column)) = self.columns.last_mut() {
                let highest = &mut column[index];
                *highest = (*highest).into_iter().chain([level]).max_by_key(|level| severity(*level));
            }
        }
        self.highest_level_s[highest_level as usize] += step_s;
    }

    /// The joint with the largest limit ratio, and its peak.
    pub fn highest_peak(&self) -> Option<(Joint, Peak)> {
        let peaks =
            Joint::ALL.into_iter().filter_map(|joint| Some((joint, self.joints[joint.index()].peak?)));
        peaks.max_by(|(_, a), (_, b)| a.limit_ratio.total_cmp(&b.limit_ratio))
    }

    /// The joint that was closest to its limit for the longest time; the larger peak decides between equal times.
    pub fn worst(&self) -> Option<Joint> {
        let by = |joint: &Joint| {
            let exposure = &self.joints[joint.index()];
            (exposure.worst_s, exposure.peak.map_or(0.0, |peak| peak.limit_ratio))
        };
        Joint::ALL
            .into_iter()
            .filter(|joint| self.joints[joint.index()].worst_s > 0.0)
            .max_by(|a, b| by(a).partial_cmp(&by(b)).unwrap_or(core::cmp::Ordering::Equal))
    }
}

impl JointExposure {
    fn ingest_joint(&mut self, state: &State, joint: Joint, time_s: f64) {
        let limit_nm = state.torque_limit_nm[joint.index()];
        if limit_nm <= 0.0 {
            return;
        }
        let torque_nm = words::torque_nm(state, joint);
        let limit_ratio = torque_nm / limit_nm;
        if self.peak.is_none_or(|peak| limit_ratio > peak.limit_ratio) {
            let sigma_nm = state.torque_sigma_nm[joint.index()];
            let load = state
                .unless(Validity::INVALIDATES_LIFTED_MASS, [state.lifted_mass_kg, state.reach_m])
                .filter(|[mass_kg, _]| *mass_kg > 0.0);
            self.peak = Some(Peak { time_s, torque_nm, sigma_nm, limit_ratio, load });
        }
    }

    /// Time at a level, s.
    pub fn at(&self, level: Level) -> f64 {
        self.level_s[level as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn time_counts_at_its_level_and_invalid_time_at_none() {
        let mut exposure = Exposure::default();
        let mut state = State::zeroed();
        state.joint_level = [Level::Green as u32; JOINTS];
        (state.torque_nm[3], state.torque_limit_nm[3], state.worst_joint) = ([0.0, 30.0, 40.0], 100.0, 3);
        exposure.ingest(&state, 0.1, 0.01);
        state.joint_level[3] = Level::Red as u32;
        exposure.ingest(&state, 0.2, 0.01);
        state.valid = Validity::MOVING.0;
        state.torque_nm[3] = [0.0, 300.0, 400.0];
        exposure.ingest(&state, 1.3, 0.01);
        let joint = &exposure.joints[3];
        assert_eq!((joint.at(Level::Green), joint.at(Level::Red), joint.at(Level::None)), (0.01, 0.01, 0.0));
        assert_eq!(joint.peak.map(|peak| (peak.torque_nm, peak.limit_ratio)), Some((50.0, 0.5)));
        assert_eq!((exposure.valid_s, exposure.worst()), (0.02, Some(Joint::ALL[3])));
        let highest_s = [Level::Green, Level::Red].map(|level| exposure.highest_level_s[level as usize]);
        assert_eq!(highest_s, [0.01, 0.01]);
        let highest = exposure.highest_peak().map(|(joint, peak)| (joint, peak.percent()));
        assert_eq!(highest, Some((Joint::ALL[3], "50 % ± 0 %".to_owned())));
        assert_eq!(exposure.columns.len(), 1, "no valid torque in the second after");
        assert_eq!(exposure.columns[0].1[3], Some(Level::Red));
    }

    #[test]
    fn a_column_with_an_undecided_torque_is_not_low() {
        let mut exposure = Exposure::default();
        let mut column_after = |level: Level| {
            exposure.ingest(&State { joint_level: [level as u32; JOINTS], ..State::zeroed() }, 0.1, 0.01);
            exposure.columns[0].1[3]
        };
        assert_eq!(column_after(Level::Undecided), Some(Level::Undecided));
        assert_eq!(column_after(Level::Green), Some(Level::Undecided));
        assert_eq!(column_after(Level::Orange), Some(Level::Orange));
    }
}
