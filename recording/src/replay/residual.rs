//! The loop's own residual: measured values minus those that the identified model predicts, including every load.

use std::fmt;

use equipoise_core::message::state::Phase;
use equipoise_core::message::{State, Validity};
use serde::Serialize;

/// Root mean squares over the samples of an identified subject.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Rms {
    /// Number of samples.
    pub moments: u64,
    /// Measured minus estimated centre of pressure, both axes together, mm.
    pub cop_mm: f64,
    /// Residual vertical external force, N.
    pub delta_f_n: f64,
}

/// The residual over a span.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Residual {
    started_ns: u64,
    span_s: Option<[f64; 2]>,
    last_ns: u64,
    static_poses: Sum,
    all: Sum,
}

#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Sum {
    moments: u64,
    cop_m2: f64,
    force_n2: f64,
}

impl Sum {
    fn rms(self) -> Option<Rms> {
        let root = |sum: f64| (sum / self.moments as f64).sqrt();
        (self.moments > 0).then(|| Rms {
            moments: self.moments,
            cop_mm: 1e3 * root(self.cop_m2),
            delta_f_n: root(self.force_n2),
        })
    }
}

impl Residual {
    /// Over a span in seconds since `started_ns`, or over all data.
    pub fn over(started_ns: u64, span_s: Option<[f64; 2]>) -> Residual {
        Residual { started_ns, span_s, ..Residual::default() }
    }

    /// Ingests a state; each suit sample counts once.
    pub fn ingest(&mut self, state: &State) {
        let is_new = state.suit_sample_time_ns > self.last_ns;
        let estimated = state.phase == Phase::Monitoring as u32 && state.cop_sigma_m[0] > 0.0;
        let time_s = (state.suit_sample_time_ns as f64 - self.started_ns as f64) * 1e-9;
        let is_in_span = self.span_s.is_none_or(|[from_s, to_s]| (from_s..to_s).contains(&time_s));
        if !is_new || !estimated || !is_in_span || state.validity().any_of(Validity::INVALIDATES_RESIDUAL) {
            return;
        }
        self.last_ns = state.suit_sample_time_ns;
        let difference_m = |axis: usize| state.cop_measured_m[axis] - state.cop_estimated_m[axis];
        let static_poses = (state.static_pose == 1).then_some(&mut self.static_poses);
        for sum in [Some(&mut self.all), static_poses].into_iter().flatten() {
            sum.moments += 1;
            sum.cop_m2 += difference_m(0).powi(2) + difference_m(1).powi(2);
            sum.force_n2 += state.delta_f_n[2].powi(2);
        }
    }

    /// For static poses; `None` without samples.
    pub fn static_poses(&self) -> Option<Rms> {
        self.static_poses.rms()
    }

    /// For static poses and motion; `None` without samples.
    pub fn all(&self) -> Option<Rms> {
        self.all.rms()
    }
}

impl Serialize for Residual {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeStruct;
        let mut fields = serializer.serialize_struct("Residual", 3)?;
        fields.serialize_field("span_s", &self.span_s)?;
        fields.serialize_field("still", &self.static_poses())?;
        fields.serialize_field("all", &self.all())?;
        fields.end()
    }
}

impl fmt::Display for Residual {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let span =
            self.span_s.map_or_else(String::new, |[from_s, to_s]| format!(" from {from_s} s to {to_s} s"));
        let Some(all) = self.all() else {
            return writeln!(f, "residual of the identified worker{span}: no moment could be compared");
        };
        writeln!(f, "residual of the identified worker{span}, loads included, RMS:")?;
        for (name, rms) in [("still", self.static_poses()), ("all", Some(all))] {
            if let Some(Rms { moments, cop_mm, delta_f_n }) = rms {
                writeln!(f, "  {name:<5} {moments:>7} moments  CoP {cop_mm:.2} mm  ΔF {delta_f_n:.2} N")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn state(second: u64, difference_m: [f64; 2], still: bool) -> State {
        State {
            suit_sample_time_ns: second * 1_000_000_000,
            phase: Phase::Monitoring as u32,
            static_pose: u32::from(still),
            cop_measured_m: difference_m,
            cop_sigma_m: [0.003; 2],
            delta_f_n: [0.0, 0.0, -5.0],
            ..State::zeroed()
        }
    }

    #[test]
    fn samples_of_an_identified_subject_in_the_span_count_once() {
        let mut residual = Residual::over(10_000_000_000, Some([1.0, 4.0]));
        assert!(residual.to_string().contains("no moment"), "{residual}");
        residual.ingest(&state(10, [1.0, 1.0], true));
        for _ in 0..3 {
            residual.ingest(&state(11, [0.003, 0.004], true));
        }
        residual.ingest(&state(12, [0.0, 0.001], false));
        residual.ingest(&State { valid: Validity::FEET_OFF_PLATE.0, ..state(13, [1.0, 1.0], true) });
        residual.ingest(&State { phase: Phase::Identifying as u32, ..state(13, [1.0, 1.0], true) });
        residual.ingest(&state(14, [1.0, 1.0], true));
        assert_eq!(residual.static_poses(), Some(Rms { moments: 1, cop_mm: 5.0, delta_f_n: 5.0 }));
        let all = residual.all().unwrap();
        assert!(all.moments == 2 && (all.cop_mm - 13.0_f64.sqrt()).abs() < 1e-9, "{all:?}");
        let json = serde_json::to_value(residual).unwrap();
        assert_eq!((&json["span_s"][1], &json["still"]["moments"]), (&4.0.into(), &1.into()));
        assert!(residual.to_string().contains("from 1 s to 4 s"), "{residual}");
    }
}
