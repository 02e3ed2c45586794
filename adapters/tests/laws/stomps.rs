//! Stomps: for any two streams, the result is an offset within its bounds, or an error text.

use equipoise_adapters::calibration::stomp::{Feet, Force, StompSettings, estimate, feet_of_heights};

use super::choices::Choices;

/// Any two streams, with arbitrary numbers and times.
pub(crate) fn stomp(bytes: &[u8]) {
    let mut choices = Choices::new(bytes);
    let any = choices.byte();
    let (mut plate, mut feet, mut heights) = (Vec::new(), Vec::new(), Vec::new());
    let (mut plate_ns, mut feet_ns) = (0_u64, 0_u64);
    while !choices.is_empty() && plate.len() < 4000 {
        if any == u8::MAX {
            plate.push(Force { time_ns: choices.large(), vertical_n: choices.real() });
            feet.push(Feet { time_ns: choices.large(), upward_m_per_s: [choices.real(), choices.real()] });
            heights.push((choices.large(), [choices.real(), choices.real()]));
        } else {
            plate_ns += u64::from(choices.byte()) * 100_000;
            feet_ns += u64::from(choices.byte()) * 100_000;
            plate.push(Force { time_ns: plate_ns, vertical_n: f64::from(choices.small()) / 32.0 });
            let speeds = [choices.byte(), choices.byte()].map(|speed| f64::from(speed.cast_signed()) / 40.0);
            feet.push(Feet { time_ns: feet_ns, upward_m_per_s: speeds });
            heights.push((feet_ns, speeds));
        }
    }
    let settings = StompSettings { offset_max_ns: u64::from(any) * 20_000_000, ..StompSettings::default() };
    for feet in [feet, feet_of_heights(&heights)] {
        match estimate(&plate, &feet, &settings) {
            Ok(found) => {
                assert!(found.offset_ns.unsigned_abs() <= settings.offset_max_ns, "{found:?}");
                assert!(
                    found.stomps >= 1 && found.stomps <= found.plate_hits.min(found.foot_stops),
                    "{found:?}"
                );
                assert!(found.sigma_ns > 0 && found.sigma_ns < 200_000_000, "{found:?}");
            }
            Err(refusal) => assert!(!refusal.to_string().is_empty()),
        }
    }
}
