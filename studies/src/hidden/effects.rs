//! Adds each kind of effect to body, suit or plate of a simulator, at a random place and direction.

use std::f64::consts::TAU;

use equipoise_core::body::{Segment, Side};
use equipoise_simulator::burden::{BodyChange, Burden, Point, Span, SuitFault};
use equipoise_simulator::person::Person;
use equipoise_simulator::plate_fault::PlateFault;
use equipoise_simulator::random::{Coloured, Random};
use equipoise_simulator::scene;
use nalgebra::{Vector2, Vector3};

use super::ladder::nominal;
use super::truth::{Hidden, Spans};

/// The hidden effects of one session.
#[derive(Debug, Clone, Default)]
pub struct Drawn {
    /// For the simulator.
    pub hidden: scene::Hidden,
    /// For the evaluator.
    pub effects: Vec<Hidden>,
    /// Whether the model runs without inertia.
    pub without_inertia: bool,
}

/// The session's circumstances: body and time spans.
#[derive(Debug, Clone, Copy)]
pub struct Circumstances<'a> {
    /// The body.
    pub person: &'a Person,
    /// The recording's parts.
    pub spans: &'a Spans,
    /// Its length, s.
    pub length_s: f64,
}

/// One of several.
pub fn pick<T: Copy>(random: &mut Random, choices: &[T]) -> T {
    choices[random.between(0.0, choices.len() as f64) as usize]
}

fn sign(random: &mut Random) -> f64 {
    if random.happens(0.5) { 1.0 } else { -1.0 }
}

fn direction(random: &mut Random) -> Vector2<f64> {
    let (sin, cos) = random.between(0.0, TAU).sin_cos();
    Vector2::new(cos, sin)
}

/// Side of an effect on a limb: left or right, mirrored.
fn side_of(random: &mut Random) -> (Side, f64) {
    if random.happens(0.5) { (Side::Left, 1.0) } else { (Side::Right, -1.0) }
}

fn of_side(side: Side, left: Segment) -> Segment {
    if side == Side::Left { left } else { left.mirrored() }
}

/// Adds an effect of a kind and a size to the simulator; returns its description for the evaluator.
pub fn put(
    kind: &str,
    size: f64,
    random: &mut Random,
    at: &Circumstances,
    span: Span,
    drawn: &mut Drawn,
) -> Truth {
    let mut drawn_truth = Truth { place: None, parameters: Vec::new(), description: String::new() };
    match kind.split_once(' ').map_or(kind, |(name, _)| name) {
        "hand_load" | "hand_contact" | "worn_mass" => {
            on_the_body(kind, size, random, at, span, drawn, &mut drawn_truth);
        }
        name if name.starts_with("suit") || name.starts_with("segment") => {
            in_the_suit(kind, size, random, span, drawn, &mut drawn_truth);
        }
        "inertia" => {
            drawn.without_inertia = true;
            drawn_truth.parameters.push(("share", 1.0));
        }
        "periodic_sway" | "unbalanced_parameters" => {
            of_the_body(kind, size, random, at, span, drawn, &mut drawn_truth);
        }
        "outside" => outside(kind, size, random, at, span, drawn, &mut drawn_truth),
        _ => in_the_plate(kind, size, random, span, drawn, &mut drawn_truth),
    }
    drawn_truth
}

/// Description of an effect for the evaluator.
#[derive(Debug, Clone)]
pub struct Truth {
    /// `hand` or `segment`, and which.
    pub place: Option<(&'static str, String)>,
    /// By the catalogue's names and in its units.
    pub parameters: Vec<(&'static str, f64)>,
    /// A description, where the name is insufficient.
    pub description: String,
}

impl Truth {
    fn on(&mut self, segment: Segment) {
        self.place = Some(("segment", segment.name().to_owned()));
    }
}

fn on_the_body(
    kind: &str,
    size: f64,
    random: &mut Random,
    at: &Circumstances,
    span: Span,
    drawn: &mut Drawn,
    drawn_truth: &mut Truth,
) {
    let mut jitter = |sigma: f64| Vector3::from_fn(|_, _| sigma * random.normal().clamp(-2.0, 2.0));
    let off_the_grip_m = jitter(0.015);
    let off_the_middle_m = jitter(0.02);
    let (side, outward) = side_of(random);
    let hand = |side: Side| {
        let k = usize::from(side == Side::Right);
        Point { segment: side.hand(), at_m: at.person.grip_m[k] + off_the_grip_m }
    };
    let (what, place) = kind.split_once(' ').unwrap_or((kind, ""));
    if what == "hand_contact" {
        let level = direction(random) * random.between(0.1, 0.35);
        let upwards = Vector3::new(level.x, level.y, 1.0);
        let force_n = upwards.normalize() * (nominal(kind) * size);
        let variation = Coloured::new(random, 0.12, 1.5, at.length_s);
        drawn.hidden.burdens.push((Burden::Push(hand(side), force_n, variation), span));
        drawn_truth.place = Some(("hand", side_name(side).to_owned()));
        drawn_truth.parameters.extend([("fx_n", force_n.x), ("fy_n", force_n.y), ("fz_n", force_n.z)]);
        return;
    }
    if what == "hand_load" {
        let mass_kg = nominal(kind) * size;
        let hands: &[Side] = match place {
            "right" => &[Side::Right],
            "left" => &[Side::Left],
            _ => &Side::BOTH,
        };
        for side in hands {
            let burden = Burden::Mass(hand(*side), mass_kg / hands.len() as f64);
            drawn.hidden.burdens.push((burden, span));
        }
        drawn_truth.place = Some(("hand", place.to_owned()));
        drawn_truth.parameters.push(("mass_kg", mass_kg));
        return;
    }
    let height_m = at.person.height_m;
    let (segment, at_m) = match place {
        "Pelvis" => {
            let around = direction(random) * (0.07 * height_m);
            (Segment::Pelvis, Vector3::new(around.x, around.y, 0.04))
        }
        "T8" => (Segment::T8, Vector3::new(-0.09 * height_m, 0.0, 0.02 * height_m)),
        "forearm" => (of_side(side, Segment::LeftForearm), Vector3::new(0.0, outward * 0.07 * height_m, 0.0)),
        _ => (of_side(side, Segment::LeftUpperLeg), Vector3::new(0.03, outward * 0.05, -0.11 * height_m)),
    };
    let mass_kg = nominal(kind) * size;
    let point = Point { segment, at_m: at_m + off_the_middle_m };
    drawn.hidden.burdens.push((Burden::Mass(point, mass_kg), span));
    drawn_truth.on(segment);
    drawn_truth.parameters.push(("mass_kg", mass_kg));
}

fn side_name(side: Side) -> &'static str {
    if side == Side::Left { "left" } else { "right" }
}

fn in_the_plate(
    kind: &str,
    size: f64,
    random: &mut Random,
    span: Span,
    drawn: &mut Drawn,
    drawn_truth: &mut Truth,
) {
    let along = direction(random);
    let amount = nominal(kind) * size;
    let signed = amount * sign(random);
    let (fault, parameters): (PlateFault, Vec<(&'static str, f64)>) = match kind {
        "plate_offset" => {
            let by_m = along * (1e-3 * amount);
            (PlateFault::Offset(by_m), vec![("dx_m", by_m.x), ("dy_m", by_m.y)])
        }
        "plate_yaw" => {
            let radians = signed.to_radians();
            (PlateFault::Yaw(radians), vec![("psi_rad", radians)])
        }
        "plate_gain" => {
            let more = Vector2::new(1.0, sign(random)) * (0.01 * signed);
            (PlateFault::Gain(more), vec![("kx", more.x), ("ky", more.y)])
        }
        "plate_crosstalk" => (PlateFault::Crosstalk(0.01 * signed), vec![("k", 0.01 * signed)]),
        "plate_height" => (PlateFault::Height(1e-3 * signed), vec![("dz_m", 1e-3 * signed)]),
        "force_gain" => (PlateFault::ForceGain(0.01 * signed), vec![("k", 0.01 * signed)]),
        "plate_drift linear" => {
            let m_per_s = along * (1e-3 / 60.0 * amount);
            (PlateFault::Drift(m_per_s), vec![("vx_m_per_s", m_per_s.x), ("vy_m_per_s", m_per_s.y)])
        }
        "plate_drift settling" => {
            let bound_m = along * (1e-3 * amount);
            let tau_s = random.between(25.0, 60.0);
            (
                PlateFault::SettlingDrift(bound_m, tau_s),
                vec![("ax_m", bound_m.x), ("ay_m", bound_m.y), ("tau_s", tau_s)],
            )
        }
        // A lower cutoff has a larger effect.
        _ => {
            let cutoff_hz = nominal(kind) / size;
            (PlateFault::LowPass(cutoff_hz), vec![("cutoff_hz", cutoff_hz)])
        }
    };
    drawn.hidden.plate.push((fault, span));
    drawn_truth.parameters.extend(parameters);
}

fn in_the_suit(
    kind: &str,
    size: f64,
    random: &mut Random,
    span: Span,
    drawn: &mut Drawn,
    drawn_truth: &mut Truth,
) {
    let amount = nominal(kind) * size;
    let signed = amount * sign(random);
    let (side, _) = side_of(random);
    if kind == "suit_lag" {
        drawn.hidden.suit_lag_s.push((1e-3 * signed, span));
        drawn_truth.parameters.push(("tau_s", 1e-3 * signed));
        return;
    }
    let fault = match kind {
        "suit_heading_drift" => {
            let rad_per_s = signed.to_radians() / 60.0;
            drawn_truth.parameters.push(("rate_rad_per_s", rad_per_s));
            SuitFault::HeadingDrift(rad_per_s)
        }
        "segment_heading T8" | "segment_heading arm" => {
            let trunk = kind.ends_with("T8");
            let arm = pick(random, &[Segment::LeftUpperArm, Segment::LeftForearm]);
            let segment = if trunk { Segment::T8 } else { of_side(side, arm) };
            // A forearm's heading has half the effect of an upper arm's.
            let is_forearm = [Segment::LeftForearm, Segment::RightForearm].contains(&segment);
            let radians = signed.to_radians() * if is_forearm { 2.0 } else { 1.0 };
            drawn_truth.on(segment);
            drawn_truth.parameters.push(("psi_rad", radians));
            SuitFault::Heading(segment, radians)
        }
        _ => {
            let trunk = kind.ends_with("T8");
            let limb = pick(random, &[Segment::LeftUpperLeg, Segment::LeftUpperArm]);
            let segment = if trunk { Segment::T8 } else { of_side(side, limb) };
            // A rotation about a limb's own axis has little effect; of the trunk, rotations about the vertical have the
            // least. An upper arm has less effect than a thigh.
            let (axis, factor) = match segment {
                Segment::LeftUpperArm | Segment::RightUpperArm => (Vector3::new(1.0, 0.2, 1.0), 1.5),
                _ => (Vector3::new(1.0, 1.0, 0.2), 1.0),
            };
            let axis = axis.map(|weight| weight * random.normal()).normalize();
            let radians = axis * (factor * amount.to_radians());
            drawn_truth.on(segment);
            drawn_truth.parameters.extend([
                ("rx_rad", radians.x),
                ("ry_rad", radians.y),
                ("rz_rad", radians.z),
            ]);
            SuitFault::Misalignment(segment, radians)
        }
    };
    drawn.hidden.suit.push((fault, span));
}

fn of_the_body(
    kind: &str,
    size: f64,
    random: &mut Random,
    at: &Circumstances,
    span: Span,
    drawn: &mut Drawn,
    drawn_truth: &mut Truth,
) {
    let mass_fraction = |segment: Segment| at.person.segment_mass_kg[segment.index()] / at.person.mass_kg;
    if kind == "periodic_sway" {
        let hertz = random.between(0.21, 0.33);
        let amplitude_m = 1e-3 * nominal(kind) * size;
        // For a mass at chest height, inertia adds `ω² z/g` to the effect of its weight.
        let inertia = (TAU * hertz).powi(2) * 0.72 * at.person.height_m / 9.81;
        let moves_m = amplitude_m / (mass_fraction(Segment::T8) * (1.0 + inertia));
        let breath = BodyChange::Breath(Segment::T8, Vector3::x() * moves_m, hertz);
        drawn.hidden.changes.push((breath, span));
        drawn_truth.parameters.extend([("hz", hertz), ("amplitude_m", amplitude_m)]);
        return;
    }
    let segment =
        pick(random, &[Segment::Pelvis, Segment::T8, Segment::LeftUpperLeg, Segment::RightUpperLeg]);
    let along = Vector3::from_fn(|_, _| random.normal()).normalize();
    let phi_m = along * (1e-3 * nominal(kind) * size);
    drawn.hidden.changes.push((BodyChange::Centre(segment, phi_m / mass_fraction(segment)), span));
    drawn_truth.on(segment);
    drawn_truth.parameters.extend([("dx_m", phi_m.x), ("dy_m", phi_m.y), ("dz_m", phi_m.z)]);
}

/// Effects outside the catalogue. "Detectable" means here: a column of the hidden physics, with its true shape (work
/// minus that of the clean twin, whitened by the program's own noise), reaches log odds of about 15 in half of the
/// sessions. The program does not have the true shape, so rung 1 is not easy; below it no detection is possible.
fn outside(
    kind: &str,
    size: f64,
    random: &mut Random,
    at: &Circumstances,
    span: Span,
    drawn: &mut Drawn,
    drawn_truth: &mut Truth,
) {
    let (side, _) = side_of(random);
    let height_m = at.person.height_m;
    match kind {
        "outside shoulder_blades" => {
            let by_m = Vector3::new(1.0, 0.4, 0.3).normalize() * (0.020 * size);
            drawn.hidden.changes.push((BodyChange::ShoulderBlades(by_m), span));
            drawn_truth.description =
                format!("shoulders translate by {:.0} mm in their joints with horizontal arms", 20.0 * size);
        }
        "outside spine_shape" => {
            let by_m = Vector3::new(0.9, 0.0, 0.4).normalize() * (0.015 * size * sign(random));
            drawn.hidden.changes.push((BodyChange::SpineShape(by_m), span));
            drawn_truth.description =
                format!("the trunk translates by {:.0} mm per radian of bend", 15.0 * size);
        }
        "outside magnetic_region" => {
            // Iron at a bench disturbs every sensor near it: all of an arm. A forearm alone has so little mass that 40°
            // of it are undetectable.
            let arm = [Segment::LeftForearm, Segment::LeftUpperArm, Segment::LeftHand];
            let aside = if side == Side::Left { 0.2 } else { -0.2 };
            let centre_m = Vector3::new(0.25, aside, 0.60 * height_m);
            let radians = 12.0_f64.to_radians() * size * sign(random);
            for segment in arm.map(|segment| of_side(side, segment)) {
                drawn.hidden.suit.push((SuitFault::MagneticRegion(segment, radians, centre_m, 0.35), span));
            }
            drawn_truth.on(of_side(side, Segment::LeftForearm));
            drawn_truth.description = format!(
                "heading error of the {} arm of up to {:.0}° in a region",
                side_name(side),
                radians.to_degrees()
            );
        }
        "outside tissue_slip" => {
            let segment = pick(random, &[Segment::T8, Segment::LeftUpperLeg, Segment::RightUpperLeg]);
            // The joint between two spine segments rotates little; the rotation of a thigh moves the whole body above
            // it.
            let nominal = if segment == Segment::T8 { 0.4 } else { 0.04 };
            let rate = nominal * size * sign(random);
            drawn.hidden.suit.push((SuitFault::Slip(segment, rate), span));
            drawn_truth.on(segment);
            drawn_truth.description =
                format!("sensor of {} slips by {rate:.2} of the joint's angle", segment.name());
        }
        "outside hysteresis" => {
            drawn.hidden.plate.push((PlateFault::Hysteresis(0.006 * size), span));
            drawn_truth.description =
                format!("hysteresis of the centre of pressure of {:.0} mm, as of an insole", 6.0 * size);
        }
        "outside load_cell" => {
            let cell_m = Vector2::new(0.20 * sign(random), 0.15 * sign(random));
            let more = 0.05 * size * sign(random);
            drawn.hidden.plate.push((PlateFault::LoadCell(more, cell_m), span));
            drawn_truth.description = format!("one load cell of four has a gain of {:.3}", 1.0 + more);
        }
        _ => {
            let point = Point { segment: Segment::T8, at_m: Vector3::new(-0.10, 0.0, 0.0) };
            let anchor_m = Vector3::new(-1.2, 0.3 * sign(random), height_m);
            let stiffness = 25.0 * size;
            drawn.hidden.burdens.push((Burden::Band(point, anchor_m, stiffness, 1.0), span));
            drawn_truth.on(Segment::T8);
            drawn_truth.description = format!("a band of {stiffness:.0} N/m from the trunk to a wall");
        }
    }
}
