//! Removes the contribution of effects already found.

use equipoise_core::effect::{Effect, Model};

use crate::block::Block;
use crate::candidate::cutoff_change;

/// Subtracts the contribution of the model's terms from the plate's measurements, block by block. A lag of the suit is
/// excluded: the cycle has already corrected the sample times.
pub(super) fn subtract(blocks: &mut [Block], model: &Model) {
    for block in blocks.iter_mut() {
        let (mut cop_m, mut force_n) = model.change(&block.observation);
        let filters = model.at(block.observation.time_s).filter(|term| term.effect == Effect::PlateLowpass);
        for filter in filters {
            let change = cutoff_change(&block.by_cutoff, filter.shape);
            for (sum, part) in cop_m.iter_mut().zip(change.cop_m) {
                *sum += part;
            }
            for (sum, part) in force_n.iter_mut().zip(change.force_n) {
                *sum += part;
            }
        }
        let observation = &mut block.observation;
        for (measured, effect) in observation.cop_measured_m.iter_mut().zip(cop_m) {
            *measured -= effect;
        }
        for (measured, effect) in observation.force_measured_n.iter_mut().zip(force_n) {
            *measured -= effect;
        }
    }
}
