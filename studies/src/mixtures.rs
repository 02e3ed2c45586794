//! Poses outside the repertoire: the trunk of one of its poses with the arms of two others.

use equipoise_simulator::balance::Standing;
use equipoise_simulator::intention::Intention;
use equipoise_simulator::limits;
use equipoise_simulator::motion::Worker;
use equipoise_simulator::random::Random;
use equipoise_simulator::repertoire::REPERTOIRE;

/// `count` mixtures by a seed that this worker can hold and that are not poses of the repertoire themselves.
pub fn mixtures(worker: &Worker, seed: u64, count: usize) -> Vec<Intention> {
    let mut random = Random::new(seed, "mixtures");
    let mut any = || REPERTOIRE[(random.unit() * REPERTOIRE.len() as f64) as usize].1;
    let mut found: Vec<Intention> = Vec::with_capacity(count);
    while found.len() < count {
        let (trunk, left, right) = (any(), any(), any());
        let mixture = Intention { left_arm: left.left_arm, right_arm: right.right_arm, ..trunk };
        let known = REPERTOIRE.iter().any(|(_, intention)| *intention == mixture) || found.contains(&mixture);
        if !known && can_hold(worker, &mixture) {
            found.push(mixture);
        }
    }
    found
}

/// Whether balance and joint limits permit it.
fn can_hold(worker: &Worker, intention: &Intention) -> bool {
    let (person, stance) = (worker.person(), worker.stance());
    let standing = Standing { person, com_m: &person.com_m, stance, load_kg: 0.0 };
    let target_m = stance.between_the_feet_m(0.025 * person.height_m);
    limits::check(&standing.balance(&intention.pose(), target_m)).is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::subject::Subject;

    #[test]
    fn mixtures_follow_from_the_seed_and_are_not_of_the_repertoire() {
        for subject in (1..6).map(Subject::random) {
            let worker = Worker::new(subject.person(), subject.seed);
            let mixed = mixtures(&worker, 7, 15);
            assert_eq!(mixed, mixtures(&worker, 7, 15));
            assert_ne!(mixed, mixtures(&worker, 8, 15));
            assert!(mixed.iter().all(|mixture| REPERTOIRE.iter().all(|(_, known)| known != mixture)));
        }
    }
}
