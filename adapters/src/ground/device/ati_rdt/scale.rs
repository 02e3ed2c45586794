//! Scale of an ATI device: counts per newton and per newton metre.
//!
//! Inputs are the settings page of the device (`netftapi2.xml`) and the configuration (`ground.counts_per_newton`,
//! `ground.counts_per_newton_metre`). If both have a value they must agree, because a wrong scale multiplies every
//! force and torque. Errors are messages for the operator.

use super::RdtSettings;
use crate::wire::netft_xml::{NetFtPage, newton_metres_of, newtons_of};

/// Maximum relative difference of page and configuration: the precision of the printed number, since the page does not
/// round.
const RELATIVE_TOLERANCE: f64 = 1e-6;

/// Encoding of the device's settings page, or of the error that replaces it, as the first bytes of a connection: the
/// transport passes it to the decoder before any record of the device.
#[derive(Debug, Clone, Copy)]
pub struct Page;

impl Page {
    /// Prefix of the text of the page.
    const AVAILABLE: &[u8] = b"netftapi2.xml\n";
    /// Prefix of an error message.
    const UNAVAILABLE: &[u8] = b"no netftapi2.xml\n";

    /// Encodes the text of the page, or the error that made it unavailable.
    pub fn to_bytes(page: Result<&str, &str>) -> Vec<u8> {
        match page {
            Ok(text) => [Self::AVAILABLE, text.as_bytes()].concat(),
            Err(error) => [Self::UNAVAILABLE, error.as_bytes()].concat(),
        }
    }

    /// The inverse of [`Self::to_bytes`]; `None` for records.
    pub(super) fn from_bytes(bytes: &[u8]) -> Option<Result<String, String>> {
        let text = |rest: &[u8]| String::from_utf8_lossy(rest).into_owned();
        match (bytes.strip_prefix(Self::AVAILABLE), bytes.strip_prefix(Self::UNAVAILABLE)) {
            (Some(page), _) => Some(Ok(text(page))),
            (_, Some(error)) => Some(Err(text(error))),
            _ => None,
        }
    }
}

/// Scale of the counts of force and torque.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Scale {
    pub(super) counts_per_newton: f64,
    pub(super) counts_per_newton_metre: f64,
}

impl Scale {
    /// The scale from the configuration alone. Fails if either key is missing.
    pub(super) fn configured(settings: &RdtSettings) -> Result<Scale, String> {
        match (settings.counts_per_newton, settings.counts_per_newton_metre) {
            (Some(counts_per_newton), Some(counts_per_newton_metre)) => {
                Ok(Scale { counts_per_newton, counts_per_newton_metre })
            }
            _ => Err("the scale of the ATI device is unavailable: its settings page was not read, and \
                      ground.counts_per_newton and ground.counts_per_newton_metre are not both set"
                .to_owned()),
        }
    }

    /// The scale from page and configuration, and a note for the log with its source. Fails if RDT is disabled, if page
    /// and configuration contradict each other, and if a value or its unit is missing.
    pub(super) fn from_page(
        settings: &RdtSettings,
        page: Result<&str, &str>,
    ) -> Result<(Scale, String), String> {
        let text = match page {
            Ok(text) => text,
            Err(error) => {
                let scale = Scale::configured(settings)?;
                return Ok((scale, format!("{error}; the configured scale is used without a check")));
            }
        };
        let page = NetFtPage::parse(text).map_err(|fault| {
            format!(
                "the settings page of the ATI device cannot be parsed: {fault}; is ground.address an ATI Net F/T or \
                 Axia? With page = false in [ground.ati] it is not read"
            )
        })?;
        if page.rdt_enabled == Some(false) {
            return Err(
                "RDT is switched off in the ATI device: on its web page, under Communications, set \"RDT \
                        Interface\" to Enabled and apply"
                    .to_owned(),
            );
        }
        let force = PageEntry {
            key: "ground.counts_per_newton",
            elements: ["cfgcpf", "scfgfu"],
            counts: page.counts_per_force,
            unit: page.force_unit.as_deref(),
            si_per_unit: newtons_of,
            configured: settings.counts_per_newton,
        };
        let torque = PageEntry {
            key: "ground.counts_per_newton_metre",
            elements: ["cfgcpt", "scfgtu"],
            counts: page.counts_per_torque,
            unit: page.torque_unit.as_deref(),
            si_per_unit: newton_metres_of,
            configured: settings.counts_per_newton_metre,
        };
        let scale = Scale {
            counts_per_newton: force.counts_per_si_unit()?,
            counts_per_newton_metre: torque.counts_per_si_unit()?,
        };
        let rate =
            page.rdt_rate_hz.map_or_else(String::new, |hz| format!(", and sends {hz} records a second"));
        let Scale { counts_per_newton, counts_per_newton_metre } = scale;
        let note = format!(
            "scale by the ATI device's settings page: {counts_per_newton} counts per newton, {counts_per_newton_metre} per newton \
             metre{rate}"
        );
        Ok((scale, note))
    }
}

/// One of the two scales: force or torque.
struct PageEntry<'a> {
    /// Key of the configuration.
    key: &'static str,
    /// Element names in the page: counts, unit.
    elements: [&'static str; 2],
    /// Counts per unit, by the page.
    counts: Option<f64>,
    /// Name of the unit, by the page.
    unit: Option<&'a str>,
    /// Converts the name of a unit to N or N m; `None` if it is not supported.
    si_per_unit: fn(&str) -> Option<f64>,
    /// Counts per newton or newton metre, by the configuration.
    configured: Option<f64>,
}

impl PageEntry<'_> {
    /// Counts per newton or newton metre.
    fn counts_per_si_unit(&self) -> Result<f64, String> {
        let PageEntry { key, elements: [counts_name, unit_name], .. } = self;
        let page = match (self.counts, self.unit) {
            (Some(counts), Some(unit)) => match (self.si_per_unit)(unit) {
                Some(si_per_unit) => Some(counts / si_per_unit),
                None => {
                    return Err(format!(
                        "the ATI device uses an unsupported unit, \"{unit}\" ({unit_name} of its settings page): \
                         on its web page, under Configurations, choose N and N-m and apply"
                    ));
                }
            },
            _ => None,
        };
        match (page, self.configured) {
            (Some(page), Some(configured)) if (page / configured - 1.0).abs() > RELATIVE_TOLERANCE => {
                Err(format!(
                    "{key} = {configured} contradicts the device: its settings page contains {page} ({counts_name} = {} per {}); \
                 remove the key, or correct it",
                    self.counts.unwrap_or_default(),
                    self.unit.unwrap_or_default(),
                ))
            }
            (_, Some(configured)) => Ok(configured),
            (Some(page), None) => Ok(page),
            (None, None) => Err(format!(
                "the settings page of the ATI device lacks {counts_name} or {unit_name}: set {key}"
            )),
        }
    }
}
