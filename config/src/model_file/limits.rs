//! Ranges of the numbers in a model file. Chosen: a number outside them is a typing error.

use std::f64::consts::PI;

/// Times in a model file, at most: a year, s.
pub(super) const TIME_MAX_S: f64 = 366.0 * 86_400.0;
/// Letters of an explanation's name in a model file, at most.
pub(super) const NAME_MAX: usize = 64;
/// Ranges of a shape in a model file: lag, cutoff, frequency, time constant. s, Hz, Hz, s.
pub(super) const SHAPES: [[f64; 2]; 4] = [[-0.5, 0.5], [0.05, 500.0], [0.01, 10.0], [0.1, 100_000.0]];
/// Largest parameter in a model file, by its unit. The last is of all others.
const LARGEST: [(&str, f64); 8] = [
    ("kg", 150.0),
    ("kg m", 75.0),
    ("N", 2000.0),
    ("m/s", 0.01),
    ("rad", PI),
    ("rad/s", 0.1),
    ("Hz", 500.0),
    ("", 1.5),
];
/// Largest 1-σ of a parameter, in units of its largest value: beyond, the recording does not determine the parameter.
pub(super) const SIGMA_MAX: f64 = 100.0;
/// Largest log Bayes factor, nats: a hundred per sample of a suit at 240 Hz over a year.
pub(super) const LOG_ODDS_MAX: f64 = 1e12;
/// Largest turn, step, standing, separation and information of a request in a model file. °, m, s, σ, nats.
pub(super) const ASK_MAX: [f64; 5] = [180.0, 1.0, 3600.0, 1e9, 1e3];

/// Largest value of a parameter with this unit.
pub fn largest(unit: &str) -> f64 {
    let [.., (_, of_others)] = LARGEST;
    LARGEST.iter().find(|(name, _)| *name == unit).map_or(of_others, |&(_, largest)| largest)
}
