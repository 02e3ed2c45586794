//! Subjects: synthetic people of many statures and builds, each by a seed.

use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicUsize, Ordering};

use equipoise_core::body::Sex;
use equipoise_core::cycle::Settings;
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_simulator::motion::Habits;
use equipoise_simulator::person::Person;
use equipoise_simulator::random::Random;
use equipoise_simulator::realism::Realism;

use crate::sensors::Rig;

/// Range of statures, m.
const HEIGHT_M: [f64; 2] = [1.55, 1.95];
/// Range of masses, kg.
const MASS_KG: [f64; 2] = [50.0, 105.0];
/// Range of body mass indices, kg/m².
const BODY_MASS_INDEX: [f64; 2] = [19.0, 30.0];

/// One synthetic subject.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Subject {
    /// Seed of body, habits and sensors.
    pub seed: u64,
    /// Stature, m.
    pub height_m: f64,
    /// Body mass, kg.
    pub mass_kg: f64,
    /// Sex in the settings: it chooses the column of the table. The simulated body has no sex.
    pub sex: Sex,
    /// Deviations of body and contacts from ideal ones.
    pub realism: Realism,
}

/// The subjects of a study.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cohort {
    /// Seed of the first subject; the others follow consecutively.
    pub first_seed: u64,
    /// Number of subjects.
    pub count: usize,
    /// Realism of all subjects.
    pub realism: Realism,
}

impl Cohort {
    /// `count` subjects with consecutive seeds.
    pub fn subjects(&self) -> Vec<Subject> {
        self.by_seed(Subject::random)
    }

    /// As many bodies of the stature and mass of the paper's subject.
    pub fn of_the_paper(&self) -> Vec<Subject> {
        self.by_seed(Subject::of_the_paper)
    }

    fn by_seed(&self, subject: impl Fn(u64) -> Subject) -> Vec<Subject> {
        let seeds = (0..self.count as u64).map(|index| self.first_seed + index);
        seeds.map(|seed| Subject { realism: self.realism, ..subject(seed) }).collect()
    }
}

impl Subject {
    /// The paper's subject: 72 kg, 1.77 m, a man; the body follows from the seed.
    pub fn of_the_paper(seed: u64) -> Subject {
        Subject { seed, height_m: 1.77, mass_kg: 72.0, sex: Sex::Male, realism: Realism::REALISTIC }
    }

    /// Deviations of this subject from the commanded motion.
    pub fn habits(&self) -> Habits {
        self.realism.habits(self.seed)
    }

    /// The sensors of this subject's station.
    pub fn rig(&self) -> Rig {
        Rig::of(&self.realism, self.seed)
    }

    /// A random subject: stature, build and sex by the seed.
    pub fn random(seed: u64) -> Subject {
        let mut random = Random::new(seed, "subject");
        let height_m = random.between(HEIGHT_M[0], HEIGHT_M[1]);
        let index = random.between(BODY_MASS_INDEX[0], BODY_MASS_INDEX[1]);
        let mass_kg = (index * height_m * height_m).clamp(MASS_KG[0], MASS_KG[1]);
        let sex = if random.happens(0.5) { Sex::Female } else { Sex::Male };
        Subject { seed, height_m, mass_kg, sex, realism: Realism::REALISTIC }
    }

    /// The true body.
    pub fn person(&self) -> Person {
        Person::new(self.seed, self.height_m, self.mass_kg)
    }

    /// The default settings for this subject with the whole library; the mass is measured by the plate.
    pub fn settings(&self) -> Settings {
        Settings { sex: self.sex, library: LIBRARY, ..Settings::for_height(self.height_m) }
    }
}

/// Applies `function` to all items on as many threads as there are processors; results are in the order of the items.
pub fn map_in_parallel<I: Sync, T: Send>(items: &[I], function: impl Fn(&I) -> T + Sync) -> Vec<T> {
    let next = AtomicUsize::new(0);
    let results = Mutex::new(Vec::with_capacity(items.len()));
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(items.len());
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while let Some(index) =
                    Some(next.fetch_add(1, Ordering::Relaxed)).filter(|&index| index < items.len())
                {
                    let result = function(&items[index]);
                    results.lock().unwrap_or_else(PoisonError::into_inner).push((index, result));
                }
            });
        }
    });
    let mut results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    results.sort_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn subjects_are_plausible_and_follow_from_their_seed() {
        let cohort = Cohort { first_seed: 1, count: 200, realism: Realism::REALISTIC };
        for subject in cohort.subjects() {
            assert_eq!(subject, Subject::random(subject.seed));
            assert!((HEIGHT_M[0]..HEIGHT_M[1]).contains(&subject.height_m));
            assert!((MASS_KG[0]..=MASS_KG[1]).contains(&subject.mass_kg));
            let index = subject.mass_kg / subject.height_m.powi(2);
            assert!((18.0..=31.0).contains(&index), "{index}");
        }
    }

    #[test]
    fn results_are_in_the_order_of_the_items() {
        let items: Vec<u64> = (0..50).collect();
        assert_eq!(
            map_in_parallel(&items, |item| item * item),
            items.iter().map(|item| item * item).collect::<Vec<_>>()
        );
    }
}
