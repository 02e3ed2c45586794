//! `[ground.second]`: rules for combining two ground devices.

use std::borrow::Cow;

use equipoise_adapters::ground::GroundSettings;
use equipoise_adapters::ground::fusion::{self, FusionKind, FusionSettings, SURFACES_AGREE_M};
use equipoise_adapters::source::SourceError;

use super::channels::ChannelsConfig;
use super::{Foot, FrameConfig, GroundConfig, GroundSourceKind, Measures, ati_rdt};
use crate::method::Checked;

/// A key and its error.
pub(crate) type InvalidField = (Cow<'static, str>, String);

impl GroundConfig {
    /// Maximum delay from a force to its sample in the loop, ns: that of the later device, plus the time that one of
    /// two devices waits for the other.
    pub(super) fn loop_latency_ns(&self) -> u64 {
        match &self.second {
            Some(second) => self.lateness_ns().max(second.lateness_ns()) + fusion::WAIT_NS,
            None => self.lateness_ns(),
        }
    }

    /// Maximum age of a force of this device alone when the next one arrives: its constant delay plus the length of its
    /// sample blocks.
    fn lateness_ns(&self) -> u64 {
        self.latency_ns() + self.block_ns()
    }

    /// Delay of the later device, ms.
    pub fn latest_ms(&self) -> f64 {
        let second_ns = self.second.as_ref().map_or(0, |second| second.lateness_ns());
        self.lateness_ns().max(second_ns) as f64 * 1e-6
    }

    /// How to combine both devices; `None` if there is only one.
    pub fn fusion(&self) -> Option<FusionSettings> {
        let second = self.second.as_deref()?;
        let kind = if second.is_insoles() {
            FusionKind::PlateAndInsoles
        } else {
            let left = self.foot.map(|foot| usize::from(foot == Foot::Right));
            FusionKind::TwoPlates { left }
        };
        Some(FusionSettings::new(kind, [self.lateness_ns(), second.lateness_ns()]))
    }

    /// As [`GroundConfig::settings`], for the second of two devices.
    pub fn settings_of_second(&self) -> GroundSettings {
        let settings = self.settings();
        GroundSettings { device: fusion::as_second(settings.device), ..settings }
    }

    /// Whether the device moves with the feet.
    pub fn is_insoles(&self) -> bool {
        self.source == GroundSourceKind::MoticonUdp
            || matches!(self.channels, Some(ChannelsConfig::Insoles(_)))
    }

    /// Checks the second device and its combination with the first.
    pub(crate) fn check_second(&self) -> Result<(), InvalidField> {
        let Some(second) = self.second.as_deref() else {
            return match self.foot {
                None => Ok(()),
                Some(_) => Err((
                    "ground.foot".into(),
                    "one plate under one foot is not the whole ground: name the other foot's in [ground.second], or \
                     leave `foot` out"
                        .to_owned(),
                )),
            };
        };
        if second.second.is_some() {
            let what = "two devices are fused, no more; leave it out";
            return Err(("ground.second.second".into(), what.to_owned()));
        }
        second.check().map_err(|(field, what)| (in_second(field).into(), in_second(&what)))?;
        self.check_pair(second).map_err(|(field, what)| (field.into(), what))
    }

    fn check_pair(&self, second: &GroundConfig) -> Checked {
        let external = |ground: &GroundConfig| ground.source == GroundSourceKind::External;
        if external(self) || external(second) {
            let field = if external(self) { "ground.source" } else { "ground.second.source" };
            let what = "with [ground.second] one adapter reads both devices: name each device here; to read them in \
                        another process, run `equipoise adapter ground` with the same configuration";
            return Err((field, what.to_owned()));
        }
        if self.is_insoles() {
            let what = if second.is_insoles() {
                "insoles twice are no more than once; leave [ground.second] out"
            } else {
                "the plate comes first: put it into [ground] and the insoles into [ground.second]"
            };
            return Err(("ground.source", what.to_owned()));
        }
        if second.is_insoles() {
            return check_insoles(self, second);
        }
        match (self.foot, second.foot) {
            (None, None) => {}
            (Some(one), Some(other)) if one != other => {}
            (Some(_), Some(_)) => {
                return Err((
                    "ground.second.foot",
                    "each foot has one plate: one says left, one right".to_owned(),
                ));
            }
            (Some(_), None) => return Err(("ground.foot", ONE_FOOT.to_owned())),
            (None, Some(_)) => return Err(("ground.second.foot", ONE_FOOT.to_owned())),
        }
        let height_difference_m = self.settings().frame.surface_z_m() - second.settings().frame.surface_z_m();
        if height_difference_m.abs() > SURFACES_AGREE_M {
            let what = format!(
                "its surface is {:.0} mm {} than the first plate's; both must be one floor: see origin_m and \
                 surface_height_m of both",
                1e3 * height_difference_m.abs(),
                if height_difference_m > 0.0 { "lower" } else { "higher" }
            );
            return Err(("ground.second.frame", what));
        }
        match key_of_same_device(self, second) {
            Some(key) => {
                let what =
                    "it is the device of [ground], whose force would count twice; name the other device";
                Err((key, what.to_owned()))
            }
            None => Ok(()),
        }
    }
}

/// If both sections read the same plate over the network: the key that must differ.
fn key_of_same_device(one: &GroundConfig, other: &GroundConfig) -> Option<&'static str> {
    // What the same readings may be converted with.
    let readings = |ground: &GroundConfig| GroundConfig {
        measures: Measures::default(),
        latency_ms: 0.0,
        foot: None,
        frame: FrameConfig::default(),
        ..ground.clone()
    };
    let is_alike = || GroundConfig { second: None, ..readings(one) } == readings(other);
    let plate = |ground: &GroundConfig| ground.qtm.as_ref().map(|qtm| qtm.plate);
    let (is_same, key) = match one.source {
        GroundSourceKind::AtiRdt => {
            (ati_rdt::address(one) == ati_rdt::address(other), "ground.second.address")
        }
        GroundSourceKind::Qtm => {
            ((one.address, plate(one)) == (other.address, plate(other)), "ground.second.qtm.plate")
        }
        GroundSourceKind::Lsl => (is_alike(), "ground.second.lsl"),
        _ => (one.address.is_some() && is_alike(), "ground.second.address"),
    };
    (one.source == other.source && is_same).then_some(key)
}

const ONE_FOOT: &str = "say `foot` of both plates, or of neither";

/// Insoles cover both feet and move with them, so `foot` and `frame` do not apply.
fn check_insoles(plate: &GroundConfig, insoles: &GroundConfig) -> Checked {
    if plate.foot.is_some() {
        return Err(("ground.foot", "the insoles report the load of each foot; leave it out".to_owned()));
    }
    if insoles.foot.is_some() {
        return Err(("ground.second.foot", "insoles are under both feet; leave it out".to_owned()));
    }
    if insoles.frame != FrameConfig::default() {
        return Err(("ground.second.frame", "insoles go where the feet go; leave it out".to_owned()));
    }
    Ok(())
}

/// Converts a message on `ground.…` to one on `ground.second.…`.
pub fn in_second(text: &str) -> String {
    text.replace("ground.", "ground.second.").replace("[ground]", "[ground.second]")
}

/// Converts a source's error to one of the second device.
pub fn error_of_second(error: SourceError) -> SourceError {
    match error {
        SourceError::Absent { what, remedy, error } => {
            SourceError::Absent { what, remedy: in_second(&remedy), error }
        }
        SourceError::Unready { what, why, remedy } => {
            SourceError::Unready { what, why, remedy: in_second(&remedy) }
        }
        other if other.may_recover() => other,
        other => SourceError::Unusable(in_second(&other.to_string())),
    }
}

#[cfg(test)]
mod tests {
    use crate::Config;

    const PLATE: &str = "source = \"ati-rdt\"\ncounts_per_newton = 1e6\ncounts_per_newton_metre = 1e6\n";

    fn parse(first: &str, second: &str) -> Result<Config, String> {
        let text = format!(
            "station = \"s\"\n[suit]\nsource = \"external\"\n[ground]\n{first}\n[ground.second]\n{second}\n[subject]\nid = \
             \"a\"\nheight_m = 1.7\n"
        );
        Config::parse(&text, "two.toml").map_err(|error| error.to_string())
    }

    fn with(keys: &str) -> String {
        format!("{keys}\n{PLATE}")
    }

    /// Another plate than that of `with`.
    fn other(keys: &str) -> String {
        with(&format!("address = \"192.168.1.12:49152\"\n{keys}"))
    }

    #[test]
    fn two_plates_under_one_foot_each_are_accepted() {
        let config =
            parse(&with("foot = \"right\"\nlatency_ms = 3"), &other("foot = \"left\"\nlatency_ms = 8"))
                .unwrap();
        let fusion = config.ground.fusion().unwrap();
        assert_eq!(fusion.kind, super::FusionKind::TwoPlates { left: Some(1) });
        assert_eq!(config.settings().ground_latency_ns, 58_000_000);
        assert_eq!(config.ground.second.as_ref().unwrap().settings_of_second().device as u32, 2);
    }

    #[test]
    fn invalid_combinations_are_reported_with_their_line() {
        let foot = |foot: &str| with(&format!("foot = \"{foot}\""));
        let high = format!("{PLATE}[ground.second.frame]\norigin_m = [0.0, 0.0, 0.02]");
        let deep = format!("{PLATE}[ground.second.second]\n{PLATE}");
        let wrong = [
            (
                with(""),
                "source = \"ati-rdt\"\ncounts_per_newton_metre = -1".to_owned(),
                "ground.second.counts_per_newton_metre: ",
            ),
            (with(""), with("latency_ms = 5000"), "two.toml, line 11: ground.second.latency_ms: "),
            (foot("left"), foot("left"), "ground.second.foot: each foot"),
            (foot("left"), with(""), "two.toml, line 5: ground.foot: say `foot` of both"),
            (with(""), foot("left"), "ground.second.foot: say"),
            (with(""), high, "ground.second.frame: its surface is 20 mm higher"),
            (with(""), deep, "ground.second.second: two devices"),
            (with(""), "source = \"external\"".to_owned(), "ground.second.source: with [ground.second]"),
            (with(""), with("contus = 1"), "`contus` is not known"),
            (foot("left"), foot("right"), "ground.second.address: it is the device of [ground], whose force"),
        ];
        for (first, second, text) in wrong {
            let error = parse(&first, &second).unwrap_err();
            assert!(error.contains(text), "{text:?} is not in {error:?}");
        }
        let single = "station = \"s\"\n[suit]\nsource = \"external\"\n[ground]\nsource = \"external\"\nfoot = \"left\"\n\
                     [subject]\nid = \"a\"\nheight_m = 1.7\n";
        assert!(Config::parse(single, "one").unwrap_err().to_string().contains("not the whole ground"));
    }

    #[test]
    fn a_plate_of_a_program_is_not_read_twice() {
        let qtm = |plate: u32| {
            format!(
                "source = \"qtm\"\naddress = \"192.168.0.20:22223\"\nframe = {{ axes = \"z-down\" }}\n\
                 qtm = {{ coordinates = \"plate\", plate = {plate} }}"
            )
        };
        assert!(parse(&qtm(1), &qtm(2)).is_ok());
        let message = parse(&qtm(2), &qtm(2)).unwrap_err();
        assert!(
            message.contains("line 13: ground.second.qtm.plate: it is the device of [ground]"),
            "{message}"
        );
        let lsl = |fz: &str| {
            format!("source = \"lsl\"\nlsl = {{ name = \"plates\", channels = {{ fz = \"{fz}\" }} }}")
        };
        assert!(parse(&lsl("Fz1"), &lsl("Fz2")).is_ok());
        let message = parse(&lsl("Fz1"), &lsl("Fz1")).unwrap_err();
        assert!(message.contains("ground.second.lsl: it is the device of [ground]"), "{message}");
    }
}
