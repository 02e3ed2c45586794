//! Removes the contribution of effects already found.

use equipoise_core::effect::{Effect, Model};

use crate::block::{Block, CUTOFFS_HZ, Change};

/// Subtracts the contribution of the model's terms from the plate's measurements, block by block. A lag of the suit is
/// excluded: the cycle has already corrected the sample times.
pub(super) fn subtract(blocks: &mut [Block], model: &Model) {
    for block in blocks.iter_mut() {
        let (mut cop_m, mut force_n) = model.change(&block.observation);
        let filters = model.at(block.observation.time_s).filter(|term| term.effect == Effect::PlateLowpass);
        for filter in filters {
            let change = at_cutoff(&block.by_cutoff, filter.shape);
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

/// Change by a low-pass filter of any cutoff, interpolated between the cutoffs stored in the blocks: the change is
/// proportional to the filter's delay, 1/cutoff.
fn at_cutoff(by_cutoff: &[Change; CUTOFFS_HZ.len()], cutoff_hz: f64) -> Change {
    let last = CUTOFFS_HZ.len() - 1;
    let above = CUTOFFS_HZ.partition_point(|stored_hz| *stored_hz < cutoff_hz);
    let delay_s = 1.0 / cutoff_hz;
    // Above the highest cutoff the change approaches zero; below the lowest it equals that of the lowest.
    let (nearest, share, far) = match above {
        0 => (&by_cutoff[0], 0.0, &by_cutoff[0]),
        above if above > last => {
            let nothing = delay_s * CUTOFFS_HZ[last];
            return scaled(&by_cutoff[last], nothing);
        }
        above => {
            let [slow_s, fast_s] = [1.0 / CUTOFFS_HZ[above - 1], 1.0 / CUTOFFS_HZ[above]];
            (&by_cutoff[above - 1], (slow_s - delay_s) / (slow_s - fast_s), &by_cutoff[above])
        }
    };
    let [one, other] = [scaled(nearest, 1.0 - share), scaled(far, share)];
    Change {
        cop_m: std::array::from_fn(|axis| one.cop_m[axis] + other.cop_m[axis]),
        force_n: std::array::from_fn(|axis| one.force_n[axis] + other.force_n[axis]),
    }
}

fn scaled(change: &Change, by: f64) -> Change {
    Change { cop_m: change.cop_m.map(|part| by * part), force_n: change.force_n.map(|part| by * part) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_filter_between_two_stored_cutoffs_is_interpolated_by_delay() {
        let by_cutoff =
            CUTOFFS_HZ.map(|cutoff_hz| Change { cop_m: [1.0 / cutoff_hz, 0.0], force_n: [0.0; 3] });
        for cutoff_hz in [0.5, 0.6, 1.0, 2.5, 6.9, 7.0, 20.0] {
            let change = at_cutoff(&by_cutoff, cutoff_hz);
            assert!((change.cop_m[0] - 1.0 / cutoff_hz).abs() < 1e-12, "{cutoff_hz}");
        }
    }
}
