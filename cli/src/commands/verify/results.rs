//! Results of a verification, as text and as JSON.

use std::fmt::Write;

use equipoise_adapters::calibration::verify::Placed;
use equipoise_adapters::calibration::verify::places::{Estimate, Geometry, geometry};
use equipoise_adapters::calibration::verify::rod::Tip;
use equipoise_adapters::ground::GroundFrame;
use serde_json::{Value, json};

use crate::client;

/// Results for a mass at one or several places.
pub(super) struct MassResult {
    pub(super) mass_kg: f64,
    pub(super) tolerance_percent: f64,
    pub(super) placed: Vec<Placed>,
    /// Force of the empty plate at the start, N, and its change until the end.
    pub(super) zero_n: f64,
    pub(super) zero_drift_n: Option<f64>,
    pub(super) geometry: Option<Geometry>,
}

/// Pose of a station's plate; the specified positions of the mass refer to the plate's origin and axes.
///
/// # Errors
/// The station's configuration cannot be read, or another process reads the plate and has its configuration.
pub(super) fn frame_of(station: &str) -> anyhow::Result<GroundFrame> {
    let config = client::active_configuration_of(station)?;
    client::own_ground(&config, "[ground.frame]")?;
    Ok(config.ground.settings().frame)
}

/// Compares the measured positions of the mass with the specified ones `at_m`, in the plate's frame, m.
pub(super) fn geometry_of(placed: &[Placed], at_m: &[[f64; 2]], frame: &GroundFrame) -> Option<Geometry> {
    let (sine, cosine) = frame.yaw_rad.sin_cos();
    let in_plate = |[x, y]: [f64; 2]| {
        let [x, y] = [x - frame.origin_m[0], y - frame.origin_m[1]];
        [cosine * x + sine * y, cosine * y - sine * x]
    };
    let seen_m: Vec<[f64; 2]> = placed.iter().map(|placed| in_plate(placed.cop_m)).collect();
    geometry(&seen_m, at_m)
}

impl MassResult {
    fn percent(&self, placed: &Placed) -> f64 {
        100.0 * (placed.mass_kg / self.mass_kg - 1.0)
    }

    /// The error of the largest magnitude, with sign, %.
    pub(super) fn worst_percent(&self) -> f64 {
        let all = self.placed.iter().map(|placed| self.percent(placed));
        all.max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(f64::NAN)
    }

    pub(super) fn text(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ =
            writeln!(text, "place      mass kg       ±    error %        at x, y mm        ± mm     drift N");
        for (index, placed) in self.placed.iter().enumerate() {
            let ([x, y], [sx, sy]) = (placed.cop_m, placed.cop_sigma_m);
            let _ = writeln!(
                text,
                "{:>5}    {:>9.3} {:>7.3}   {:>+8.2}   {:>8.1} {:>8.1}   {:>4.1} {:>4.1}   {:>+7.2}",
                index + 1,
                placed.mass_kg,
                placed.mass_sigma_kg,
                self.percent(placed),
                1e3 * x,
                1e3 * y,
                1e3 * sx,
                1e3 * sy,
                placed.drift_n
            );
        }
        let zero =
            self.zero_drift_n.map_or_else(String::new, |drift_n| format!(", {drift_n:+.2} N since then"));
        let _ = writeln!(text, "empty it showed {:.2} N{zero}", self.zero_n);
        if let Some(geometry) = &self.geometry {
            write_geometry(&mut text, geometry);
        }
        let worst = self.worst_percent();
        let verdict = if worst.abs() <= self.tolerance_percent { "within" } else { "beyond" };
        let _ = writeln!(text, "{worst:+.2} % at most: {verdict} {} %", self.tolerance_percent);
        text
    }

    pub(super) fn json(&self) -> Value {
        let places: Vec<Value> = self
            .placed
            .iter()
            .map(|placed| {
                json!({
                    "mass_kg": placed.mass_kg, "mass_sigma_kg": placed.mass_sigma_kg,
                    "error_percent": self.percent(placed),
                    "cop_m": placed.cop_m, "cop_sigma_m": placed.cop_sigma_m, "drift_n": placed.drift_n,
                })
            })
            .collect();
        json!({
            "mass_kg": self.mass_kg,
            "tolerance_percent": self.tolerance_percent,
            "worst_percent": self.worst_percent(),
            "within": self.worst_percent().abs() <= self.tolerance_percent,
            "places": places,
            "zero_n": self.zero_n,
            "zero_drift_n": self.zero_drift_n,
            "geometry": self.geometry.as_ref().map(geometry_json),
        })
    }
}

fn write_geometry(text: &mut String, found: &Geometry) {
    let line = |text: &mut String, what: &str, estimate: Estimate, scale: f64, unit: &str| {
        let is_significant = estimate.value.abs() > 2.0 * estimate.sigma;
        let verdict = if is_significant { "" } else { "   (nothing to see)" };
        let _ = writeln!(
            text,
            "{what:<26} {:>+7.2} ± {:.2} {unit}{verdict}",
            scale * estimate.value,
            scale * estimate.sigma
        );
    };
    line(text, "distances along x are off", found.scale_x, 100.0, "%");
    line(text, "distances along y are off", found.scale_y, 100.0, "%");
    line(text, "the axes are turned by", found.turned_rad, 1f64.to_degrees(), "°");
    for (axis, estimate) in ["x", "y"].iter().zip(found.origin_m) {
        line(text, &format!("the origin is off in {axis}"), estimate, 1e3, "mm");
    }
}

fn geometry_json(found: &Geometry) -> Value {
    let estimate = |estimate: Estimate| json!({ "value": estimate.value, "sigma": estimate.sigma });
    json!({
        "scale_x": estimate(found.scale_x), "scale_y": estimate(found.scale_y),
        "turned_rad": estimate(found.turned_rad),
        "origin_x_m": estimate(found.origin_m[0]), "origin_y_m": estimate(found.origin_m[1]),
        "left_m": found.left_m,
    })
}

/// A rod's tip on the surface.
pub(super) struct Rod {
    pub(super) tip: Tip,
    /// Height of the surface according to the active frame, world, m.
    pub(super) configured_z_m: f64,
}

impl Rod {
    fn higher_m(&self) -> f64 {
        self.tip.at_m[2] - self.configured_z_m
    }

    pub(super) fn text(&self) -> String {
        let Tip { at_m: [x, y, z], sigma_m, shear_n, blocks } = self.tip;
        let mut text = format!(
            "the tip was at {:.1}, {:.1} mm, {:.1} ± {:.1} mm high ({:.1} s, {shear_n:.0} N of shear)\n",
            1e3 * x,
            1e3 * y,
            1e3 * z,
            1e3 * sigma_m[2],
            blocks as f64 / 10.0
        );
        let (deviation_mm, sigma_mm) = (1e3 * self.higher_m(), 1e3 * sigma_m[2]);
        let _ = if deviation_mm.abs() > 2.0 * sigma_mm {
            writeln!(
                text,
                "the surface is {:.1} ± {sigma_mm:.1} mm {} than [ground.frame] says: change surface_height_m by {:+.4}",
                deviation_mm.abs(),
                if deviation_mm > 0.0 { "higher" } else { "lower" },
                self.higher_m()
            )
        } else {
            writeln!(text, "the surface agrees with [ground.frame] within the uncertainty")
        };
        text
    }

    pub(super) fn json(&self) -> Value {
        json!({
            "tip_m": self.tip.at_m, "tip_sigma_m": self.tip.sigma_m, "shear_n": self.tip.shear_n,
            "configured_surface_z_m": self.configured_z_m, "higher_m": self.higher_m(),
        })
    }
}
