use super::*;
use crate::body::Sex;
use crate::sesc::ReductionKind;
use crate::sesc::suit_error::effective_vectors;

extern crate std;
use std::boxed::Box;
use std::vec::Vec;

const KINDS: [ReductionKind; 3] = [ReductionKind::Full, ReductionKind::Merged, ReductionKind::Symmetric];

#[test]
fn a_heavier_segment_moves_phi_along_its_direction() {
    let skeleton = Skeleton::nominal(1.77);
    let body = Anthropometry::de_leva(&skeleton, 1.77, Sex::Male);
    let phi = Phi::of(&skeleton, &body);
    let more = 1e-6;
    for segment in [Segment::Pelvis, Segment::Head, Segment::LeftForearm, Segment::RightToe] {
        let mut heavier = body;
        heavier.mass_fraction[segment.index()] += more;
        heavier.mass_fraction = heavier.mass_fraction.map(|fraction| fraction / (1.0 + more));
        let moved = Phi::of(&skeleton, &heavier);
        for (raw, slope) in mass_direction(segment, &skeleton, &body, &phi).into_iter().enumerate() {
            let difference = (moved.0[raw / 3][raw % 3] - phi.0[raw / 3][raw % 3]) / more;
            assert!((difference - slope).abs() < 1e-5, "{segment:?} {raw}: {difference} {slope}");
        }
    }
}

#[test]
fn the_covariance_is_symmetric_and_positive_on_its_diagonal() {
    let skeleton = Skeleton::nominal(1.77);
    let body = Anthropometry::de_leva(&skeleton, 1.77, Sex::Male);
    let phi = Phi::of(&skeleton, &body);
    for kind in KINDS {
        let reduction = Reduction::new(kind, &phi);
        let prior = Prior::table(&reduction, &skeleton, &body);
        for row in 0..reduction.count() {
            assert!(prior.covariance_m2[row][row] > 0.0);
            for column in 0..row {
                assert_eq!(prior.covariance_m2[row][column], prior.covariance_m2[column][row]);
            }
        }
    }
}

/// Normal deviates from a seed (xorshift and Box–Muller), so that the tests need no crate.
struct Normal(u64);

impl Normal {
    fn unit(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        ((self.0 >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    fn next(&mut self) -> f64 {
        let (radius, angle) = ((-2.0 * self.unit().ln()).sqrt(), core::f64::consts::TAU * self.unit());
        radius * angle.cos()
    }
}

/// One person drawn part by part from the population that the table's spread describes.
fn draw(body: &Anthropometry, normal: &mut Normal) -> Anthropometry {
    let mut person = *body;
    for (segments, spread) in PARTS {
        let shared = normal.next();
        let is_paired = segments.iter().all(|segment| !segments.contains(&segment.mirrored()));
        for mirrored in [false, true].into_iter().take(if is_paired { 2 } else { 1 }) {
            let own = normal.next();
            let deviation = if is_paired {
                SIDE_CORRELATION.sqrt() * shared + (1.0 - SIDE_CORRELATION).sqrt() * own
            } else {
                shared
            };
            for segment in segments {
                let segment = if mirrored { segment.mirrored() } else { *segment };
                person.mass_fraction[segment.index()] *= 1.0 + SPREAD_FACTOR * spread * deviation;
            }
        }
    }
    let sum: f64 = person.mass_fraction.iter().sum();
    person.mass_fraction = person.mass_fraction.map(|fraction| fraction / sum);
    for segment in Segment::ALL.into_iter().filter(|segment| *segment <= segment.mirrored()) {
        let spreads_m =
            if segment <= Segment::Head { TRUNK_CENTRE_SPREAD_M } else { [LIMB_CENTRE_SPREAD_M; 3] };
        for (axis, spread_m) in spreads_m.into_iter().enumerate() {
            if segment == segment.mirrored() {
                person.com_m[segment.index()][axis] += spread_m * normal.next();
                continue;
            }
            let shared = normal.next();
            for (of, sign) in [(segment, 1.0), (segment.mirrored(), if axis == 1 { -1.0 } else { 1.0 })] {
                let deviation =
                    SIDE_CORRELATION.sqrt() * shared + (1.0 - SIDE_CORRELATION).sqrt() * normal.next();
                person.com_m[of.index()][axis] += sign * spread_m * deviation;
            }
        }
    }
    person
}

#[test]
fn the_covariance_is_that_of_a_drawn_population() {
    const PEOPLE: usize = 60_000;
    let skeleton = Skeleton::nominal(1.77);
    let body = Anthropometry::de_leva(&skeleton, 1.77, Sex::Male);
    let reduction = Reduction::new(ReductionKind::Full, &Phi::of(&skeleton, &body));
    let prior = Box::new(Prior::table(&reduction, &skeleton, &body));
    let mut normal = Normal(20_201);
    let mut people: Vec<[f64; PARAMETERS]> = Vec::new();
    for _ in 0..PEOPLE {
        let mut theta = reduction.closest_theta(&Phi::of(&skeleton, &draw(&body, &mut normal)));
        // The sideways spread belongs to the plate and not to the body.
        theta[3 * Segment::Pelvis.index() + 1] += SIDEWAYS_SPREAD_M * normal.next();
        for (value, mean) in theta.iter_mut().zip(prior.theta_m) {
            *value -= mean;
        }
        people.push(theta);
    }
    let mut worst: f64 = 0.0;
    for row in 0..PARAMETERS {
        let mean = people.iter().map(|person| person[row]).sum::<f64>() / PEOPLE as f64;
        let sigma = prior.covariance_m2[row][row].sqrt();
        // Mass fractions are nonlinear in the masses: the mean may deviate by a few per cent of a standard deviation.
        assert!(mean.abs() < 0.1 * sigma, "{row}: {mean} {sigma}");
        for column in 0..=row {
            let sampled =
                people.iter().map(|person| person[row] * person[column]).sum::<f64>() / PEOPLE as f64;
            let scale = (prior.covariance_m2[row][row] * prior.covariance_m2[column][column]).sqrt();
            worst = worst.max((prior.covariance_m2[row][column] - sampled).abs() / scale);
        }
    }
    // Sampling contributes 0.006 on a diagonal, a few times that in the worst of 2415 entries, and the squares of the
    // spreads, which the first order neglects, as much again.
    assert!(worst < 0.06, "{worst}");
}

#[test]
fn both_sides_of_a_person_are_alike_in_the_prior() {
    let skeleton = Skeleton::nominal(1.77);
    let body = Anthropometry::de_leva(&skeleton, 1.77, Sex::Male);
    let reduction = Reduction::new(ReductionKind::Full, &Phi::of(&skeleton, &body));
    let prior = Prior::table(&reduction, &skeleton, &body);
    let at = |segment: Segment, axis: usize| 3 * segment.index() + axis;
    let (left, right) = (at(Segment::LeftUpperLeg, 2), at(Segment::RightUpperLeg, 2));
    let p = &prior.covariance_m2;
    let correlation = p[left][right] / (p[left][left] * p[right][right]).sqrt();
    assert!((0.9..1.0).contains(&correlation), "{correlation}");
    let (left, right) = (at(Segment::LeftUpperArm, 1), at(Segment::RightUpperArm, 1));
    assert!(p[left][right] < 0.0, "mirrored across the body");
}

#[test]
fn the_table_itself_breaks_no_constraint_and_a_hard_reduction_leaves_none_of_symmetry() {
    let skeleton = Skeleton::nominal(1.77);
    let body = Anthropometry::de_leva(&skeleton, 1.77, Sex::Male);
    let phi = Phi::of(&skeleton, &body);
    for kind in KINDS {
        let reduction = Reduction::new(kind, &phi);
        let theta = reduction.closest_theta(&phi);
        let mut constraints = 0;
        for constraint in soft_constraints(&reduction, 0.005, 0.007) {
            let reported: f64 = constraint.h.iter().zip(&theta).map(|(h, theta)| h * theta).sum();
            assert!(
                (reported - constraint.value_m).abs() < 0.001,
                "{kind:?}: {reported} {}",
                constraint.value_m
            );
            if kind == ReductionKind::Symmetric {
                assert_eq!(constraint.sigma_m, 0.007, "symmetry is already exact");
            }
            constraints += 1;
        }
        // Eight pairs on three axes; six limb segments across, seventh and eighth on one axis, on both sides.
        let expected = match kind {
            ReductionKind::Full => 8 * 3 + 2 * (5 * 2 + 2),
            // Both shoulders are part of the thorax.
            ReductionKind::Merged => 7 * 3 + 2 * (5 * 2 + 2),
            ReductionKind::Symmetric => 2,
        };
        assert_eq!(constraints, expected, "{kind:?}");
    }
}

#[test]
fn a_similar_worker_moves_the_mean_and_narrows_the_covariance() {
    let skeleton = Skeleton::nominal(1.77);
    let body = Anthropometry::de_leva(&skeleton, 1.77, Sex::Male);
    let phi = Phi::of(&skeleton, &body);
    for kind in KINDS {
        let reduction = Reduction::new(kind, &phi);
        let table = Box::new(Prior::table(&reduction, &skeleton, &body));
        // The other subject was identified with the same reduction: a deviation T δ, with a σ of 1 mm on each
        // parameter.
        let mut delta = [0.0; PARAMETERS];
        delta[0] = 0.02;
        delta[reduction.count() - 1] = -0.01;
        let moved = reduction
            .phi(&core::array::from_fn::<f64, PARAMETERS, _>(|index| table.theta_m[index] + delta[index]));
        let there = reduction.phi(&table.theta_m);
        let variance = reduction.raw_variance(|_| 1e-6);
        let similar = |likeness| {
            let deviation_m =
                core::array::from_fn(|raw| moved.0[raw / 3][raw % 3] - there.0[raw / 3][raw % 3]);
            table.similar(&reduction, &Similar { deviation_m, variance_m2: variance, likeness })
        };
        for (index, delta) in delta[..reduction.count()].iter().enumerate() {
            let (unlike, alike, similar_in_part) = (similar(0.0), similar(1.0), similar(0.6));
            let before = table.covariance_m2[index][index];
            assert_eq!(
                (unlike.theta_m[index], unlike.covariance_m2[index]),
                (table.theta_m[index], table.covariance_m2[index])
            );
            assert!((alike.theta_m[index] - table.theta_m[index] - delta).abs() < 1e-12);
            assert!((alike.covariance_m2[index][index] - 1e-6).abs() < 1e-15, "{kind:?} {index}");
            assert!((similar_in_part.theta_m[index] - table.theta_m[index] - 0.6 * delta).abs() < 1e-12);
            assert!((similar_in_part.covariance_m2[index][index] - 0.64 * before - 0.36e-6).abs() < 1e-15);
        }
    }
}

#[test]
fn misalignments_add_up_to_the_covariance_of_each_segment_s_rotation() {
    let skeleton = Skeleton::nominal(1.77);
    let phi = Phi::of(&skeleton, &Anthropometry::de_leva(&skeleton, 1.77, Sex::Male));
    let reduction = Reduction::new(ReductionKind::Full, &phi);
    let psi = effective_vectors(&phi, &skeleton, true);
    let directions: Vec<_> = misalignments_m(&reduction, &psi, 0.01).collect();
    assert_eq!(directions.len(), PARAMETERS);
    for segment in Segment::ALL {
        let at = 3 * segment.index();
        let trace: f64 =
            (at..at + 3).map(|raw| directions.iter().map(|along| along[raw] * along[raw]).sum::<f64>()).sum();
        let square: f64 = psi.0[segment.index()].iter().map(|value| value * value).sum();
        // |ψ|² I − ψ ψᵀ has the trace 2 |ψ|².
        assert!((trace - 2e-4 * square).abs() < 1e-15);
    }
}
