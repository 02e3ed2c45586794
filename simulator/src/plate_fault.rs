//! Faults of a plate, simulated at their physical cause: position, axes, channels, amplifier, feet.

use nalgebra::{UnitQuaternion, Vector2, Vector3};

use crate::burden::Span;
use crate::dynamics::Wrench;

/// A fault of a plate. Wrenches are those on the person, about the origin of the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PlateFault {
    /// Position differs from the configured one: all forces appear shifted by this, m.
    Offset(Vector2<f64>),
    /// Plate rotated to the left, rad: all forces appear rotated to the right.
    Yaw(f64),
    /// The moments that determine the centre of pressure along X and Y are amplified by 1 + this.
    Gain(Vector2<f64>),
    /// Crosstalk: each of the two moments contains this fraction of the other.
    Crosstalk(f64),
    /// The surface is higher above the sensor than configured, m.
    Height(f64),
    /// Vertical force and both moments are amplified by 1 + this: the centre of pressure is unchanged.
    ForceGain(f64),
    /// The zero of the moments drifts, like a moving pressure: m/s since the start of the span.
    Drift(Vector2<f64>),
    /// The same towards a bound (m) with a time constant (s).
    SettlingDrift(Vector2<f64>, f64),
    /// A filter of first order in the amplifier, Hz.
    LowPass(f64),
    /// One of four load cells has a gain of 1 + this; its position, m.
    LoadCell(f64, Vector2<f64>),
    /// A compliant sole: the centre of pressure lags within a play of this, m.
    Hysteresis(f64),
}

/// A plate with faults; it has a state, so samples must be in order.
#[derive(Debug, Clone, Default)]
pub struct FaultyPlate {
    faults: Vec<(PlateFault, Span)>,
    filtered: Option<Wrench>,
    play_m: Option<Vector2<f64>>,
    last_s: f64,
}

impl FaultyPlate {
    /// A plate with these faults.
    pub fn new(faults: Vec<(PlateFault, Span)>) -> FaultyPlate {
        FaultyPlate { faults, ..FaultyPlate::default() }
    }

    /// Output for a wrench at a time.
    pub fn feel(&mut self, wrench: Wrench, time_s: f64) -> Wrench {
        let step_s = time_s - self.last_s;
        self.last_s = time_s;
        let mut faulty = wrench;
        for index in 0..self.faults.len() {
            let (fault, span) = self.faults[index];
            let activation = span.activation(time_s);
            faulty = match fault {
                PlateFault::LowPass(hertz) if activation > 0.0 => self.low_passed(faulty, hertz, step_s),
                PlateFault::Hysteresis(play_m) => self.late(faulty, play_m * activation),
                PlateFault::Drift(m_per_s) if activation > 0.0 => {
                    moved(faulty, m_per_s * (activation * (time_s - span.from_s).max(0.0)))
                }
                PlateFault::SettlingDrift(bound_m, tau_s) if activation > 0.0 => moved(
                    faulty,
                    bound_m * (activation * (1.0 - (-(time_s - span.from_s).max(0.0) / tau_s).exp())),
                ),
                _ => at_once(fault, faulty, activation),
            };
        }
        faulty
    }

    fn low_passed(&mut self, wrench: Wrench, hertz: f64, step_s: f64) -> Wrench {
        let before = self.filtered.unwrap_or(wrench);
        let kept = (-core::f64::consts::TAU * hertz * step_s).exp();
        let filtered = Wrench {
            force_n: before.force_n * kept + wrench.force_n * (1.0 - kept),
            moment_nm: before.moment_nm * kept + wrench.moment_nm * (1.0 - kept),
        };
        self.filtered = Some(filtered);
        filtered
    }

    fn late(&mut self, wrench: Wrench, play_m: f64) -> Wrench {
        let here = wrench.cop_m();
        let before = self.play_m.unwrap_or(here);
        // The end of the play follows once it is taut.
        let behind = here - before;
        let taut = (behind.norm() - play_m.abs()).max(0.0);
        let there = behind.try_normalize(1e-12).map_or(before, |along| before + along * taut);
        self.play_m = Some(there);
        moved(wrench, there - here)
    }
}

/// Shifts the point of action by this much.
fn moved(wrench: Wrench, by_m: Vector2<f64>) -> Wrench {
    Wrench { moment_nm: wrench.moment_nm + by_m.push(0.0).cross(&wrench.force_n), ..wrench }
}

/// A fault without state.
fn at_once(fault: PlateFault, wrench: Wrench, activation: f64) -> Wrench {
    let Wrench { force_n, moment_nm } = wrench;
    let moments = |x_nm: f64, y_nm: f64| Wrench { moment_nm: Vector3::new(x_nm, y_nm, moment_nm.z), force_n };
    match fault {
        PlateFault::Offset(by_m) => moved(wrench, by_m * activation),
        PlateFault::Yaw(radians) => {
            let plate_from_world = UnitQuaternion::from_scaled_axis(Vector3::z() * (-radians * activation));
            Wrench { force_n: plate_from_world * force_n, moment_nm: plate_from_world * moment_nm }
        }
        // The moment about Y determines the position along X.
        PlateFault::Gain(more) => {
            moments(moment_nm.x * (1.0 + more.y * activation), moment_nm.y * (1.0 + more.x * activation))
        }
        PlateFault::Crosstalk(seen) => moments(
            moment_nm.x - seen * activation * moment_nm.y,
            moment_nm.y - seen * activation * moment_nm.x,
        ),
        PlateFault::Height(up_m) => {
            let up = Vector3::z() * (up_m * activation);
            Wrench { moment_nm: moment_nm + up.cross(&force_n), force_n }
        }
        PlateFault::ForceGain(more) => {
            let gain = 1.0 + more * activation;
            Wrench {
                force_n: Vector3::new(force_n.x, force_n.y, force_n.z * gain),
                moment_nm: Vector3::new(moment_nm.x * gain, moment_nm.y * gain, moment_nm.z),
            }
        }
        PlateFault::LoadCell(more, cell_m) => {
            let at = wrench.cop_m().component_div(&cell_m);
            let cell_n = 0.25 * force_n.z * (1.0 + at.x) * (1.0 + at.y);
            let extra = Wrench::at(cell_m.push(0.0), Vector3::z() * (more * activation * cell_n));
            Wrench { force_n: force_n + extra.force_n, moment_nm: moment_nm + extra.moment_nm }
        }
        PlateFault::Drift(_)
        | PlateFault::SettlingDrift(..)
        | PlateFault::LowPass(_)
        | PlateFault::Hysteresis(_) => wrench,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn standing() -> Wrench {
        Wrench::at(Vector3::new(0.06, -0.03, 0.0), Vector3::new(25.0, -10.0, 700.0))
    }

    fn reported(fault: PlateFault) -> Wrench {
        FaultyPlate::new(vec![(fault, Span::ALWAYS)]).feel(standing(), 5.0)
    }

    #[test]
    fn each_fault_does_to_pressure_what_its_name_says() {
        let here = standing().cop_m();
        let to = |fault| reported(fault).cop_m();
        let is = |found: Vector2<f64>, expected: Vector2<f64>| {
            assert!((found - expected).norm() < 1e-12, "{found:?} {expected:?}");
        };
        is(to(PlateFault::Offset(Vector2::new(0.01, 0.02))), here + Vector2::new(0.01, 0.02));
        is(to(PlateFault::Gain(Vector2::new(0.1, -0.1))), Vector2::new(here.x * 1.1, here.y * 0.9));
        is(to(PlateFault::Crosstalk(0.05)), here + Vector2::new(here.y, here.x) * 0.05);
        is(to(PlateFault::ForceGain(0.02)), here);
        is(to(PlateFault::Height(0.04)), here - Vector2::new(25.0, -10.0) / 700.0 * 0.04);
        let (sin, cos) = 0.1_f64.sin_cos();
        is(to(PlateFault::Yaw(0.1)), Vector2::new(cos * here.x + sin * here.y, cos * here.y - sin * here.x));
        assert!((reported(PlateFault::ForceGain(0.02)).force_n.z - 714.0).abs() < 1e-9);
        // The load cell of the pressure's quadrant carries more than a quarter of the weight.
        let more_n = reported(PlateFault::LoadCell(0.1, Vector2::new(0.2, -0.15))).force_n.z - 700.0;
        assert!((0.1 * 0.25 * 700.0 * 1.3 * 1.2 - more_n).abs() < 1e-9, "{more_n}");
    }

    #[test]
    fn a_drift_goes_on_and_a_settling_one_settles() {
        let span = Span { from_s: 10.0, to_s: f64::INFINITY, flips_at_s: None };
        let along = Vector2::new(0.001, 0.0);
        let mut drift = FaultyPlate::new(vec![(PlateFault::Drift(along), span)]);
        let mut settling = FaultyPlate::new(vec![(PlateFault::SettlingDrift(along, 5.0), span)]);
        let mut by = |time_s: f64| {
            [&mut drift, &mut settling]
                .map(|plate| (plate.feel(standing(), time_s).cop_m() - standing().cop_m()).x)
        };
        assert_eq!(by(9.0), [0.0; 2]);
        let [drifted_m, settled_m] = by(60.0);
        assert!((drifted_m - 0.050).abs() < 1e-12 && (settled_m - 0.001).abs() < 1e-6);
    }

    #[test]
    fn a_filter_and_a_play_come_after() {
        let mut filter = FaultyPlate::new(vec![(PlateFault::LowPass(1.0), Span::ALWAYS)]);
        let mut play = FaultyPlate::new(vec![(PlateFault::Hysteresis(0.004), Span::ALWAYS)]);
        let step = Wrench::at(Vector3::new(0.10, -0.03, 0.0), Vector3::new(0.0, 0.0, 700.0));
        let rest = Wrench::at(Vector3::new(0.06, -0.03, 0.0), Vector3::new(0.0, 0.0, 700.0));
        for plate in [&mut filter, &mut play] {
            assert!((plate.feel(rest, 0.0).cop_m() - rest.cop_m()).norm() < 1e-12);
        }
        let mut after = filter.feel(step, 0.001);
        for millisecond in 2..160 {
            after = filter.feel(step, 0.001 * f64::from(millisecond));
        }
        let activation = (after.cop_m().x - 0.06) / 0.04;
        assert!((activation - (1.0 - (-1.0_f64).exp())).abs() < 0.01, "{activation}");
        assert!((play.feel(step, 0.001).cop_m().x - 0.096).abs() < 1e-12);
        assert!((play.feel(rest, 0.002).cop_m().x - 0.064).abs() < 1e-12);
    }
}
