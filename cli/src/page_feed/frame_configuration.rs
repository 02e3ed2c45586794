//! Values of the daemon's active configuration that frames contain: a reload changes them while the page is served.

use equipoise_config::Config;
use equipoise_config::method::StopConfig;
use equipoise_config::model_file::{Ask, ModelFile};
use equipoise_station::status::Status;

/// Values of a configuration and its model that frames contain.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct FrameConfiguration {
    /// 1-σ of the predicted CoP at which identification stops, m; `None` with another stopping rule.
    pub(super) target_m: Option<f64>,
    /// Pose requested by the model file.
    pub(super) ask: Option<Ask>,
    /// Corners of the plate, world x and y, m; `None` without a configured size.
    pub(super) plate_corners_m: Option<[[f64; 2]; 4]>,
}

impl FrameConfiguration {
    /// The values of a configuration read from its file.
    pub(super) fn of(config: &Config) -> FrameConfiguration {
        let ask = config.loaded_model.as_ref().and_then(|model| model.file().ask.clone());
        FrameConfiguration::with_ask(config, ask)
    }

    fn with_ask(config: &Config, ask: Option<Ask>) -> FrameConfiguration {
        let identification = &config.identification;
        FrameConfiguration {
            target_m: (identification.stop == StopConfig::PredictedCop)
                .then_some(identification.stop_cop_sigma_mm * 1e-3),
            ask,
            // With two plates, the outline of one would misrepresent the ground.
            plate_corners_m: config.ground.frame.corners_m().filter(|_| config.ground.second.is_none()),
        }
    }

    /// The values of the texts (TOML) in the daemon's status; `None` if the configuration is not valid for this version.
    fn of_texts(config: &str, model: &str) -> Option<FrameConfiguration> {
        let config = Config::parse(config, "the daemon's configuration").ok()?;
        let ask = ModelFile::parse(model, "the daemon's model").ok().and_then(|model| model.ask);
        Some(FrameConfiguration::with_ask(&config, ask))
    }
}

/// Detects changes of the active configuration that a daemon publishes in its status.
#[derive(Debug, Default)]
pub(super) struct ConfigurationWatch {
    /// TOML of the configuration and of its model, as last read.
    texts: [String; 2],
}

impl ConfigurationWatch {
    /// The values that a daemon uses, if its configuration or model has changed since the last call.
    pub(super) fn changed(&mut self, status: Status) -> Option<FrameConfiguration> {
        self.changed_by([status.config_toml, status.model_toml])
    }

    fn changed_by(&mut self, texts: [String; 2]) -> Option<FrameConfiguration> {
        if texts == self.texts {
            return None;
        }
        self.texts = texts;
        let [config, model] = &self.texts;
        FrameConfiguration::of_texts(config, model)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reload_changes_what_frames_contain() {
        let config = |size: &str, target_mm: f64| {
            format!(
                "station = \"s\"\n[suit]\nsource = \"mvn-udp\"\n[ground]\nsource = \"ati-rdt\"\n[ground.frame]\n{size}\
                 [identification]\nstop = \"predicted-cop\"\nstop_cop_sigma_mm = {target_mm:?}\n\
                 [subject]\nid = \"a\"\nheight_m = 1.7\n"
            )
        };
        let model = "version = 1\n[ask]\nbetween = [\"hand_load right\", \"worn_mass T8\"]\npose = \"both arms up\"\n\
                     turn_deg = 90.0\nseparation_sigma = 4.25\n";
        let mut watch = ConfigurationWatch::default();
        let first = watch.changed_by([config("", 2.0), String::new()]).unwrap();
        assert_eq!((first.target_m, &first.ask, first.plate_corners_m), (Some(0.002), &None, None));
        assert_eq!(watch.changed_by([config("", 2.0), String::new()]), None, "no change");
        let second = watch.changed_by([config("size_m = [0.6, 0.4]\n", 3.0), model.to_owned()]).unwrap();
        assert_eq!(second.target_m, Some(0.003));
        assert!(second.ask.is_some() && second.plate_corners_m.is_some(), "{second:?}");
    }
}
