//! Reproducible randomness: each use has its own stream of a seed.

use core::f64::consts::TAU;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// A stream of pseudo-random numbers; the same seed and purpose give the same numbers on every machine.
#[derive(Debug, Clone)]
pub struct Random(Pcg64Mcg);

impl Random {
    /// The stream for one purpose, for example `"plate noise"`: independent of streams of other purposes.
    pub fn new(seed: u64, purpose: &str) -> Random {
        Random::numbered(seed, purpose, 0)
    }

    /// One of many streams for a purpose, for example that of one sample: independent of those before it.
    pub fn numbered(seed: u64, purpose: &str, number: u32) -> Random {
        // FNV-1a spreads all three over 64 bits.
        let bytes = seed.to_le_bytes().into_iter().chain(number.to_le_bytes()).chain(purpose.bytes());
        let spread = bytes.fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        });
        Random(Pcg64Mcg::seed_from_u64(spread))
    }

    /// Uniform in `[0, 1)`.
    pub fn unit(&mut self) -> f64 {
        // 53 bits: every value is exact.
        (self.0.next_u64() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// Uniform between two bounds.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Normal with mean 0 and standard deviation 1 (Box–Muller).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (TAU * self.unit()).cos()
    }

    /// True with the given probability.
    pub fn happens(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }
}

/// Slow band-limited noise: a sum of a few sines of unrelated frequencies and random phases.
///
/// Evaluated at any time in any order, and smooth, so that it has a velocity and an acceleration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BandLimitedNoise {
    sines: [(f64, f64, f64); BandLimitedNoise::SINES], // amplitude, rad/s, phase
}

impl BandLimitedNoise {
    const SINES: usize = 5;
    /// Zero at all times.
    pub const NONE: BandLimitedNoise = BandLimitedNoise { sines: [(0.0, 0.0, 0.0); BandLimitedNoise::SINES] };

    /// One of standard deviation `sigma` with frequencies between two bounds in hertz.
    pub fn new(random: &mut Random, sigma: f64, slowest_hz: f64, fastest_hz: f64) -> BandLimitedNoise {
        let BandLimitedNoise { mut sines } = BandLimitedNoise::NONE;
        let mut power = 0.0;
        for (index, sine) in sines.iter_mut().enumerate() {
            let fraction = (index as f64 + random.unit()) / BandLimitedNoise::SINES as f64;
            let hertz = slowest_hz * (fastest_hz / slowest_hz).powf(fraction);
            // Lower frequencies have larger amplitudes, as in a person's sway.
            let amplitude = (slowest_hz / hertz).sqrt();
            power += 0.5 * amplitude * amplitude;
            *sine = (amplitude, TAU * hertz, random.between(0.0, TAU));
        }
        for sine in &mut sines {
            sine.0 *= sigma / power.sqrt();
        }
        BandLimitedNoise { sines }
    }

    /// The value at a time in seconds.
    pub fn at(&self, time_s: f64) -> f64 {
        self.sines.iter().map(|(amplitude, rate, phase)| amplitude * (rate * time_s + phase).sin()).sum()
    }
}

/// A smoothed Ornstein–Uhlenbeck process as a function of time. Its spectrum is broad; in a [`BandLimitedNoise`] a search
/// for a period would find one.
///
/// Evaluated at any time in any order; it has a velocity and an acceleration.
#[derive(Debug, Clone)]
pub struct Coloured {
    sigma: f64,
    step_s: f64,
    /// The last knot's value over `sigma`.
    last: f64,
    /// Values at the knots of a uniform cubic B-spline; the first belongs to `-step_s`.
    knots: Vec<f64>,
}

impl Coloured {
    /// Knots per correlation time.
    const KNOTS: f64 = 8.0;

    /// Noise of standard deviation `sigma` with correlation time `tau_s`, from 0 to `length_s`.
    pub fn new(random: &mut Random, sigma: f64, tau_s: f64, length_s: f64) -> Coloured {
        let step_s = tau_s / Coloured::KNOTS;
        let mut noise = Coloured { sigma, step_s, last: random.normal(), knots: Vec::new() };
        noise.extend(random, length_s);
        noise
    }

    /// Continues it to a later end; what was before stays the same.
    pub fn extend(&mut self, random: &mut Random, length_s: f64) {
        let kept = (-1.0 / Coloured::KNOTS).exp();
        let added = (1.0 - kept * kept).sqrt();
        let count = (length_s / self.step_s).ceil() as usize + 4;
        while self.knots.len() < count {
            self.last = kept * self.last + added * random.normal();
            self.knots.push(self.sigma * self.last);
        }
    }

    /// The value at a time in seconds; constant beyond its ends.
    pub fn at(&self, time_s: f64) -> f64 {
        let place = (time_s / self.step_s).clamp(0.0, (self.knots.len() - 4) as f64);
        let index = (place as usize).min(self.knots.len() - 4);
        let t = place - index as f64;
        let u = 1.0 - t;
        let weights =
            [u * u * u, 3.0 * t * t * t - 6.0 * t * t + 4.0, 3.0 * u * u * u - 6.0 * u * u + 4.0, t * t * t];
        weights.iter().zip(&self.knots[index..]).map(|(weight, knot)| weight * knot).sum::<f64>() / 6.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coloured_noise_has_its_size_and_its_memory() {
        let (mut square, mut near, mut far) = (0.0, 0.0, 0.0);
        for seed in 0..400 {
            let noise = Coloured::new(&mut Random::new(seed, "coloured"), 2.0, 3.0, 60.0);
            let now = noise.at(20.0);
            square += now * now / 400.0;
            near += now * noise.at(20.5) / 400.0;
            far += now * noise.at(40.0) / 400.0;
        }
        assert!((2.8..5.2).contains(&square), "{square}");
        assert!(near > 0.75 * square && far.abs() < 0.25 * square, "{near} {far} of {square}");
    }

    #[test]
    fn extended_noise_keeps_its_beginning_and_its_size() {
        let (mut square, mut square_later) = (0.0, 0.0);
        for seed in 0..400 {
            let before = Coloured::new(&mut Random::new(seed, "coloured"), 2.0, 3.0, 20.0);
            let mut longer = before.clone();
            longer.extend(&mut Random::new(seed, "continued"), 60.0);
            for step in 0..=40 {
                let time_s = 0.5 * f64::from(step);
                assert_eq!(longer.at(time_s), before.at(time_s), "seed {seed} at {time_s} s");
            }
            assert_ne!(longer.at(30.0), longer.at(40.0));
            square += before.at(10.0).powi(2) / 400.0;
            square_later += longer.at(45.0).powi(2) / 400.0;
        }
        assert!((0.7..1.4).contains(&(square_later / square)), "{square_later} after {square}");
    }

    #[test]
    fn a_seed_gives_the_same_numbers_and_a_purpose_its_own() {
        let draw = |seed, purpose| {
            let mut random = Random::new(seed, purpose);
            [random.unit(), random.normal()]
        };
        assert_eq!(draw(7, "plate"), draw(7, "plate"));
        assert_ne!(draw(7, "plate"), draw(7, "suit"));
        assert_ne!(draw(7, "plate"), draw(8, "plate"));
    }

    #[test]
    fn normal_numbers_have_unit_variance() {
        let mut random = Random::new(1, "test");
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..20_000 {
            let x = random.normal();
            sum += x;
            squares += x * x;
        }
        assert!((sum / 20_000.0).abs() < 0.03 && (squares / 20_000.0 - 1.0).abs() < 0.05);
    }
}
