//! `[ground.amti]`: AMTI plates with a serial port.

use equipoise_adapters::ground::GroundDevice;
use equipoise_adapters::ground::device::amti::{Amti, AmtiSettings, METRE_PER_INCH, NEWTON_PER_LBF, Rate};
use equipoise_adapters::source::{Flow, SourceError, Transport};
use equipoise_adapters::wire::amti::{CHANNELS, SPEED_SLOW};
use serde::{Deserialize, Serialize};

use super::numbers::{SUMMANDS, is_summand};
use super::serial::{self, SerialDefaults};
use super::{GroundConfig, z_down};
use crate::method::Checked;

/// Initial baud rate, independent of the sampling rate.
const DEFAULTS: SerialDefaults = SerialDefaults { baud: SPEED_SLOW, flow: Flow::Free };
/// Rows of the matrix: Fx, Fy, Fz, Mx, My, Mz.
const ROWS: usize = 6;

/// `[ground.amti]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AmtiConfig {
    /// Frames per second: 50, 100 or 200.
    #[serde(default = "slowest")]
    pub rate_hz: u32,
    /// Calibration matrix of the plate's sheet: six rows (Fx, Fy, Fz, Mx, My, Mz) of twelve numbers, which convert
    /// counts to forces and moments.
    pub matrix: Vec<Vec<f64>>,
    /// Unit of the matrix's forces.
    pub force_unit: ForceUnit,
    /// Unit of the matrix's moments.
    pub moment_unit: MomentUnit,
    /// Without effect: accepted for one release, with a warning.
    #[serde(default, skip_serializing)]
    pub auto_zero: bool,
}

fn slowest() -> u32 {
    50
}

/// Units of force on AMTI's sheets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum ForceUnit {
    /// Newton.
    #[serde(rename = "N")]
    Newton,
    /// Pound of force.
    #[serde(rename = "lbf", alias = "lb")]
    PoundForce,
}

/// Units of moment on AMTI's sheets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum MomentUnit {
    /// Newton metre.
    #[serde(rename = "N m", alias = "Nm", alias = "N-m")]
    NewtonMetre,
    /// Pound of force times inch.
    #[serde(rename = "lbf in", alias = "lbf-in", alias = "in-lb")]
    PoundForceInch,
}

fn section(ground: &GroundConfig) -> Result<&AmtiConfig, SourceError> {
    ground.amti.as_ref().ok_or_else(|| SourceError::Unusable(format!("ground.amti: {MISSING}")))
}

const MISSING: &str = "must be given for an AMTI plate: the matrix of its calibration sheet, with its units";

fn rate(config: &AmtiConfig) -> Option<Rate> {
    Some(match config.rate_hz {
        50 => Rate::Hz50,
        100 => Rate::Hz100,
        200 => Rate::Hz200,
        _ => return None,
    })
}

fn matrix(config: &AmtiConfig) -> Option<[[f64; CHANNELS]; ROWS]> {
    let rows: Option<Vec<[f64; CHANNELS]>> =
        config.matrix.iter().map(|row| row.as_slice().try_into().ok()).collect();
    rows?.try_into().ok()
}

pub(super) fn device(ground: &GroundConfig) -> Result<Box<dyn GroundDevice>, SourceError> {
    let config = section(ground)?;
    let unfit = || SourceError::Unusable("ground.amti: see `equipoise check`".to_owned());
    Ok(Box::new(Amti::new(AmtiSettings {
        rate: rate(config).ok_or_else(unfit)?,
        matrix: matrix(config).ok_or_else(unfit)?,
        force_unit_n: match config.force_unit {
            ForceUnit::Newton => 1.0,
            ForceUnit::PoundForce => NEWTON_PER_LBF,
        },
        moment_unit_nm: match config.moment_unit {
            MomentUnit::NewtonMetre => 1.0,
            MomentUnit::PoundForceInch => NEWTON_PER_LBF * METRE_PER_INCH,
        },
    })))
}

pub(super) fn transport(ground: &GroundConfig) -> Result<Box<dyn Transport>, SourceError> {
    serial::line(ground, DEFAULTS)
}

pub(super) fn check(ground: &GroundConfig) -> Checked {
    serial::check(ground)?;
    if ground.serial.as_ref().is_some_and(|serial| serial.baud.is_some_and(|baud| baud != SPEED_SLOW)) {
        let what = format!(
            "AMTI plates are spoken to at {SPEED_SLOW} baud and change their speed by themselves: leave it out"
        );
        return Err(("ground.serial.baud", what));
    }
    let Some(config) = &ground.amti else { return Err(("ground.amti", MISSING.to_owned())) };
    if rate(config).is_none() {
        return Err(("ground.amti.rate_hz", format!("{} is not 50, 100 or 200", config.rate_hz)));
    }
    let Some(matrix) = matrix(config) else {
        let lengths: Vec<String> = config.matrix.iter().map(|row| row.len().to_string()).collect();
        let what = format!(
            "six rows of twelve numbers are expected, Fx, Fy, Fz, Mx, My, Mz; it has rows of {}",
            lengths.join(", ")
        );
        return Err(("ground.amti.matrix", what));
    };
    let names = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"];
    for (row, name) in matrix.iter().zip(names) {
        if row.iter().any(|factor| !is_summand(*factor)) || row.iter().all(|factor| *factor == 0.0) {
            return Err((
                "ground.amti.matrix",
                format!(
                    "the row of {name} is all zeros, or has an entry that is not {SUMMANDS}; copy it from the sheet"
                ),
            ));
        }
    }
    z_down::check(ground, "AMTI's plates")
}

#[cfg(test)]
mod tests {
    use crate::Config;

    const REST: &str =
        "station = \"s\"\n[suit]\nsource = \"mvn-udp\"\n[subject]\nid = \"a\"\nheight_m = 1.8\n";

    fn plate() -> String {
        let row = |first: usize| {
            let factors: Vec<String> = (0..12).map(|column| format!("{}.5", first + column)).collect();
            format!("  [{}],\n", factors.join(", "))
        };
        let rows: String = (0..6).map(row).collect();
        format!(
            "{REST}[ground]\nsource = \"amti-serial\"\n[ground.frame]\naxes = \"z-down\"\n[ground.serial]\n\
             port = \"/dev/serial/by-id/plate\"\n[ground.amti]\nrate_hz = 100\nforce_unit = \"lbf\"\n\
             moment_unit = \"lbf in\"\nmatrix = [\n{rows}]\n"
        )
    }

    fn refusal(text: &str) -> String {
        Config::parse(text, "c.toml").expect_err("must be refused").to_string()
    }

    #[test]
    fn the_example_is_a_plate() {
        let config = Config::parse(include_str!("../../../examples/sensors/amti.toml"), "amti.toml").unwrap();
        assert!(config.ground.device().unwrap().is_some() && config.ground.transport().unwrap().is_some());
    }

    #[test]
    fn a_plate_with_its_calibration_sheet_round_trips() {
        let config = Config::parse(&plate(), "c.toml").unwrap();
        assert!(config.ground.device().unwrap().is_some() && config.ground.transport().unwrap().is_some());
        assert_eq!(config.ground.location(), "ground.serial.port = /dev/serial/by-id/plate");
        assert_eq!(Config::parse(&config.to_toml(), "written").unwrap(), config);
    }

    #[test]
    fn missing_calibration_values_are_reported_by_key_and_line() {
        let message = refusal(&plate().replace("force_unit = \"lbf\"\n", ""));
        assert!(message.contains("missing field `force_unit`"), "{message}");
        let message = refusal(&plate().replace("\"lbf\"", "\"kgf\""));
        assert!(message.contains("line 15") && message.contains("`kgf` is not known"), "{message}");
        let message = refusal(&plate().replace("rate_hz = 100", "rate_hz = 60"));
        assert!(
            message.starts_with("c.toml, line 14: ground.amti.rate_hz: 60 is not 50, 100 or 200"),
            "{message}"
        );
        let message = refusal(&plate().replace("16.5],", "],"));
        assert!(message.contains("line 17: ground.amti.matrix: six rows of twelve"), "{message}");
        assert!(message.contains("rows of 12, 12, 12, 12, 12, 11"), "{message}");
        let zeros = format!("[{}]", ["0.0"; 12].join(", "));
        let row = plate().lines().nth(19).unwrap().trim().trim_end_matches(',').to_owned();
        assert!(refusal(&plate().replace(&row, &zeros)).contains("the row of Fz is all zeros"));
    }

    #[test]
    fn a_plate_is_not_zeroed_by_the_configuration() {
        let text = plate().replace("rate_hz = 100", "rate_hz = 100\nauto_zero = true");
        let config = Config::parse(&text, "c.toml").unwrap();
        assert_eq!(config.to_toml(), Config::parse(&plate(), "c.toml").unwrap().to_toml());
        let warnings = crate::renamed_keys(&text);
        assert!(
            warnings.len() == 1
                && warnings[0].contains("`ground.amti.auto_zero` has no effect")
                && warnings[0].contains("equipoise tare"),
            "{warnings:?}"
        );
    }

    #[test]
    fn the_axes_of_a_plate_are_required() {
        let message = refusal(&plate().replace("axes = \"z-down\"", ""));
        assert!(message.contains("ground.frame.axes: must be \"z-down\" for AMTI's plates"), "{message}");
        let message =
            refusal(&plate().replace("\"amti-serial\"", "\"amti-serial\"\nmeasures = \"reaction\""));
        assert!(message.contains("ground.measures: must be \"action\" for AMTI's plates"), "{message}");
    }

    #[test]
    fn a_serial_line_is_required_and_its_speed_is_optional() {
        let message = refusal(&plate().replace("[ground.serial]\nport = \"/dev/serial/by-id/plate\"\n", ""));
        assert!(message.contains("ground.serial: must be given for a device on a serial line"), "{message}");
        let message = refusal(&plate().replace("\"/dev/serial/by-id/plate\"", "\"COM3\""));
        assert!(message.starts_with("c.toml, line 12: ground.serial.port: COM3 is no path"), "{message}");
        let message = refusal(&plate().replace("by-id/plate\"\n", "by-id/plate\"\nbaud = 115200\n"));
        assert!(message.starts_with("c.toml, line 13: ground.serial.baud: AMTI plates"), "{message}");
        let message = refusal(&plate().replace("port =", "prot ="));
        assert!(message.contains("line 12: `prot` is not known; did you mean `port`?"), "{message}");
    }
}
