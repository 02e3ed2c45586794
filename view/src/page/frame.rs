//! What the page draws: one frame, and its JSON.

use std::collections::BTreeMap;
use std::io;

use equipoise_core::body::SEGMENTS;
use equipoise_core::cycle::POSE_REACHED_RAD;
use equipoise_core::message::State;
use equipoise_core::time::seconds;
use serde::Serialize;
use serde_json::Serializer;
use serde_json::ser::{CompactFormatter, Formatter};

use super::demo::{SimulatedCobot, SimulatedHuman};
use crate::banner::Headline;
use crate::state_json::StateJson;
use crate::suggested_pose::SuggestedPose;
use crate::words;

/// What the page shows at one moment.
#[derive(Debug, Clone, PartialEq)]
pub struct PageFrame {
    /// The newest state.
    pub state: State,
    /// The pose to take, if one is asked for.
    pub suggested: Option<SuggestedPose>,
    /// The predicted 1-σ of the CoP at which the identification stops, m; draws the progress bar.
    pub cop_sigma_target_m: Option<f64>,
    /// The plate's corners in the station's world, in turn, m.
    pub plate_corners_m: Option<[[f64; 2]; 4]>,
    /// The simulated human of a demonstration.
    pub simulated: Option<SimulatedHuman>,
    /// The simulated cobot of a demonstration.
    pub cobot: Option<SimulatedCobot>,
}

impl PageFrame {
    /// A frame of nothing but a state.
    pub fn new(state: State) -> PageFrame {
        PageFrame {
            state,
            suggested: None,
            cop_sigma_target_m: None,
            plate_corners_m: None,
            simulated: None,
            cobot: None,
        }
    }

    /// The object that the page's script reads: the state, and what it means in words.
    pub(super) fn to_text(&self, headline: &Headline) -> serde_json::Result<String> {
        let state = &self.state;
        let frame = FrameJson {
            state: self.state_json(),
            headline,
            withheld: words::withheld(state),
            worst: words::headline_joint(state).map(|(joint, level)| Worst {
                joint: joint.name(),
                text: words::joint(joint),
                level: level.name(),
                fatigue: Some(state.fatigue[joint.index()]).filter(|fatigue| fatigue.is_finite()),
            }),
            advice: words::advice(state),
            advice_name: words::advice_name(state),
            segment_origin_m: state.segment_origin_m().map(|origins_m| drawn(*origins_m)),
            suggested: self.suggested.as_ref().map(|pose| Suggested {
                name: pose.name.as_ref(),
                segment_origin_m: drawn(pose.segment_origin_m),
            }),
            pose_reached_rad: POSE_REACHED_RAD,
            cop_sigma_target_m: self.cop_sigma_target_m,
            plate_corners_m: self.plate_corners_m,
            simulated: self.simulated,
            cobot: self.cobot,
        };
        let mut text = Vec::new();
        frame.serialize(&mut Serializer::with_formatter(&mut text, DisplayPrecision))?;
        String::from_utf8(text).map_err(serde::ser::Error::custom)
    }

    /// The name of the suggested pose.
    pub(super) fn pose(&self) -> Option<&str> {
        self.suggested.as_ref().map(|pose| pose.name.as_ref())
    }

    /// The state alone, its `t` on CLOCK_MONOTONIC.
    pub(super) fn state_json(&self) -> StateJson<'_> {
        StateJson::new(&self.state, seconds(self.state.time_ns))
    }
}

#[derive(Serialize)]
struct FrameJson<'a> {
    state: StateJson<'a>,
    #[serde(flatten)]
    headline: &'a Headline,
    /// Withheld quantities ([`Validity::FLAG_SETS`](equipoise_core::message::Validity::FLAG_SETS)) with the first reason.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    withheld: BTreeMap<&'static str, &'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    worst: Option<Worst>,
    #[serde(skip_serializing_if = "Option::is_none")]
    advice: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    advice_name: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    segment_origin_m: Option<[[f64; 3]; SEGMENTS]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    suggested: Option<Suggested<'a>>,
    pose_reached_rad: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    cop_sigma_target_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    plate_corners_m: Option<[[f64; 2]; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    simulated: Option<SimulatedHuman>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cobot: Option<SimulatedCobot>,
}

#[derive(Serialize)]
struct Suggested<'a> {
    name: &'a str,
    segment_origin_m: [[f64; 3]; SEGMENTS],
}

/// Writes numbers with four decimals and at least five significant digits, more than the page displays.
struct DisplayPrecision;

impl Formatter for DisplayPrecision {
    fn write_f64<W: ?Sized + io::Write>(&mut self, writer: &mut W, value: f64) -> io::Result<()> {
        CompactFormatter.write_f64(writer, rounded(value))
    }
}

fn rounded(value: f64) -> f64 {
    let decimals = (4.0 - value.abs().log10().floor()).clamp(4.0, 20.0);
    let scale = 10_f64.powf(decimals);
    let result = (value * scale).round() / scale;
    if result.is_finite() { result } else { value }
}

/// A picture needs no more than tenths of a millimetre, and sixty a second are half as long with them.
fn drawn(origins_m: [[f64; 3]; SEGMENTS]) -> [[f64; 3]; SEGMENTS] {
    origins_m.map(|origin| origin.map(|metres| (metres * 1e4).round() / 1e4))
}

#[derive(Serialize)]
struct Worst {
    joint: &'static str,
    text: &'static str,
    level: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    fatigue: Option<f64>,
}

#[cfg(test)]
mod tests {
    use equipoise_core::body::{Joint, Segment};

    use super::rounded;

    #[test]
    fn numbers_have_four_decimals_or_five_digits() {
        for (value, expected) in [
            (0.0, "0"),
            (12_345.678_91, "12345.6789"),
            (-1.0 / 3.0, "-0.33333"),
            (5.123_456_7e-5, "0.000051235"),
            (f64::MAX, &f64::MAX.to_string()),
        ] {
            assert_eq!(rounded(value).to_string(), expected);
        }
    }

    /// The script has a copy of the body's tree, since it draws the lines of the figure.
    #[test]
    fn the_script_draws_the_body_of_core() {
        let parents: Vec<String> = Segment::ALL
            .iter()
            .map(|segment| segment.parent().map_or("-1".to_owned(), |parent| parent.index().to_string()))
            .collect();
        let joints: Vec<String> = Joint::ALL.iter().map(|joint| format!("\"{}\"", joint.name())).collect();
        let squeezed = |text: &str| text.split_whitespace().collect::<String>().replace(",]", "]");
        let script = squeezed(include_str!("../../web/src/body.js"));
        for (name, list) in [("PARENT", parents), ("JOINT", joints)] {
            let expected = format!("exportconst{name}=[{}]", list.join(","));
            assert!(script.contains(&expected), "body.js lacks {expected}");
        }
    }
}
