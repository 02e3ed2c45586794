//! `[subject]`, `[identification]`, `[static_pose]`: the subject and the method.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use equipoise_core::body::{Joint, Sex};
use equipoise_core::cycle::{Method, PoseChoice, PriorKind, Settings, StopRule};
use equipoise_core::overload::TorqueLimits;
use equipoise_core::sesc::ReductionKind;
use serde::{Deserialize, Serialize};

/// Range of the stature, m.
pub const HEIGHT_M: RangeInclusive<f64> = 1.0..=2.3;
/// Range of the mass with clothes and suit, kg.
pub const MASS_KG: RangeInclusive<f64> = 25.0..=250.0;

pub(super) type Checked = Result<(), (&'static str, String)>;

/// `[subject]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SubjectConfig {
    /// A pseudonym; never a name.
    pub id: String,
    /// Body mass with clothes and suit, kg; by default weighed by the plate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mass_kg: Option<f64>,
    /// Stature, m.
    pub height_m: f64,
    /// Sex, which selects the anthropometric table.
    #[serde(default)]
    pub sex: SexConfig,
    /// Save the identification in a profile and restore it after a restart.
    #[serde(default = "default_true")]
    #[serde(alias = "remember")]
    pub save_profile: bool,
    /// Torque limit per joint, N m, by MVN's joint name; a fraction of published strengths for the others.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub tau_max_nm: BTreeMap<String, f64>,
}

fn default_true() -> bool {
    true
}

/// Sex, which selects the anthropometric table.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SexConfig {
    /// De Leva's values for women.
    Female,
    /// De Leva's values for men.
    Male,
    /// Their mean.
    #[default]
    Unstated,
}

impl From<SexConfig> for Sex {
    fn from(sex: SexConfig) -> Sex {
        match sex {
            SexConfig::Female => Sex::Female,
            SexConfig::Male => Sex::Male,
            SexConfig::Unstated => Sex::Unstated,
        }
    }
}

/// Body dimensions of a subject other than the mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Build {
    /// Stature, m.
    pub height_m: f64,
    /// Sex, which selects the anthropometric table.
    pub sex: SexConfig,
}

impl SubjectConfig {
    /// Stature and sex.
    pub fn build(&self) -> Build {
        Build { height_m: self.height_m, sex: self.sex }
    }

    pub(super) fn apply(&self, settings: &mut Settings) {
        settings.sex = self.sex.into();
        settings.mass_kg = self.mass_kg;
        settings.limits = TorqueLimits::of(settings.sex);
        for (name, limit_nm) in &self.tau_max_nm {
            if let Some(joint) = Joint::named(name) {
                settings.limits.set(joint, *limit_nm);
            }
        }
    }

    pub(super) fn check(&self) -> Checked {
        between("subject.height_m", self.height_m, *HEIGHT_M.start(), *HEIGHT_M.end())?;
        if let Some(mass_kg) = self.mass_kg {
            between("subject.mass_kg", mass_kg, *MASS_KG.start(), *MASS_KG.end())?;
        }
        for (name, limit_nm) in &self.tau_max_nm {
            if Joint::named(name).is_none() {
                let nearest = Joint::ALL
                    .map(Joint::name)
                    .into_iter()
                    .max_by(|a, b| strsim::jaro_winkler(a, name).total_cmp(&strsim::jaro_winkler(b, name)))
                    .unwrap_or_default();
                return Err((
                    "subject.tau_max_nm",
                    format!("`{name}` is no joint; did you mean `{nearest}`?"),
                ));
            }
            between("subject.tau_max_nm", *limit_nm, 1.0, 1000.0)?;
        }
        Ok(())
    }
}

/// `[identification]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct IdentificationConfig {
    /// Number of free parameters.
    pub reduction: ReductionConfig,
    /// Data used by the filter.
    pub method: MethodConfig,
    /// Prior before the first pose.
    pub prior: PriorConfig,
    /// Criterion of the next pose.
    pub pose_choice: PoseChoiceConfig,
    /// Natural motion without a load continues to update the filter after identification.
    pub passive: bool,
    /// 1-σ of the difference between the parameters of left and right limbs, mm.
    pub symmetry_sigma_mm: f64,
    /// 1-σ of the distance of a limb's centre of mass from its long axis, mm.
    pub long_axis_sigma_mm: f64,
    /// Stop criterion.
    pub stop: StopConfig,
    /// Bound of `stop = "paper"` on every P_jj, m².
    pub stop_variance_m2: f64,
    /// Bound of `stop = "predicted-cop"`, mm.
    pub stop_cop_sigma_mm: f64,
    /// Minimum number of poses.
    pub poses_min: u64,
    /// 1-σ of a held pose's measurement in addition to the sensors' errors, mm: sway and breathing.
    pub measurement_sigma_mm: f64,
    /// Growth of each parameter's standard deviation per pose, mm (Q of Eq. 7).
    pub process_sigma_mm: f64,
    /// Start as soon as suit and plate provide samples.
    pub auto_start: bool,
}

impl Default for IdentificationConfig {
    fn default() -> Self {
        IdentificationConfig {
            reduction: ReductionConfig::Merged,
            method: MethodConfig::StaticAndDynamic,
            prior: PriorConfig::Table,
            pose_choice: PoseChoiceConfig::IOptimal,
            passive: false,
            symmetry_sigma_mm: 5.0,
            long_axis_sigma_mm: 5.0,
            stop: StopConfig::PredictedCop,
            stop_variance_m2: 0.002,
            stop_cop_sigma_mm: 1.5,
            poses_min: 6,
            measurement_sigma_mm: 2.0,
            process_sigma_mm: 0.0,
            auto_start: true,
        }
    }
}

/// Number of free parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReductionConfig {
    /// All 69.
    Full,
    /// 42.
    Merged,
    /// 16.
    Symmetric,
}

/// Data used by the filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MethodConfig {
    /// Held poses.
    Static,
    /// Held poses and natural motion without a load.
    #[serde(rename = "static+dynamic")]
    StaticAndDynamic,
}

/// Prior before the first pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PriorConfig {
    /// No prior.
    None,
    /// The anthropometric table and its standard deviations.
    Table,
    /// The stored subject with the most similar stature, mass and sex; otherwise the table.
    SimilarSubject,
}

/// Criterion of the next pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PoseChoiceConfig {
    /// Eq. 11.
    Paper,
    /// Largest decrease of log det P.
    DOptimal,
    /// Largest decrease of tr P.
    AOptimal,
    /// Largest decrease of the predicted CoP variance.
    IOptimal,
}

/// Stop criterion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StopConfig {
    /// Every P_jj below a bound.
    Paper,
    /// The predicted standard deviation of the CoP below a bound.
    PredictedCop,
}

impl IdentificationConfig {
    pub(super) fn check(&self) -> Checked {
        between("identification.stop_variance_m2", self.stop_variance_m2, 1e-9, 1.0)?;
        between("identification.stop_cop_sigma_mm", self.stop_cop_sigma_mm, 0.1, 100.0)?;
        between("identification.poses_min", self.poses_min as f64, 1.0, 1000.0)?;
        between("identification.measurement_sigma_mm", self.measurement_sigma_mm, 0.1, 100.0)?;
        between("identification.symmetry_sigma_mm", self.symmetry_sigma_mm, 0.01, 1000.0)?;
        between("identification.long_axis_sigma_mm", self.long_axis_sigma_mm, 0.01, 1000.0)?;
        between("identification.process_sigma_mm", self.process_sigma_mm, 0.0, 100.0)
    }

    pub(super) fn apply(&self, settings: &mut Settings) {
        settings.reduction = match self.reduction {
            ReductionConfig::Full => ReductionKind::Full,
            ReductionConfig::Merged => ReductionKind::Merged,
            ReductionConfig::Symmetric => ReductionKind::Symmetric,
        };
        settings.prior = match self.prior {
            PriorConfig::None => PriorKind::None,
            PriorConfig::Table => PriorKind::Table,
            PriorConfig::SimilarSubject => PriorKind::SimilarSubject,
        };
        settings.method = match self.method {
            MethodConfig::Static => Method::Static,
            MethodConfig::StaticAndDynamic => Method::StaticAndDynamic,
        };
        settings.pose_choice = match self.pose_choice {
            PoseChoiceConfig::Paper => PoseChoice::Paper,
            PoseChoiceConfig::DOptimal => PoseChoice::DOptimal,
            PoseChoiceConfig::AOptimal => PoseChoice::AOptimal,
            PoseChoiceConfig::IOptimal => PoseChoice::IOptimal,
        };
        settings.passive = self.passive;
        settings.symmetry_sigma_m = self.symmetry_sigma_mm * 1e-3;
        settings.long_axis_sigma_m = self.long_axis_sigma_mm * 1e-3;
        settings.stop = match self.stop {
            StopConfig::Paper => StopRule::Paper { variance_m2: self.stop_variance_m2 },
            StopConfig::PredictedCop => StopRule::PredictedCop { sigma_m: self.stop_cop_sigma_mm * 1e-3 },
        };
        settings.poses_min = self.poses_min;
        settings.measurement_sigma_m = self.measurement_sigma_mm * 1e-3;
        settings.process_variance_m2 = (self.process_sigma_mm * 1e-3).powi(2);
        settings.start_identifying = self.auto_start;
    }
}

/// `[static_pose]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StaticPoseConfig {
    /// Maximum standard deviation of a joint angle over 20 samples, degrees.
    pub joint_deg: f64,
    /// Maximum standard deviation of the CoP, mm.
    pub cop_mm: f64,
    /// Minimum change of a joint angle before the next pose counts, degrees.
    #[serde(alias = "leave_deg")]
    pub new_pose_deg: f64,
    /// Maximum difference of the vertical force from the body weight, per cent.
    pub weight_percent: f64,
}

impl Default for StaticPoseConfig {
    fn default() -> Self {
        StaticPoseConfig { joint_deg: 1.0, cop_mm: 4.0, new_pose_deg: 7.0, weight_percent: 4.0 }
    }
}

impl StaticPoseConfig {
    pub(super) fn check(&self) -> Checked {
        between("static_pose.joint_deg", self.joint_deg, 0.05, 45.0)?;
        between("static_pose.cop_mm", self.cop_mm, 0.1, 100.0)?;
        between("static_pose.new_pose_deg", self.new_pose_deg, 0.1, 90.0)?;
        between("static_pose.weight_percent", self.weight_percent, 0.1, 50.0)?;
        // A pose that is held counts once: its own variation must not make it a new one.
        if self.new_pose_deg < self.joint_deg {
            let what = format!(
                "{} must be at least joint_deg ({}); otherwise one held pose is counted repeatedly",
                self.new_pose_deg, self.joint_deg
            );
            return Err(("static_pose.new_pose_deg", what));
        }
        Ok(())
    }

    pub(super) fn apply(&self, settings: &mut Settings) {
        settings.static_pose.joint_rad = self.joint_deg.to_radians();
        settings.static_pose.cop_m = self.cop_mm * 1e-3;
        settings.static_pose.leave_rad = self.new_pose_deg.to_radians();
        settings.static_pose.weight_fraction = self.weight_percent * 1e-2;
    }
}

/// Refuses a value outside its range; the error names the field.
pub(super) fn between(field: &'static str, value: f64, low: f64, high: f64) -> Checked {
    if (low..=high).contains(&value) {
        Ok(())
    } else {
        // Avoids printing all digits of, for example, 1e300.
        let value = if value.abs() < 1e9 { format!("{value}") } else { format!("{value:?}") };
        Err((field, format!("{value} is not between {low} and {high}")))
    }
}
