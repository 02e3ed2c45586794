//! A C3D file: joint centres, centre of mass, centre of pressure, overload torques, and the ground reaction as a force
//! platform.
//!
//! Lengths in mm and moments in N mm in the station's world (X forward, Y left, Z up), as usual in C3D files. Torques are
//! points named in `POINT:MOMENTS`, their 1-σ analog channels.
//!
//! The platform (`FORCE_PLATFORM:TYPE` 2) has its origin at the world's origin on the walking surface, x forward, y to the
//! right, z down. Its channels are the reaction on the person about that origin, so that readers which rotate them into the
//! world obtain an upward force, as from files of camera systems. `FORCE_PLATFORM:CORNERS` are a nominal square.

mod encoder;

use std::io::{BufWriter, Write};
use std::path::Path;

use anyhow::Context;
use equipoise_core::body::{JOINTS, Joint, Segment};

use crate::motion::Motion;
use crate::motion::frame::Frame;
use crate::opensim::{Report, point_name};
use crate::part::Part;
use crate::{Progress, Written};
use encoder::{FRAMES_MAX, Group, SCALE, Sizes, Value, write_head, write_point, write_sample};

/// Millimetres per metre, newton millimetres per newton metre.
const MILLI: f64 = 1000.0;
/// Half the side of the nominal platform, mm.
const HALF_SIDE_MM: f32 = 300.0;
/// Points after the joint centres.
const CENTRES: [&str; 2] = ["CentreOfMass", "CentreOfPressure"];
/// Channels of the platform with their units.
const PLATFORM: [(&str, &str); 6] =
    [("Fx", "N"), ("Fy", "N"), ("Fz", "N"), ("Mx", "Nmm"), ("My", "Nmm"), ("Mz", "Nmm")];

/// Writes the file.
///
/// # Errors
/// The file cannot be written.
pub(crate) fn write(
    motion: &Motion<'_>,
    subjects: &[String],
    out: &Path,
    progress: &mut Progress<'_>,
) -> anyhow::Result<Report> {
    let part = Part::next_to(out)?;
    let mut file = BufWriter::new(part.file()?);
    let sizes = Sizes {
        points: Segment::ALL.len() + CENTRES.len() + JOINTS,
        channels: PLATFORM.len() + JOINTS,
        frames: motion.grid.frames,
        rate_hz: motion.grid.rate_hz as f32,
    };
    let begin_s = motion.time_s(motion.grid.start_ns);
    let groups = |first_data_block| {
        let mut groups = vec![point_group(sizes, first_data_block), analog_group(sizes)];
        groups.extend([platform_group(motion.surface_z_m()), trial_group(sizes), own_group(begin_s)]);
        groups.extend((!subjects.is_empty()).then(|| subject_group(subjects)));
        groups
    };
    let unwritten = "cannot write the file";
    write_head(&mut file, sizes, groups).context(unwritten)?;
    progress.begin("writing");
    let [mut forces, mut torques] = [0; 2];
    motion.frames(progress, &mut |_, frame| {
        forces += usize::from(frame.has_force());
        torques += usize::from(frame.has_torques());
        write_frame(&mut file, frame).context(unwritten)
    })?;
    file.flush().context(unwritten)?;
    part.take_place(out)?;
    let (rows, columns) = (sizes.frames as u64, sizes.points + sizes.channels);
    let note = format!("of {rows} frames {forces} have a valid ground reaction, {torques} valid torques");
    Ok(Report { files: vec![Written { path: out.to_owned(), rows, columns }], notes: vec![note] })
}

fn write_frame(out: &mut impl Write, frame: &Frame) -> std::io::Result<()> {
    let points = frame.origin_m.iter().chain([&frame.com_m, &frame.cop_m]).chain(&frame.torque_nm);
    for point in points {
        write_point(out, point.map(|value| MILLI * value))?;
    }
    let platform = in_platform(frame.force_n).into_iter();
    let moments = in_platform(frame.moment_nm()).map(|moment_nm| MILLI * moment_nm);
    for sample in platform.chain(moments).chain(frame.torque_sigma_nm.map(|sigma_nm| MILLI * sigma_nm)) {
        write_sample(out, sample)?;
    }
    Ok(())
}

/// A vector of the world in the axes of the platform: x forward, y to the right, z down.
fn in_platform([x, y, z]: [f64; 3]) -> [f64; 3] {
    [x, -y, -z]
}

fn moment_names() -> Vec<String> {
    Joint::ALL.map(|joint| format!("{}OverloadMoment", joint.name())).into()
}

fn point_group(sizes: Sizes, first_data_block: i16) -> Group {
    let centres = Segment::ALL.map(point_name).into_iter().chain(CENTRES).map(str::to_owned);
    let labels: Vec<String> = centres.chain(moment_names()).collect();
    let centre = |segment: Segment| format!("proximal joint centre of {}", segment.name());
    let descriptions = Segment::ALL.map(centre).into_iter().chain([
        "estimated centre of mass of the unloaded body".to_owned(),
        "measured centre of pressure".to_owned(),
    ]);
    let torque = |joint: Joint| format!("effect of the load on {}, world axes", joint.name());
    let mut parameters = vec![
        ("USED", Value::Integer(sizes.points as i16)),
        ("SCALE", Value::Real(SCALE)),
        ("RATE", Value::Real(sizes.rate_hz)),
        ("DATA_START", Value::Integer(first_data_block)),
        // Unsigned; readers take a larger count from LONG_FRAMES or TRIAL.
        ("FRAMES", Value::Integer((sizes.frames.min(FRAMES_MAX) as u16).cast_signed())),
        ("LABELS", Value::Texts(labels)),
        ("DESCRIPTIONS", Value::Texts(descriptions.chain(Joint::ALL.map(torque)).collect())),
        ("UNITS", Value::Text("mm".to_owned())),
        ("MOMENTS", Value::Texts(moment_names())),
        ("MOMENT_UNITS", Value::Text("Nmm".to_owned())),
    ];
    if sizes.frames >= FRAMES_MAX {
        parameters.push(("LONG_FRAMES", Value::Real(sizes.frames as f32)));
    }
    Group { name: "POINT", description: "Points, and moments as points", parameters }
}

fn analog_group(sizes: Sizes) -> Group {
    let sigma = Joint::ALL.map(|joint| (format!("{}OverloadSigma", joint.name()), "Nmm".to_owned()));
    let platform = PLATFORM.map(|(name, unit)| (name.to_owned(), unit.to_owned()));
    let (labels, units): (Vec<_>, Vec<_>) = platform.into_iter().chain(sigma).unzip();
    let descriptions = PLATFORM.map(|_| "reaction on the person, axes of the platform".to_owned());
    let descriptions = descriptions.into_iter().chain(Joint::ALL.map(|_| "1-sigma of the moment".to_owned()));
    let count = sizes.channels as u8;
    let parameters = vec![
        ("USED", Value::Integer(sizes.channels as i16)),
        ("LABELS", Value::Texts(labels)),
        ("DESCRIPTIONS", Value::Texts(descriptions.collect())),
        ("GEN_SCALE", Value::Real(1.0)),
        ("OFFSET", Value::Integers(vec![0; sizes.channels], vec![count])),
        ("SCALE", Value::Reals(vec![1.0; sizes.channels], vec![count])),
        ("UNITS", Value::Texts(units)),
        ("RATE", Value::Real(sizes.rate_hz)),
    ];
    Group { name: "ANALOG", description: "Ground reaction, and 1-sigma of each moment", parameters }
}

/// Without a plate (`surface_z_m` is NaN) no platform is in use.
fn platform_group(surface_z_m: f64) -> Group {
    let used = surface_z_m.is_finite();
    let surface_mm = if used { (MILLI * surface_z_m) as f32 } else { 0.0 };
    // Quadrants of the platform's axes: +x +y, -x +y, -x -y, +x -y, in the world.
    let quadrants = [[1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]];
    let corners = quadrants.map(|[x, y]: [f32; 2]| [x * HALF_SIDE_MM, y * HALF_SIDE_MM, surface_mm]);
    let parameters = vec![
        ("USED", Value::Integer(i16::from(used))),
        ("TYPE", Value::Integers(vec![2], vec![1])),
        ("ZERO", Value::Integers(vec![0, 0], vec![2])),
        ("CORNERS", Value::Reals(corners.concat(), vec![3, 4, 1])),
        ("ORIGIN", Value::Reals(vec![0.0; 3], vec![3, 1])),
        ("CHANNEL", Value::Integers((1..=6).collect(), vec![6, 1])),
    ];
    Group {
        name: "FORCE_PLATFORM",
        description: "Reaction on the person about the world's origin; nominal corners",
        parameters,
    }
}

/// First and last frame as pairs of 16-bit words, for programs that do not read larger counts elsewhere.
fn trial_group(sizes: Sizes) -> Group {
    let words = |frame: usize| vec![(frame as u16).cast_signed(), ((frame >> 16) as u16).cast_signed()];
    let parameters = vec![
        ("ACTUAL_START_FIELD", Value::Integers(words(1), vec![2])),
        ("ACTUAL_END_FIELD", Value::Integers(words(sizes.frames), vec![2])),
        ("CAMERA_RATE", Value::Real(sizes.rate_hz)),
    ];
    Group { name: "TRIAL", description: "Frames", parameters }
}

fn subject_group(subjects: &[String]) -> Group {
    let used = Value::Integer(subjects.len() as i16);
    let parameters = vec![("USED", used), ("NAMES", Value::Texts(subjects.to_vec()))];
    Group { name: "SUBJECTS", description: "Pseudonyms", parameters }
}

fn own_group(begin_s: f64) -> Group {
    let parameters = vec![
        ("VERSION", Value::Text(env!("CARGO_PKG_VERSION").to_owned())),
        ("BEGIN_S", Value::Real(begin_s as f32)),
    ];
    Group { name: "EQUIPOISE", description: "Release; time of frame 1 in the recording, s", parameters }
}
