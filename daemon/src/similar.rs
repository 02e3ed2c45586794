//! Selects the stored subject with the most similar body: `prior = "similar-subject"`.
//!
//! Similarity is a Gaussian kernel over stature and body mass, reduced if the sexes differ. Its widths and factors are
//! assumptions, not measurements: half of the variation among people of one sex.

use std::io;

use equipoise_config::Config;
use equipoise_core::body::{Anthropometry, SEGMENTS, Skeleton};
use equipoise_core::cycle::{PriorKind, Settings, Similar};
use equipoise_core::sesc::{PARAMETERS, Phi, Reduction, ReductionKind};
use equipoise_station::state_directory::StateDirectory;

use crate::profile::Profile;

/// Difference in stature of one kernel width, m.
const HEIGHT_WIDTH_M: f64 = 0.04;
/// Difference in body mass of one kernel width, kg.
const MASS_WIDTH_KG: f64 = 7.0;
/// Fraction of a deviation from the table shared by subjects of equal stature, mass and sex.
const LIKENESS_MAX: f64 = 0.8;
/// Factor on it if the sexes differ or one is not stated.
const OTHER_SEX_FACTOR: f64 = 0.6;
/// Minimum similarity.
const LIKENESS_MIN: f64 = 0.2;

/// The selected subject.
#[derive(Debug, Clone)]
pub struct Chosen {
    /// Pseudonym.
    pub subject: String,
    /// Its contribution to the prior.
    pub similar: Similar,
}

/// The similar subject of a configuration with `prior = "similar-subject"`. Without access to the profiles there is none,
/// and a warning is logged.
pub fn similar_to_configured(config: &Config, state: &StateDirectory) -> Option<Chosen> {
    let settings = config.settings();
    if settings.prior != PriorKind::SimilarSubject {
        return None;
    }
    let chosen = choose(&config.subject.id, &settings, state).unwrap_or_else(|error| {
        let folder = state.profiles();
        tracing::warn!("no similar subject is searched, cannot read {}: {error}", folder.display());
        None
    });
    tracing::info!("{}", describe(chosen.as_ref()));
    chosen
}

/// The most similar of the stored subjects for the subject of these settings, excluding that subject itself.
///
/// `None` if the settings request no similar subject, or none is similar. Profiles that cannot be read or are not
/// completely identified are skipped. Of equally similar subjects the first by name is chosen.
///
/// # Errors
/// The folder of the profiles cannot be read.
pub fn choose(subject: &str, settings: &Settings, state: &StateDirectory) -> io::Result<Option<Chosen>> {
    if settings.prior != PriorKind::SimilarSubject {
        return Ok(None);
    }
    let profiles = state.profile_files()?.into_iter().filter_map(|path| Profile::read(&path).ok().flatten());
    Ok(profiles
        .filter(|profile| profile.subject != subject && profile.identified)
        .filter_map(|profile| compare(&profile, settings))
        .filter(|chosen| chosen.similar.likeness >= LIKENESS_MIN)
        .reduce(|best, other| if other.similar.likeness > best.similar.likeness { other } else { best }))
}

/// One sentence on the selection.
pub fn describe(chosen: Option<&Chosen>) -> String {
    match chosen {
        Some(chosen) => format!(
            "the prior is the table and subject {}, likeness {:.2}",
            chosen.subject, chosen.similar.likeness
        ),
        None => "no stored subject is similar enough; the prior is the table".to_owned(),
    }
}

fn compare(profile: &Profile, settings: &Settings) -> Option<Chosen> {
    let build = profile.build();
    let scaled_square = |difference: f64, width: f64| (difference / width).powi(2);
    let mass = match settings.mass_kg {
        Some(mass_kg) if profile.mass_kg > 0.0 => scaled_square(mass_kg - profile.mass_kg, MASS_WIDTH_KG),
        // Unavailable mass: assume one width.
        _ => 1.0,
    };
    let distance = scaled_square(settings.height_m - build.height_m, HEIGHT_WIDTH_M) + mass;
    let sex = if settings.sex == build.sex.into() { 1.0 } else { OTHER_SEX_FACTOR };
    let (deviation_m, variance_m2) = deviation(profile)?;
    let similar =
        Similar { deviation_m, variance_m2, likeness: LIKENESS_MAX * sex * (-0.5 * distance).exp() };
    Some(Chosen { subject: profile.subject.clone(), similar })
}

/// Deviation of a subject's Φ from that of the table with the same segment lengths, and its variance.
fn deviation(profile: &Profile) -> Option<([f64; PARAMETERS], [f64; PARAMETERS])> {
    let build = profile.build();
    let offset_m: [[f64; 3]; SEGMENTS] = profile.skeleton_m().try_into().ok()?;
    let skeleton = Skeleton { offset_m };
    let table = Phi::of(&skeleton, &Anthropometry::de_leva(&skeleton, build.height_m, build.sex.into()));
    let reduction = [ReductionKind::Full, ReductionKind::Merged, ReductionKind::Symmetric]
        .map(|kind| Reduction::new(kind, &table))
        .into_iter()
        .find(|reduction| reduction.count() == profile.parameters)?;
    let (theta_m, covariance_m2) = (profile.theta_m(), profile.covariance_m2());
    if theta_m.len() != profile.parameters || covariance_m2.len() != profile.parameters.pow(2) {
        return None;
    }
    let phi = reduction.phi(theta_m);
    let deviation_m = std::array::from_fn(|raw| phi.0[raw / 3][raw % 3] - table.0[raw / 3][raw % 3]);
    let variance_m2 = reduction.raw_variance(|index| covariance_m2[index * (profile.parameters + 1)]);
    let is_valid = deviation_m.iter().chain(&variance_m2).all(|value: &f64| value.is_finite())
        && variance_m2.iter().all(|variance| *variance >= 0.0);
    is_valid.then_some((deviation_m, variance_m2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use equipoise_config::method::Build;
    use equipoise_config::method::SexConfig;
    use equipoise_core::body::Segment;
    use equipoise_core::cycle::Identification;
    use equipoise_core::frame::{Pose, SuitWorld};
    use equipoise_core::static_pose::WINDOW;
    use std::path::Path;

    fn settings() -> Settings {
        Settings {
            prior: PriorKind::SimilarSubject,
            mass_kg: Some(72.0),
            sex: SexConfig::Male.into(),
            ..Settings::for_height(1.77)
        }
    }

    /// Stores a subject whose Φ equals the table's.
    fn store(folder: &Path, subject: &str, build: Build, mass_kg: f64, identified: u64) {
        let height_m = build.height_m;
        let settings = Settings { height_m, mass_kg: Some(mass_kg), ..settings() };
        let mut worker = bytemuck::zeroed_box::<Identification>();
        worker.start(&settings);
        let origin = Skeleton::nominal(height_m).t_pose_m().map(Into::into);
        let pose: Pose<SuitWorld> =
            Pose::new(origin, [equipoise_core::frame::rotation([1.0, 0.0, 0.0, 0.0]); SEGMENTS]);
        for _ in 0..WINDOW {
            worker.update_skeleton(&pose, &settings);
        }
        worker.identified = identified;
        let mut stored = bytemuck::zeroed_box();
        worker.store(&mut stored);
        let profile =
            Profile::of(subject, build, &stored, &bytemuck::Zeroable::zeroed(), &Default::default(), 0)
                .unwrap();
        std::fs::write(folder.join(format!("{subject}.toml")), profile.to_toml().unwrap()).unwrap();
    }

    #[test]
    fn the_most_similar_identified_subject_is_chosen() {
        let directory = tempfile::tempdir().unwrap();
        let state = StateDirectory::at(directory.path());
        let folder = state.profiles();
        let choose = |settings: &Settings| choose("me", settings, &state).unwrap();
        let build = |height_m, sex| Build { height_m, sex };
        assert!(choose(&settings()).is_none(), "no folder yet");
        std::fs::create_dir(&folder).unwrap();
        store(&folder, "far", build(1.60, SexConfig::Male), 72.0, 1);
        assert!(choose(&settings()).is_none(), "four widths away");
        store(&folder, "woman", build(1.77, SexConfig::Female), 72.0, 1);
        assert_eq!(choose(&settings()).unwrap().subject, "woman");
        store(&folder, "man", build(1.78, SexConfig::Male), 74.0, 1);
        store(&folder, "me", build(1.77, SexConfig::Male), 72.0, 1);
        store(&folder, "unfinished", build(1.77, SexConfig::Male), 72.0, 0);
        std::fs::write(folder.join("broken.toml"), "format = ").unwrap();
        let chosen = choose(&settings()).unwrap();
        assert_eq!(chosen.subject, "man");
        assert!((0.7..0.8).contains(&chosen.similar.likeness));
        assert!(describe(Some(&chosen)).contains("subject man, likeness 0.7"));
        let table = Settings { prior: PriorKind::Table, ..settings() };
        assert!(choose(&table).is_none());
    }

    #[test]
    fn an_unreadable_folder_is_an_error() {
        let directory = tempfile::tempdir().unwrap();
        let state = StateDirectory::at(directory.path());
        std::fs::write(state.profiles(), "a file where a folder should be").unwrap();
        assert!(choose("me", &settings(), &state).is_err());
    }

    #[test]
    fn the_difference_from_the_table_is_restored() {
        let folder = tempfile::tempdir().unwrap();
        store(folder.path(), "a", Build { height_m: 1.77, sex: SexConfig::Male }, 72.0, 1);
        let profile = Profile::read(&folder.path().join("a.toml")).unwrap().unwrap();
        let (deviation_m, variance_m2) = deviation(&profile).unwrap();
        // Soft constraints shift the table's values by less than half a millimetre.
        assert!(deviation_m.iter().all(|metres| metres.abs() < 5e-4), "{deviation_m:?}");
        assert!(variance_m2[3 * Segment::Pelvis.index()] > 0.0);
    }
}
