//! Blind benchmark of the discrepancy workflow: sessions with a hidden effect, and an evaluator of the findings.
//!
//! Layers, lowest first: [`truth`] → [`effects`] → [`ladder`] (hidden effect and its size) → [`scenario`] (activity of
//! the worker) → [`recording`] → [`make`]; [`families`] → [`evaluation`] → [`score`] (runs the program) →
//! [`summary`], [`experiments`] → [`cli`]; independent of them [`long`] (resources of the program for a whole shift).
//! The generator uses the simulator's physics and sensors and not `core`'s effects: names, places, parameters and units
//! are those of the catalogue, its columns are not used.

pub mod cli;
pub mod effects;
pub mod evaluation;
pub mod experiments;
pub mod families;
pub mod ladder;
pub mod long;
pub mod make;
pub mod recording;
pub mod scenario;
pub mod score;
pub mod summary;
pub mod truth;

#[cfg(test)]
mod tests {
    use std::path::Path;

    #[test]
    fn the_generator_does_not_share_the_estimator_s_effects() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/hidden");
        let mut files = 0;
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                continue; // Tests.
            }
            let text = std::fs::read_to_string(&path).unwrap();
            files += 1;
            for module in ["effect", "sesc", "kalman"] {
                let used = format!("equipoise_core::{module}");
                assert!(!text.contains(&used), "{} uses {used}", path.display());
            }
        }
        assert!(files > 8, "{files}");
    }
}
