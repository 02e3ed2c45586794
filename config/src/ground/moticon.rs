//! `[ground.moticon]`: Moticon insoles.

use equipoise_adapters::ground::GroundDevice;
use equipoise_adapters::ground::device::moticon::{FieldsFault, Moticon, MoticonSettings, all_fields};
use equipoise_adapters::source::{SourceError, Transport};
use serde::{Deserialize, Serialize};

use super::channels::{TowardsX, TowardsY, insole_size};
use super::description_error::{DescriptionError, nearest};
use super::numbers::TimeUnit;
use super::{GroundConfig, transport};

/// `[ground.moticon]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MoticonConfig {
    /// Length of the insoles, m; Moticon's size 4 has 0.2486.
    pub length_m: f64,
    /// Their width, m; Moticon's size 4 has 0.089.
    pub width_m: f64,
    /// Direction of increasing x of the centre of pressure.
    #[serde(default = "tip")]
    pub x_to: TowardsX,
    /// Direction of increasing y; undocumented by the manufacturer, so it has no default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub y_to: Option<TowardsY>,
    /// Fields of a line in their order, as selected in Moticon's software; all by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fields: Option<Vec<toml::Spanned<String>>>,
    /// Left and right are exchanged.
    #[serde(default)]
    pub swapped: bool,
    /// Unit of the first field, the time.
    #[serde(default = "second")]
    pub time_unit: TimeUnit,
}

fn second() -> TimeUnit {
    TimeUnit::Second
}

fn tip() -> TowardsX {
    TowardsX::Tip
}

fn settings(ground: &GroundConfig) -> Result<MoticonSettings, DescriptionError> {
    let Some(config) = &ground.moticon else {
        return Err(DescriptionError::new(
            "ground.moticon",
            "must be given: [ground.moticon] with length_m and width_m of the insoles, and y_to",
        ));
    };
    insole_size("ground.moticon", config.length_m, config.width_m)?;
    let Some(y_to) = config.y_to else {
        return Err(DescriptionError::new(
            "ground.moticon.y_to",
            "must be given: Moticon sends the centre of pressure in coordinates that are alike for both feet, and no source says \
             to which edge y grows. Stand on the outer edges of both feet: if y grows then, y_to = \"lateral\", else \"medial\"",
        ));
    };
    let fields = match &config.fields {
        None => all_fields(),
        Some(fields) => fields.iter().map(|field| field.get_ref().clone()).collect(),
    };
    Ok(MoticonSettings {
        fields,
        length_m: config.length_m,
        width_m: config.width_m,
        x_to_tip: config.x_to == TowardsX::Tip,
        y: y_to.into(),
        swapped: config.swapped,
        time: config.time_unit.in_text(),
    })
}

fn insoles(ground: &GroundConfig) -> Result<Moticon, DescriptionError> {
    Moticon::new(&settings(ground)?).map_err(|fault| {
        let key = "ground.moticon.fields";
        let fields = || ground.moticon.iter().flat_map(|config| config.fields.iter().flatten());
        let entry = |name: &str| fields().rfind(|field| field.get_ref() == name);
        match (&fault, &fault) {
            (FieldsFault::Unknown(name), _) => {
                let candidates = all_fields();
                let what = format!("{fault}{}", nearest(name, candidates.iter().map(String::as_str)));
                entry(name).map_or_else(
                    || DescriptionError::new(key, &what),
                    |entry| DescriptionError::at(entry, key, &what),
                )
            }
            (FieldsFault::Twice(name), _) => {
                let what = fault.to_string();
                entry(name).map_or_else(
                    || DescriptionError::new(key, &what),
                    |entry| DescriptionError::at(entry, key, &what),
                )
            }
            _ => DescriptionError::new(key, fault.to_string()),
        }
    })
}

pub(super) fn check(ground: &GroundConfig) -> Result<(), DescriptionError> {
    if ground.listen.is_none() {
        let what = "must be given: the port that is typed in Moticon's software as the receiver's, for example listen = \
                    \"0.0.0.0:8888\" with allow_remote = true";
        return Err(DescriptionError::new("ground.listen", what));
    }
    insoles(ground).map(drop)
}

pub(super) fn device(ground: &GroundConfig) -> Result<Box<dyn GroundDevice>, SourceError> {
    Ok(Box::new(insoles(ground)?))
}

pub(super) fn transport(ground: &GroundConfig) -> Result<Box<dyn Transport>, SourceError> {
    check(ground)?;
    transport::listening(ground)
}
