//! Verification with a known mass on the plate: measured weight, position and stability.
//!
//! The empty plate is measured first, and again whenever the mass is lifted off: all results are relative to it, so
//! they do not depend on the tare, and drift is detected.

pub mod places;
pub mod rod;
#[cfg(test)]
mod tests;

use equipoise_core::message::GroundSample;
use thiserror::Error;

use super::average::average;

/// Averaging interval of samples, ns: faster changes are noise.
pub const BLOCK_NS: u64 = 100_000_000;
/// Count of blocks in the average of the empty plate.
const ZERO_BLOCKS: usize = 20;
/// Count of steady blocks after which the plate has settled.
const STEADY_BLOCKS: usize = 10;
/// Largest change of a steady load: the larger of this many N and this fraction of the weight.
const STEADY: (f64, f64) = (1.0, 0.002);
/// A load is detected from this fraction of the mass's weight on, and its absence below two fifths of that: low enough
/// that a plate with a grossly wrong scale is still measured and reported.
const PRESENT: f64 = 0.05;

/// Settings of the verification.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VerifySettings {
    /// The mass, kg.
    pub mass_kg: f64,
    /// Local gravity, m/s².
    pub gravity_m_per_s2: f64,
    /// Duration of the measurement at each position, s.
    pub seconds: f64,
    /// Count of positions.
    pub places: usize,
}

impl VerifySettings {
    fn weight_n(&self) -> f64 {
        self.mass_kg * self.gravity_m_per_s2
    }

    fn steady_n(&self) -> f64 {
        STEADY.0.max(STEADY.1 * self.weight_n())
    }
}

/// The mean of some samples.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Block {
    /// N.
    pub force_n: [f64; 3],
    /// About the world's origin, N m.
    pub moment_nm: [f64; 3],
}

impl Block {
    /// The difference to another block.
    pub fn less(&self, other: &Block) -> Block {
        let off = |a: [f64; 3], b: [f64; 3]| core::array::from_fn(|axis| a[axis] - b[axis]);
        Block { force_n: off(self.force_n, other.force_n), moment_nm: off(self.moment_nm, other.moment_nm) }
    }
}

/// Averages samples to blocks.
#[derive(Debug, Clone, Copy, Default)]
pub struct Blocks {
    since_ns: u64,
    sum: Block,
    count: f64,
}

impl Blocks {
    /// Adds a sample; returns a block once it is full.
    pub fn take(&mut self, sample: &GroundSample) -> Option<Block> {
        let full = self.count > 0.0 && sample.sample_time_ns.saturating_sub(self.since_ns) >= BLOCK_NS;
        let mean = |sum: [f64; 3]| sum.map(|sum| sum / self.count);
        let done =
            full.then(|| Block { force_n: mean(self.sum.force_n), moment_nm: mean(self.sum.moment_nm) });
        if self.count == 0.0 || full || sample.sample_time_ns < self.since_ns {
            *self = Blocks { since_ns: sample.sample_time_ns, ..Blocks::default() };
        }
        for axis in 0..3 {
            self.sum.force_n[axis] += sample.force_n[axis];
            self.sum.moment_nm[axis] += sample.moment_nm[axis];
        }
        self.count += 1.0;
        done
    }
}

/// Result for the mass at one position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// Measured mass, kg.
    pub mass_kg: f64,
    /// 1-σ of the mass, kg.
    pub mass_sigma_kg: f64,
    /// Centre of pressure of the mass, world x and y, m.
    pub cop_m: [f64; 2],
    /// 1-σ of the centre of pressure, m.
    pub cop_sigma_m: [f64; 2],
    /// Change over the measurement, N.
    pub drift_n: f64,
}

/// Event of the verification.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// The empty plate was measured; its vertical force, N.
    Zeroed(f64),
    /// A load was placed and has settled.
    Settled,
    /// The mass was disturbed during the measurement, which restarts.
    Disturbed,
    /// A position is complete.
    Placed(Placed),
    /// The mass was lifted off; change of the empty plate's force since the start, N.
    Lifted(f64),
}

/// Why the verification cannot continue.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum VerifyRefusal {
    /// The sign of the plate's force is inverted.
    #[error(
        "the plate says that the mass pulls upwards with {pulls_n:.0} N: [ground] measures must be the other of \"action\" \
         and \"reaction\", or frame.axes the other way up"
    )]
    Pulls {
        /// Upward force of the mass, N.
        pulls_n: f64,
    },
    /// The plate reports a fault.
    #[error("the plate reports a fault, status {0:#x}")]
    Fault(u32),
}

#[derive(Debug, Clone)]
enum Phase {
    Zeroing,
    Waiting,
    Settling,
    Measuring(Vec<Block>),
    Lifting,
    Done,
}

/// State machine of a verification: samples in, events out.
#[derive(Debug, Clone)]
pub struct Verification {
    settings: VerifySettings,
    blocks: Blocks,
    recent: Vec<Block>,
    phase: Phase,
    zero: Block,
    /// Blocks of the empty plate: the uncertainty of their mean is part of every result.
    empty: Vec<Block>,
    first_zero_n: Option<f64>,
    placed: Vec<Placed>,
    surface_z_m: f64,
}

impl Verification {
    /// Creates a verification before any data; the plate should be empty.
    pub fn new(settings: VerifySettings) -> Verification {
        Verification {
            settings,
            blocks: Blocks::default(),
            recent: Vec::new(),
            phase: Phase::Zeroing,
            zero: Block::default(),
            empty: Vec::new(),
            first_zero_n: None,
            placed: Vec::new(),
            surface_z_m: 0.0,
        }
    }

    /// The results so far.
    pub fn placed(&self) -> &[Placed] {
        &self.placed
    }

    /// Whether all positions are complete.
    pub fn is_done(&self) -> bool {
        matches!(self.phase, Phase::Done)
    }

    /// Processes a sample.
    ///
    /// # Errors
    /// A [`VerifyRefusal`].
    pub fn take(&mut self, sample: &GroundSample) -> Result<Option<Step>, VerifyRefusal> {
        if sample.device_status != 0 {
            return Err(VerifyRefusal::Fault(sample.device_status));
        }
        self.surface_z_m = sample.surface_z_m;
        let Some(block) = self.blocks.take(sample) else { return Ok(None) };
        self.recent.push(block);
        if self.recent.len() > ZERO_BLOCKS {
            self.recent.remove(0);
        }
        self.follow(block)
    }

    fn follow(&mut self, block: Block) -> Result<Option<Step>, VerifyRefusal> {
        let more_n = block.less(&self.zero).force_n[2];
        let there_n = (PRESENT * self.settings.weight_n()).max(3.0 * self.settings.steady_n());
        let gone_n = 0.4 * there_n;
        let [settled, empty] = [STEADY_BLOCKS, ZERO_BLOCKS].map(|blocks| self.is_steady(blocks));
        let step = match &mut self.phase {
            Phase::Zeroing => empty.then(|| self.take_zero()),
            Phase::Waiting if more_n < -there_n => {
                return Err(VerifyRefusal::Pulls { pulls_n: -more_n });
            }
            Phase::Waiting if more_n > there_n => self.enter(Phase::Settling, None),
            Phase::Settling if more_n < gone_n => self.enter(Phase::Waiting, None),
            Phase::Settling if settled => self.enter(Phase::Measuring(Vec::new()), Some(Step::Settled)),
            Phase::Measuring(blocks) => {
                let wanted = (self.settings.seconds / (BLOCK_NS as f64 * 1e-9)).ceil().max(2.0) as usize;
                let first_n = blocks.first().map_or(block.force_n[2], |first| first.force_n[2]);
                if (block.force_n[2] - first_n).abs() > 3.0 * self.settings.steady_n() {
                    return Ok(self.enter(Phase::Settling, Some(Step::Disturbed)));
                }
                blocks.push(block);
                if blocks.len() < wanted { None } else { Some(self.finish()) }
            }
            Phase::Lifting if empty && more_n.abs() < gone_n => Some(self.take_zero()),
            _ => None,
        };
        Ok(step)
    }

    fn enter(&mut self, phase: Phase, step: Option<Step>) -> Option<Step> {
        self.phase = phase;
        self.recent.clear();
        step
    }

    /// Whether the last blocks are steady.
    fn is_steady(&self, blocks: usize) -> bool {
        let Some(from) = self.recent.len().checked_sub(blocks) else { return false };
        let vertical_n = self.recent[from..].iter().map(|block| block.force_n[2]);
        let (least, most) =
            vertical_n.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), n| (a.min(n), b.max(n)));
        most - least < self.settings.steady_n()
    }

    /// Stores the mean of the empty plate, at the start or again.
    fn take_zero(&mut self) -> Step {
        self.zero = mean_of(&self.recent);
        self.empty.clone_from(&self.recent);
        let shows_n = self.zero.force_n[2];
        self.enter(Phase::Waiting, None);
        match self.first_zero_n {
            None => {
                self.first_zero_n = Some(shows_n);
                Step::Zeroed(shows_n)
            }
            Some(first_n) => Step::Lifted(shows_n - first_n),
        }
    }

    fn finish(&mut self) -> Step {
        let next = if self.placed.len() + 1 < self.settings.places { Phase::Lifting } else { Phase::Done };
        let blocks = match core::mem::replace(&mut self.phase, next) {
            Phase::Measuring(blocks) => blocks,
            _ => Vec::new(),
        };
        self.recent.clear();
        let of = |value: &dyn Fn(&Block) -> f64| -> Vec<f64> {
            blocks.iter().map(|block| value(&block.less(&self.zero))).collect()
        };
        let vertical = average(&of(&|block| block.force_n[2]));
        let empty =
            |value: &dyn Fn(&Block) -> f64| average(&self.empty.iter().map(value).collect::<Vec<_>>()).sigma;
        let zero_sigma_n = empty(&|block| block.force_n[2]);
        // x and y follow from the moments about y and x.
        let zero_sigma_m = [1, 0].map(|axis| empty(&|block| block.moment_nm[axis]) / vertical.mean.abs());
        let centre = [0, 1].map(|axis| average(&of(&|block| centre_m(block, self.surface_z_m)[axis])));
        let gravity = self.settings.gravity_m_per_s2;
        let placed = Placed {
            mass_kg: vertical.mean / gravity,
            mass_sigma_kg: vertical.sigma.hypot(zero_sigma_n) / gravity,
            cop_m: centre.map(|axis| axis.mean),
            cop_sigma_m: [0, 1].map(|axis| centre[axis].sigma.hypot(zero_sigma_m[axis])),
            drift_n: vertical.drift,
        };
        self.placed.push(placed);
        Step::Placed(placed)
    }
}

/// Centre of pressure of a wrench on a surface, m; called only for blocks with a mass on the plate.
fn centre_m(block: &Block, surface_z_m: f64) -> [f64; 2] {
    let ([fx, fy, fz], [mx, my, _]) = (block.force_n, block.moment_nm);
    [(surface_z_m * fx - my) / fz, (mx + surface_z_m * fy) / fz]
}

fn mean_of(blocks: &[Block]) -> Block {
    let mean = |axis: usize, of: fn(&Block) -> [f64; 3]| {
        blocks.iter().map(|block| of(block)[axis]).sum::<f64>() / blocks.len().max(1) as f64
    };
    Block {
        force_n: [0, 1, 2].map(|axis| mean(axis, |block| block.force_n)),
        moment_nm: [0, 1, 2].map(|axis| mean(axis, |block| block.moment_nm)),
    }
}
