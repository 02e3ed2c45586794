//! Places of a part in front of a worker.

use nalgebra::Vector3;

/// Region of the places from the middle between the ankles on the floor: forward, to the left, up, from and to, m.
pub type Region = [[f64; 2]; 3];

/// The places in front of a standing worker.
pub const REGION_M: Region = [[0.3, 0.7], [-0.4, 0.4], [0.6, 1.5]];
/// Spacing of the places, m: half of that over which the overload changes by its σ.
pub const SPACING_M: f64 = 0.05;

/// The places of a region at [`SPACING_M`], its bounds included, m.
pub fn places(region_m: Region) -> impl Iterator<Item = Vector3<f64>> {
    let along = move |axis: usize| {
        let [low, high] = region_m[axis];
        let steps = ((high - low) / SPACING_M + 0.5) as u32;
        (0..=steps).map(move |step| low + f64::from(step) * SPACING_M)
    };
    along(2).flat_map(move |z| along(1).flat_map(move |y| along(0).map(move |x| Vector3::new(x, y, z))))
}
