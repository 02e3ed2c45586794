//! The force offset that a later start may continue with.

use equipoise_config::Config;
use equipoise_core::cycle::stored_state::FORCE_OFFSET_VALID_NS;
use equipoise_core::cycle::{StoredForceOffset, StoredState};
use equipoise_files::Sha256;
use serde::{Deserialize, Serialize};

use super::{boot, plate_of};

/// `[force_offset]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ForceOffsetPart {
    /// Boot id of the machine, for `time_ns`.
    boot: String,
    /// SHA-256 of the subject, its mass and `[ground]`, whose errors the offset includes. Subject and mass
    /// themselves would remain here after that subject is deleted.
    conditions: String,
    mean_n: f64,
    sigma_n: f64,
    /// Time of the last instant, CLOCK_MONOTONIC.
    time_ns: u64,
}

impl ForceOffsetPart {
    /// The offset of the subject in use; `None` without any, or if the start of the machine cannot be determined.
    pub fn of(copy: &StoredState, subject: &str, config: &Config) -> Option<ForceOffsetPart> {
        let StoredForceOffset { mean_n, sigma_n, mass_kg, time_ns } = copy.force_offset;
        (mass_kg > 0.0).then_some(ForceOffsetPart {
            boot: boot()?,
            conditions: conditions_of(subject, mass_kg, config),
            mean_n,
            sigma_n,
            time_ns,
        })
    }

    /// The offset for the subject in use and its mass.
    ///
    /// # Errors
    /// Why it is no longer valid.
    pub fn offset(
        &self,
        subject: &str,
        mass_kg: f64,
        config: &Config,
        now_ns: u64,
    ) -> Result<StoredForceOffset, String> {
        if boot().as_deref() != Some(&self.boot) {
            return Err("the machine was restarted".to_owned());
        }
        if self.conditions != conditions_of(subject, mass_kg, config) {
            return Err("the subject, its mass or [ground] has changed".to_owned());
        }
        let age_ns = now_ns.saturating_sub(self.time_ns);
        if age_ns > FORCE_OFFSET_VALID_NS {
            return Err(format!("it is {:.0} s old", age_ns as f64 * 1e-9));
        }
        let &ForceOffsetPart { mean_n, sigma_n, time_ns, .. } = self;
        Ok(StoredForceOffset { mean_n, sigma_n, mass_kg, time_ns })
    }
}

fn conditions_of(subject: &str, mass_kg: f64, config: &Config) -> String {
    Sha256::of(format!("{subject}/{mass_kg}/{}", plate_of(config)).as_bytes())
}

#[cfg(test)]
mod tests {
    use super::super::tests::{config, copy};
    use super::*;
    use crate::realtime::now_ns;

    #[test]
    fn a_force_offset_is_valid_for_its_subject_mass_and_plate_and_for_ten_minutes() {
        let (here, copy) = (config(""), copy());
        let mut part = ForceOffsetPart::of(&copy, "a", &here).unwrap();
        assert_eq!(part.offset("a", 71.3, &here, now_ns()), Ok(copy.force_offset));
        for (subject, mass_kg) in [("b", 71.3), ("a", 71.4), ("a", 0.0)] {
            assert!(part.offset(subject, mass_kg, &here, now_ns()).unwrap_err().contains("has changed"));
        }
        let moved = config("[ground.frame]\nyaw_deg = 90.0");
        assert!(part.offset("a", 71.3, &moved, now_ns()).unwrap_err().contains("has changed"));
        let later_ns = now_ns() + FORCE_OFFSET_VALID_NS + 1_000_000_000;
        assert!(part.offset("a", 71.3, &here, later_ns).unwrap_err().contains("601 s old"));
        part.boot.push('x');
        assert!(part.offset("a", 71.3, &here, now_ns()).unwrap_err().contains("machine"));
        let mut without = copy;
        without.force_offset.mass_kg = 0.0;
        assert_eq!(ForceOffsetPart::of(&without, "a", &here), None);
    }
}
