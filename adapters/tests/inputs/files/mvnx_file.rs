//! Generates `.mvnx` files, versions 3 and 4, from a defined motion.

use std::fmt::Write;

use equipoise_adapters::capture::{MvnxCapture, MvnxError};
use equipoise_core::body::{JOINTS, SEGMENTS, Segment, Skeleton};
use equipoise_core::message::SuitSample;

type Quaternion = [f64; 4];

/// Style of a generated file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Style {
    pub(crate) version: u32,
    /// Segments in another order than MVN's, with a prop among them.
    pub(crate) shuffled: bool,
    pub(crate) rate_hz: f64,
}

pub(crate) const V3: Style = Style { version: 3, shuffled: false, rate_hz: 240.0 };
pub(crate) const V4: Style = Style { version: 4, ..V3 };

fn product([w, x, y, z]: Quaternion, [a, b, c, d]: Quaternion) -> Quaternion {
    [
        w * a - x * b - y * c - z * d,
        w * b + x * a + y * d - z * c,
        w * c - x * d + y * a + z * b,
        w * d + x * c - y * b + z * a,
    ]
}

fn turned(q: Quaternion, [x, y, z]: [f64; 3]) -> [f64; 3] {
    let [w, a, b, c] = q;
    let [_, x, y, z] = product(product(q, [0.0, x, y, z]), [w, -a, -b, -c]);
    [x, y, z]
}

/// A motion that rotates every segment differently.
pub(crate) fn orientation(segment: Segment, time_s: f64) -> Quaternion {
    let half = 0.3 * (time_s * 3.0 + segment.index() as f64).sin();
    let axis = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.6, 0.8]][segment.index() % 3];
    [half.cos(), half.sin() * axis[0], half.sin() * axis[1], half.sin() * axis[2]]
}

/// Positions of the segments in this motion, m.
pub(crate) fn positions(time_s: f64) -> [[f64; 3]; SEGMENTS] {
    let null = null_pose();
    let mut position_m = [[0.0; 3]; SEGMENTS];
    for segment in Segment::ALL {
        let own = segment.index();
        position_m[own] = match segment.parent() {
            None => [0.1 * time_s, -0.2, 0.95],
            Some(parent) => {
                let along = std::array::from_fn(|axis| null[own][axis] - null[parent.index()][axis]);
                let along = turned(orientation(parent, time_s), along);
                std::array::from_fn(|axis| position_m[parent.index()][axis] + along[axis])
            }
        };
    }
    position_m
}

pub(crate) fn null_pose() -> [[f64; 3]; SEGMENTS] {
    Skeleton::nominal(1.75).t_pose_m().map(|[x, y, z]| [x, y, z + 0.93])
}

/// Rotation of an arm's axes in version 3.
fn isb(segment: Segment, style: Style) -> Quaternion {
    use Segment::{LeftForearm, LeftHand, LeftUpperArm, RightForearm, RightHand, RightUpperArm};
    match (style.version, segment) {
        (3, RightUpperArm) => [0.5_f64.sqrt(), -(0.5_f64.sqrt()), 0.0, 0.0],
        (3, LeftUpperArm) => [0.5_f64.sqrt(), 0.5_f64.sqrt(), 0.0, 0.0],
        (3, RightForearm | RightHand) => [0.5, -0.5, 0.5, 0.5],
        (3, LeftForearm | LeftHand) => [0.5, 0.5, 0.5, -0.5],
        _ => [1.0, 0.0, 0.0, 0.0],
    }
}

/// The file's segments; `None` for a prop.
fn order(style: Style) -> Vec<Option<Segment>> {
    let mut order: Vec<_> = Segment::ALL.into_iter().map(Some).collect();
    if style.shuffled {
        order.reverse();
        order.insert(5, None);
    }
    order
}

fn numbers<const N: usize>(style: Style, of: impl Fn(Segment) -> [f64; N]) -> String {
    let parts = order(style).into_iter().map(|segment| segment.map_or([0.5; N], &of));
    parts.flatten().map(|number| format!("{number:.6} ")).collect::<String>().trim_end().to_owned()
}

fn label(segment: Option<Segment>) -> String {
    segment.map_or("Prop1".to_owned(), |segment| segment.name().replace("Forearm", "ForeArm"))
}

pub(crate) fn head(style: Style) -> String {
    let (rate, version) = (style.rate_hz, style.version);
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<!-- <!DOCTYPE mvnx> -->\n\
         <mvnx xmlns=\"http://www.xsens.com/mvn/mvnx\" version=\"{version}\">\n<comment>a &amp; b</comment>\n\
         <subject label=\"anon&#45;1 &lt;x&gt;\" frameRate=\"{rate}\" segmentCount=\"23\">\n<comment></comment>\n<segments>\n"
    );
    for (id, segment) in order(style).into_iter().enumerate() {
        let name = label(segment);
        let tag = if version == 3 { "pos_s" } else { "pos_b" };
        writeln!(text, "<segment label=\"{name}\" id=\"{}\"><points>", id + 1).unwrap();
        writeln!(text, "<point label=\"pOrigin\"><{tag}>0.000000 0.000000 0.000000</{tag}></point>").unwrap();
        writeln!(text, "<point label=\"pTip\"><{tag}>0.100000 0.020000 -0.030000</{tag}></point>").unwrap();
        writeln!(text, "</points></segment>").unwrap();
    }
    text += "</segments>\n<sensors><sensor label=\"Pelvis\"/></sensors>\n<joints>\n";
    let mut joints: Vec<_> = Segment::ALL.into_iter().filter(|segment| segment.parent().is_some()).collect();
    if style.shuffled {
        joints.reverse();
    }
    for child in joints {
        let (parent, child) = (label(child.parent()), label(Some(child)));
        writeln!(text, "<joint label=\"j{child}\"><connector1>{parent}/j</connector1>").unwrap();
        writeln!(text, "<connector2>{child}/j</connector2></joint>").unwrap();
    }
    text + "</joints>\n<frames segmentCount=\"23\" sensorCount=\"1\" jointCount=\"22\">\n"
}

/// The calibration pose that defines the axes, and one that does not.
pub(crate) fn calibration(style: Style) -> String {
    let kind = if style.version == 3 { "npose" } else { "identity" };
    let turn = numbers(style, |segment| isb(segment, style));
    let null = null_pose();
    let place = numbers(style, |segment| null[segment.index()]);
    let mut text = String::new();
    for kind in [kind, "tpose"] {
        writeln!(text, "<frame time=\"0\" index=\"-2\" tc=\"00:00:00:00\" ms=\"0\" type=\"{kind}\">")
            .unwrap();
        writeln!(text, "<orientation>{turn}</orientation><position>{place}</position></frame>").unwrap();
    }
    text
}

/// First wall-clock time of the generated files, ms since 1970.
pub(crate) const UNIX_MS: u64 = 1_700_000_000_123;

pub(crate) fn frame(style: Style, index: u64) -> String {
    let time_s = index as f64 / style.rate_hz;
    let ms = (time_s * 1e3).round() as u64;
    let turn = numbers(style, |segment| product(orientation(segment, time_s), isb(segment, style)));
    let place = positions(time_s);
    let place = numbers(style, |segment| place[segment.index()]);
    // Numbers that identify their source.
    let three = |base: f64| numbers(style, |segment| [base, segment.index() as f64, time_s]);
    let mut angles: Vec<String> = (0..JOINTS).map(|joint| format!("{joint} 2.5 {time_s:.6}")).collect();
    if style.shuffled {
        angles.reverse();
    }
    let unix_ms = UNIX_MS + ms;
    format!(
        "<frame time=\"{ms}\" index=\"{index}\" tc=\"22:13:20:{index}\" ms=\"{unix_ms}\" type=\"normal\">\n\
         <orientation>{turn}</orientation>\n<position>{place}</position>\n<velocity>{}</velocity>\n\
         <acceleration>{}</acceleration>\n<angularVelocity>{}</angularVelocity>\n<footContacts>1 1 1 1</footContacts>\n\
         <jointAngle>{}</jointAngle>\n<centerOfMass>0.1 0.2 0.9</centerOfMass>\n</frame>\n",
        three(1.0),
        three(2.0),
        three(3.0),
        angles.join(" ")
    )
}

pub(crate) const TAIL: &str = "</frames>\n</subject>\n<securityCode code=\"0\"/>\n</mvnx>\n";

pub(crate) fn file(style: Style, frames: u64) -> String {
    let frames: String = (0..frames).map(|index| frame(style, index)).collect();
    head(style) + &calibration(style) + &frames + TAIL
}

pub(crate) fn read(text: &str) -> (Vec<SuitSample>, String, Option<MvnxError>) {
    let mut capture = MvnxCapture::new(text.as_bytes()).unwrap();
    let samples = capture.by_ref().collect();
    (samples, capture.rejected().to_string(), capture.fault().cloned())
}

pub(crate) fn refusal(text: &str) -> MvnxError {
    MvnxCapture::new(text.as_bytes()).unwrap_err()
}
