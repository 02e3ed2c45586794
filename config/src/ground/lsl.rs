//! `[ground.lsl]`: the Lab Streaming Layer.

use equipoise_adapters::ground::GroundDevice;
use equipoise_adapters::ground::device::lsl::{Lsl, LslSettings};
use equipoise_adapters::ground::plan::{Plan, units_are_known};
use equipoise_adapters::source::{LslLine, LslLineSettings, SourceError, Transport};
use serde::{Deserialize, Serialize};

use super::GroundConfig;
use super::labamp::DirectConfig;
use crate::method::Checked;

/// `[ground.lsl]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LslConfig {
    /// The stream's name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The stream's type.
    #[serde(default, rename = "type", skip_serializing_if = "Option::is_none")]
    pub kind: Option<String>,
    /// The source id of the stream.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source_id: Option<String>,
    /// Unit of forces, for a stream that does not state it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub force_unit: Option<String>,
    /// Unit of moments, for a stream that does not state it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moment_unit: Option<String>,
    /// Channels, by label or by number from 1.
    pub channels: DirectConfig,
}

const NO_SECTION: &str = "must be given for a stream of the lab streaming layer, with its name, type or source_id, and \
                          [ground.lsl.channels]";

fn section(ground: &GroundConfig) -> Result<&LslConfig, SourceError> {
    ground.lsl.as_ref().ok_or_else(|| SourceError::Unusable(format!("ground.lsl: {NO_SECTION}")))
}

pub(super) fn device(ground: &GroundConfig) -> Result<Box<dyn GroundDevice>, SourceError> {
    let LslConfig { force_unit, moment_unit, channels, .. } = section(ground)?;
    let plan = Plan::Direct { force: channels.force(), moment: channels.moment() };
    let (force_unit, moment_unit) = (force_unit.clone(), moment_unit.clone());
    Ok(Box::new(Lsl::new(LslSettings { plan, force_unit, moment_unit })))
}

pub(super) fn transport(ground: &GroundConfig) -> Result<Box<dyn Transport>, SourceError> {
    let LslConfig { name, kind, source_id, .. } = section(ground)?;
    Ok(Box::new(LslLine::new(LslLineSettings {
        address: ground.address,
        name: name.clone(),
        kind: kind.clone(),
        source_id: source_id.clone(),
        whole_network: ground.allow_remote,
    })))
}

pub(super) fn check(ground: &GroundConfig) -> Checked {
    let Some(config) = &ground.lsl else { return Err(("ground.lsl", NO_SECTION.to_owned())) };
    let names = [
        ("ground.lsl.name", &config.name),
        ("ground.lsl.type", &config.kind),
        ("ground.lsl.source_id", &config.source_id),
    ];
    if ground.address.is_none() && names.iter().all(|(_, name)| name.is_none()) {
        return Err(("ground.lsl", "name, type or source_id must be given, or ground.address".to_owned()));
    }
    for (key, name) in names {
        if name.as_deref().is_some_and(|name| name.is_empty() || name.contains(['\'', '"', '\r', '\n'])) {
            return Err((
                key,
                "must not be empty, and must have no quotes: streams could not be asked for it".to_owned(),
            ));
        }
    }
    config.channels.check("ground.lsl.channels")?;
    let (force, moment) = (config.force_unit.as_deref(), config.moment_unit.as_deref());
    let (force_known, moment_known) = units_are_known(force.unwrap_or("N"), moment.unwrap_or("Nm"));
    if !force_known {
        return Err((
            "ground.lsl.force_unit",
            "must be \"N\", \"kN\", \"mN\", \"lbf\" or \"kgf\"".to_owned(),
        ));
    }
    if !moment_known {
        let what = "must be \"Nm\", \"Nmm\", \"Ncm\", \"kNm\", \"lbf in\" or \"lbf ft\"";
        return Err(("ground.lsl.moment_unit", what.to_owned()));
    }
    Ok(())
}
