//! Decimation: as many points as a picture can show, with the extremes kept.

use std::collections::HashSet;

use super::scale::Scale;
use crate::constants::TREND;

/// Values within one column of the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Column {
    first_x: f64,
    last_x: f64,
    lowest: [f64; 2],
    highest: [f64; 2],
    sum: f64,
    count: f64,
}

/// Range of a line within one column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::report) struct Range {
    pub(in crate::report) x: f64,
    pub(in crate::report) lowest: f64,
    pub(in crate::report) mean: f64,
    pub(in crate::report) highest: f64,
}

/// Runs of ranges, one per column of the picture, interrupted at gaps longer than `gap`.
pub(in crate::report) fn ranges(points: &[[f64; 2]], x: Scale, columns: usize, gap: f64) -> Vec<Vec<Range>> {
    let mut runs: Vec<Vec<Range>> = Vec::new();
    let mut last_x = f64::NEG_INFINITY;
    for column in by_column(points, x, columns) {
        if column.first_x - last_x > gap || runs.is_empty() {
            runs.push(Vec::new());
        }
        last_x = column.last_x;
        if let Some(run) = runs.last_mut() {
            let x = (column.first_x + column.last_x) / 2.0;
            let mean = column.sum / column.count;
            run.push(Range { x, lowest: column.lowest[1], mean, highest: column.highest[1] });
        }
    }
    runs
}

/// Runs of a line: points by x, at most two per column of the picture (its lowest and highest, in their order),
/// interrupted at gaps longer than `gap`. Points that are not finite are left out.
pub(in crate::report) fn line(points: &[[f64; 2]], x: Scale, columns: usize, gap: f64) -> Vec<Vec<[f64; 2]>> {
    let mut runs: Vec<Vec<[f64; 2]>> = Vec::new();
    let mut last_x = f64::NEG_INFINITY;
    for column in by_column(points, x, columns) {
        if column.first_x - last_x > gap || runs.is_empty() {
            runs.push(Vec::new());
        }
        last_x = column.last_x;
        if let Some(run) = runs.last_mut() {
            let (low, high) = (column.lowest, column.highest);
            run.extend(if low[0] <= high[0] { [low, high] } else { [high, low] });
            run.dedup();
        }
    }
    runs
}

fn by_column(points: &[[f64; 2]], x: Scale, columns: usize) -> Vec<Column> {
    let mut all: Vec<(usize, Column)> = Vec::new();
    for &point in points.iter().filter(|point| point.iter().all(|value| value.is_finite())) {
        let index = (x.fraction(point[0]) * columns as f64) as usize;
        match all.last_mut() {
            Some((last, column)) if *last == index => {
                column.last_x = point[0];
                column.sum += point[1];
                column.count += 1.0;
                if point[1] < column.lowest[1] {
                    column.lowest = point;
                }
                if point[1] > column.highest[1] {
                    column.highest = point;
                }
            }
            _ => {
                let column = Column {
                    first_x: point[0],
                    last_x: point[0],
                    lowest: point,
                    highest: point,
                    sum: point[1],
                    count: 1.0,
                };
                all.push((index, column));
            }
        }
    }
    all.into_iter().map(|(_, column)| column).collect()
}

/// At most about `max` dots that cover the same area as all of them: one per cell of a grid, which is coarsened until
/// they are few enough. The extremes of both axes are always kept.
pub(in crate::report) fn dots(points: &[[f64; 2]], x: Scale, y: Scale, max: usize) -> Vec<[f64; 2]> {
    let finite: Vec<[f64; 2]> =
        points.iter().copied().filter(|point| point.iter().all(|value| value.is_finite())).collect();
    let mut cells = 160.0;
    loop {
        let mut taken = HashSet::new();
        let mut kept: Vec<[f64; 2]> = extremes(&finite);
        kept.extend(finite.iter().copied().filter(|point| {
            let cell = ((x.fraction(point[0]) * 2.0 * cells) as u32, (y.fraction(point[1]) * cells) as u32);
            taken.insert(cell)
        }));
        if taken.len() <= max || cells < 8.0 {
            return kept;
        }
        cells *= 0.8;
    }
}

fn extremes(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let by = |axis: usize| move |a: &&[f64; 2], b: &&[f64; 2]| a[axis].total_cmp(&b[axis]);
    let all = [
        points.iter().min_by(by(0)),
        points.iter().max_by(by(0)),
        points.iter().min_by(by(1)),
        points.iter().max_by(by(1)),
    ];
    all.into_iter().flatten().copied().collect()
}

/// Means of y over equal parts of the x range that hold enough points: a trend line of the scatter plot.
pub(in crate::report) fn means(points: &[[f64; 2]], x: Scale, parts: usize) -> Vec<[f64; 2]> {
    let (_, points_min) = TREND;
    let mut sums = vec![[0.0; 3]; parts];
    for point in points.iter().filter(|point| point.iter().all(|value| value.is_finite())) {
        let part = ((x.fraction(point[0]) * parts as f64) as usize).min(parts - 1);
        for (sum, value) in sums[part].iter_mut().zip([1.0, point[0], point[1]]) {
            *sum += value;
        }
    }
    sums.iter().filter(|sum| sum[0] >= points_min).map(|sum| [sum[1] / sum[0], sum[2] / sum[0]]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jagged(count: usize) -> Vec<[f64; 2]> {
        (0..count).map(|n| [n as f64 * 0.3, (n as f64 * 12.9898).sin() * (n as f64 * 0.001).cos()]).collect()
    }

    #[test]
    fn a_thinned_line_keeps_the_extremes_and_every_columns_range() {
        let points = jagged(200_000);
        let x = Scale::covering(points.iter().map(|point| point[0]));
        let runs = line(&points, x, 480, 1.0);
        assert_eq!(runs.len(), 1);
        assert!(runs[0].len() <= 2 * 481, "{}", runs[0].len());
        for kept in by_column(&runs[0], x, 480).iter().zip(by_column(&points, x, 480)) {
            assert_eq!((kept.0.lowest, kept.0.highest), (kept.1.lowest, kept.1.highest));
        }
        assert!(runs[0].windows(2).all(|pair| pair[0][0] < pair[1][0]), "the order in time");
    }

    #[test]
    fn ranges_hold_every_point_and_their_mean() {
        let points = jagged(200_000);
        let x = Scale::covering(points.iter().map(|point| point[0]));
        let runs = ranges(&points, x, 300, 1.0);
        assert_eq!(runs.len(), 1);
        assert!(runs[0].iter().all(|range| range.lowest <= range.mean && range.mean <= range.highest));
        let highest = runs[0].iter().map(|range| range.highest).fold(f64::MIN, f64::max);
        let lowest = runs[0].iter().map(|range| range.lowest).fold(f64::MAX, f64::min);
        let all = |best: fn(f64, f64) -> f64, from| points.iter().map(|point| point[1]).fold(from, best);
        assert_eq!((highest, lowest), (all(f64::max, f64::MIN), all(f64::min, f64::MAX)));
        let whole = ranges(&points, x, 1, 1.0)[0][0].mean;
        let mean = points.iter().map(|point| point[1]).sum::<f64>() / points.len() as f64;
        assert!((whole - mean).abs() < 1e-6 + 1e-3 * mean.abs(), "{whole} {mean}");
    }

    #[test]
    fn a_short_line_stays_as_it_is_and_breaks_where_nothing_was() {
        let mut points = jagged(100);
        points.retain(|point| !(9.0..15.0).contains(&point[0]));
        let x = Scale::covering(points.iter().map(|point| point[0]));
        let runs = line(&points, x, 480, 1.0);
        assert_eq!(runs.len(), 2);
        assert_eq!(runs.concat(), points);
    }

    #[test]
    fn thinned_dots_are_some_of_the_dots_and_keep_the_extremes() {
        let points = jagged(200_000);
        let (x, y) = (
            Scale::covering(points.iter().map(|point| point[0])),
            Scale::covering(points.iter().map(|point| point[1])),
        );
        let kept = dots(&points, x, y, 700);
        assert!(kept.len() <= 704 && kept.len() > 200, "{}", kept.len());
        let highest = |points: &[[f64; 2]]| points.iter().map(|point| point[1]).fold(f64::MIN, f64::max);
        let lowest = |points: &[[f64; 2]]| points.iter().map(|point| point[1]).fold(f64::MAX, f64::min);
        assert_eq!((highest(&kept), lowest(&kept)), (highest(&points), lowest(&points)));
        let few = &points[..50];
        let kept = dots(few, Scale::covering(few.iter().map(|point| point[0])), y, 700);
        assert!(few.iter().all(|point| kept.contains(point)));
    }

    #[test]
    fn what_is_not_finite_is_left_out() {
        let points = [[0.0, 1.0], [1.0, f64::NAN], [2.0, 3.0], [f64::INFINITY, 1.0]];
        let x = Scale::exactly(0.0, 2.0);
        assert_eq!(line(&points, x, 10, 5.0), vec![vec![[0.0, 1.0], [2.0, 3.0]]]);
        assert!(dots(&points, x, x, 10).iter().flatten().all(|value| value.is_finite()));
    }

    #[test]
    fn means_of_a_straight_cloud_lie_on_its_line() {
        let points: Vec<[f64; 2]> = (0..1000).map(|n| [n as f64, 2.0 * n as f64 + 1.0]).collect();
        let means = means(&points, Scale::exactly(0.0, 999.0), 12);
        assert_eq!(means.len(), 12);
        assert!(means.iter().all(|mean| (mean[1] - 2.0 * mean[0] - 1.0).abs() < 1e-9));
    }
}
