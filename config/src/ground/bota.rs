//! `[ground.bota]`: sensors of Bota and Rokubi over a serial port.

use equipoise_adapters::ground::GroundDevice;
use equipoise_adapters::ground::device::bota::{Bota, BotaSettings};
use equipoise_adapters::source::{Flow, SourceError, Transport};
use equipoise_adapters::wire::bota::{FRAME_SIZE, RATE_TIMES_SINC_HZ, SPEED, SPEEDS};
use serde::{Deserialize, Serialize};

use super::GroundConfig;
use super::serial::{self, SerialDefaults};
use crate::method::{Checked, between};

const DEFAULTS: SerialDefaults = SerialDefaults { baud: SPEED, flow: Flow::Free };
/// Start, eight bits, stop.
const BITS_PER_BYTE: u32 = 10;

/// `[ground.bota]`: without keys, the sensor's settings are not changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BotaConfig {
    /// Length of the sensor's filter, set at each start; the sensor then sends 51200 / sinc frames per second.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sinc: Option<u32>,
}

fn sinc(ground: &GroundConfig) -> Option<u32> {
    ground.bota.as_ref().and_then(|config| config.sinc)
}

pub(super) fn device(ground: &GroundConfig) -> Result<Box<dyn GroundDevice>, SourceError> {
    Ok(Box::new(Bota::new(BotaSettings { baud: serial::baud(ground, DEFAULTS), sinc: sinc(ground) })))
}

pub(super) fn transport(ground: &GroundConfig) -> Result<Box<dyn Transport>, SourceError> {
    serial::line(ground, DEFAULTS)
}

pub(super) fn check(ground: &GroundConfig) -> Checked {
    serial::check(ground)?;
    let baud = serial::baud(ground, DEFAULTS);
    if !SPEEDS.contains(&baud) {
        let valid: Vec<String> = SPEEDS.iter().map(u32::to_string).collect();
        return Err(("ground.serial.baud", format!("a Bota sensor has {}, not {baud}", valid.join(", "))));
    }
    let Some(sinc) = sinc(ground) else { return Ok(()) };
    between("ground.bota.sinc", f64::from(sinc), 51.0, 2048.0)?;
    let (rate_hz, line_hz) = (RATE_TIMES_SINC_HZ / sinc, baud / (BITS_PER_BYTE * FRAME_SIZE as u32));
    if rate_hz > line_hz {
        let what = format!(
            "{sinc} makes {rate_hz} frames a second, and {baud} baud carry {line_hz}: take a longer filter"
        );
        return Err(("ground.bota.sinc", what));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::Config;

    const SENSOR: &str = "station = \"s\"\n[suit]\nsource = \"mvn-udp\"\n[subject]\nid = \"a\"\nheight_m = 1.8\n[ground]\n\
                          source = \"bota-serial\"\n[ground.serial]\nport = \"/dev/ttyUSB0\"\n";

    fn refusal(rest: &str) -> String {
        Config::parse(&format!("{SENSOR}{rest}"), "c.toml").expect_err("must be refused").to_string()
    }

    #[test]
    fn a_port_is_sufficient_and_a_filter_must_fit_the_line() {
        let config = Config::parse(SENSOR, "c.toml").unwrap();
        assert!(config.ground.device().unwrap().is_some() && config.ground.transport().unwrap().is_some());
        let example = include_str!("../../../examples/sensors/bota.toml");
        assert_eq!(Config::parse(example, "bota.toml").unwrap().ground.bota.unwrap().sinc, Some(256));

        let message = refusal("baud = 1000000\n");
        assert!(
            message.starts_with("c.toml, line 11: ground.serial.baud: a Bota sensor has 9600, 57600"),
            "{message}"
        );
        let message = refusal("[ground.bota]\nsinc = 5\n");
        assert!(
            message.starts_with("c.toml, line 12: ground.bota.sinc: 5 is not between 51 and 2048"),
            "{message}"
        );
        let message = refusal("baud = 57600\n[ground.bota]\nsinc = 100\n");
        assert!(message.contains("100 makes 512 frames a second, and 57600 baud carry 155"), "{message}");
    }
}
