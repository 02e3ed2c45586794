//! A small quasi-Newton search between bounds: half a dozen unknowns, a gradient, a good initial curvature.

/// Maximum number of steps: the sizes of the noise need no more digits than this gives.
const STEPS: usize = 16;

/// Minimises `of` (value and gradient; `None` where it is undefined) from `start`, within `least` and `most`.
/// `curvature` is the diagonal of an approximate second derivative.
pub(super) fn minimise<const N: usize>(
    start: [f64; N],
    least: [f64; N],
    most: [f64; N],
    curvature: [f64; N],
    of: impl Fn(&[f64; N]) -> Option<(f64, [f64; N])>,
) -> Option<[f64; N]> {
    let mut at = start;
    let (mut value, mut slope) = of(&at)?;
    let mut inverse: [[f64; N]; N] =
        std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 1.0 / curvature[i] } else { 0.0 }));
    for _ in 0..STEPS {
        let direction: [f64; N] =
            std::array::from_fn(|i| -(0..N).map(|j| inverse[i][j] * slope[j]).sum::<f64>());
        let Some((next, next_value, next_slope)) = search(&at, value, &direction, &least, &most, &of) else {
            break;
        };
        let step: [f64; N] = std::array::from_fn(|i| next[i] - at[i]);
        let change: [f64; N] = std::array::from_fn(|i| next_slope[i] - slope[i]);
        update(&mut inverse, &step, &change);
        let gained = value - next_value;
        (at, value, slope) = (next, next_value, next_slope);
        if gained < 0.01 {
            break;
        }
    }
    Some(at)
}

type Found<const N: usize> = ([f64; N], f64, [f64; N]);

/// Halves the step until the value decreases; each unknown moves by at most 1.5.
fn search<const N: usize>(
    at: &[f64; N],
    value: f64,
    direction: &[f64; N],
    least: &[f64; N],
    most: &[f64; N],
    of: impl Fn(&[f64; N]) -> Option<(f64, [f64; N])>,
) -> Option<Found<N>> {
    let longest = direction.iter().fold(0.0_f64, |longest, step| longest.max(step.abs()));
    let mut share = if longest > 1.5 { 1.5 / longest } else { 1.0 };
    for _ in 0..6 {
        let next: [f64; N] = std::array::from_fn(|i| (at[i] + share * direction[i]).clamp(least[i], most[i]));
        if let Some((next_value, slope)) = of(&next)
            && next_value < value
        {
            return Some((next, next_value, slope));
        }
        share *= 0.4;
    }
    None
}

/// The update of Broyden, Fletcher, Goldfarb and Shanno of an inverse curvature.
fn update<const N: usize>(inverse: &mut [[f64; N]; N], step: &[f64; N], change: &[f64; N]) {
    let along: f64 = (0..N).map(|i| step[i] * change[i]).sum();
    if along <= 1e-10 {
        return;
    }
    let moved: [f64; N] = std::array::from_fn(|i| (0..N).map(|j| inverse[i][j] * change[j]).sum());
    let scale = (1.0 + (0..N).map(|i| change[i] * moved[i]).sum::<f64>() / along) / along;
    for i in 0..N {
        for j in 0..N {
            inverse[i][j] += scale * step[i] * step[j] - (moved[i] * step[j] + step[i] * moved[j]) / along;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_bottom_of_a_bent_valley_and_keeps_its_bounds() {
        let valley = |at: &[f64; 2]| {
            let (a, b) = (1.0 - at[0], at[1] - at[0] * at[0]);
            Some((20.0 * (a * a + 5.0 * b * b), [-40.0 * a - 400.0 * b * at[0], 200.0 * b]))
        };
        let free = minimise([-0.5, 1.0], [-9.0; 2], [9.0; 2], [40.0, 200.0], valley).unwrap();
        assert!((free[0] - 1.0).abs() < 0.1, "{free:?}");
        let bound = minimise([-0.5, 1.0], [-9.0; 2], [0.5, 9.0], [40.0, 200.0], valley).unwrap();
        assert!(bound[0] <= 0.5 && bound[0] > 0.4, "{bound:?}");
    }
}
