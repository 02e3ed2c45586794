//! Scale of an ATI device's counts: from its settings page and from the configuration, with a check that both agree.

use super::RdtSettings;
use crate::wire::netft_xml::{NetFtPage, newton_metres_of, newtons_of};

/// The page does not round, so page and configuration may differ only by the precision of the printed number.
const AGREE: f64 = 1e-6;

/// Envelope of the device's settings page, which the transport delivers before any data of the device.
#[derive(Debug, Clone, Copy)]
pub struct Page;

impl Page {
    const FOUND: &[u8] = b"netftapi2.xml\n";
    const MISSING: &[u8] = b"no netftapi2.xml\n";

    /// Encodes the first bytes of a connection: the page, or why it is unavailable.
    pub fn to_bytes(page: Result<&str, &str>) -> Vec<u8> {
        match page {
            Ok(text) => [Self::FOUND, text.as_bytes()].concat(),
            Err(why) => [Self::MISSING, why.as_bytes()].concat(),
        }
    }

    /// The inverse of [`Self::to_bytes`]; `None` for records.
    pub(super) fn from_bytes(bytes: &[u8]) -> Option<Result<String, String>> {
        let text = |rest: &[u8]| String::from_utf8_lossy(rest).into_owned();
        match (bytes.strip_prefix(Self::FOUND), bytes.strip_prefix(Self::MISSING)) {
            (Some(page), _) => Some(Ok(text(page))),
            (_, Some(why)) => Some(Err(text(why))),
            _ => None,
        }
    }
}

/// Counts per unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Scale {
    pub(super) counts_per_newton: f64,
    pub(super) counts_per_newton_metre: f64,
}

impl Scale {
    /// The scale from the configuration alone.
    pub(super) fn configured(settings: &RdtSettings) -> Result<Scale, String> {
        match (settings.counts_per_newton, settings.counts_per_newton_metre) {
            (Some(counts_per_newton), Some(counts_per_newton_metre)) => {
                Ok(Scale { counts_per_newton, counts_per_newton_metre })
            }
            _ => Err("what the ATI device's counts are worth is not known: its page of settings was not read, and \
                      ground.counts_per_newton and ground.counts_per_newton_metre are not both given"
                .to_owned()),
        }
    }

    /// The scale from page and configuration, with a text that names the source of each value.
    pub(super) fn from_page(
        settings: &RdtSettings,
        page: Result<&str, &str>,
    ) -> Result<(Scale, String), String> {
        let text = match page {
            Ok(text) => text,
            Err(why) => {
                let scale = Scale::configured(settings)?;
                return Ok((
                    scale,
                    format!("{why}; its counts are taken as configured, and nothing can check them"),
                ));
            }
        };
        let page = NetFtPage::parse(text).map_err(|fault| {
            format!(
                "the page of settings of the ATI device cannot be understood: {fault}; is ground.address an ATI Net F/T or \
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
            worth: newtons_of,
            configured: settings.counts_per_newton,
        };
        let torque = PageEntry {
            key: "ground.counts_per_newton_metre",
            elements: ["cfgcpt", "scfgtu"],
            counts: page.counts_per_torque,
            unit: page.torque_unit.as_deref(),
            worth: newton_metres_of,
            configured: settings.counts_per_newton_metre,
        };
        let scale = Scale { counts_per_newton: force.counts()?, counts_per_newton_metre: torque.counts()? };
        let rate =
            page.rdt_rate_hz.map_or_else(String::new, |hz| format!(", and sends {hz} records a second"));
        let Scale { counts_per_newton, counts_per_newton_metre } = scale;
        let note = format!(
            "the ATI device's page of settings says: {counts_per_newton} counts per newton, {counts_per_newton_metre} per newton \
             metre{rate}"
        );
        Ok((scale, note))
    }
}

/// One of the two scales.
struct PageEntry<'a> {
    key: &'static str,
    /// Element names in the page: counts, unit.
    elements: [&'static str; 2],
    counts: Option<f64>,
    unit: Option<&'a str>,
    worth: fn(&str) -> Option<f64>,
    configured: Option<f64>,
}

impl PageEntry<'_> {
    /// Counts per newton or newton metre.
    fn counts(&self) -> Result<f64, String> {
        let PageEntry { key, elements: [counts_name, unit_name], .. } = self;
        let page = match (self.counts, self.unit) {
            (Some(counts), Some(unit)) => match (self.worth)(unit) {
                Some(worth) => Some(counts / worth),
                None => {
                    return Err(format!(
                        "the ATI device counts in a unit that is not known, \"{unit}\" ({unit_name} of its page of settings): \
                         on its web page, under Configurations, choose N and N-m and apply"
                    ));
                }
            },
            _ => None,
        };
        match (page, self.configured) {
            (Some(page), Some(configured)) if (page / configured - 1.0).abs() > AGREE => Err(format!(
                "{key} = {configured} contradicts the device: its page of settings says {page} ({counts_name} = {} per {}); \
                 take the key out, or correct it",
                self.counts.unwrap_or_default(),
                self.unit.unwrap_or_default(),
            )),
            (_, Some(configured)) => Ok(configured),
            (Some(page), None) => Ok(page),
            (None, None) => Err(format!(
                "the page of settings of the ATI device lacks {counts_name} or {unit_name}, so nothing is guessed: set {key}"
            )),
        }
    }
}
