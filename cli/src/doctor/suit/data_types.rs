//! Check boxes of MVN's Network Streamer, one for each type of datagram.

use equipoise_adapters::suit::survey::{Character, TypeCounts};
use equipoise_adapters::wire::mvn::DatagramType;

use super::super::Check;

/// The required box.
pub(super) const POSE: &str = "Position + Orientation (Quaternion)";

/// One check box.
pub(super) struct DataType {
    pub(super) kind: DatagramType,
    /// Title of its check.
    pub(super) title: &'static str,
    /// Label in MVN.
    pub(super) label: &'static str,
    use_: Use,
}

/// Use of a datagram type.
enum Use {
    /// Required.
    Needed,
    /// Substitute for the pose, less accurate.
    Substitute,
    /// Improves a result.
    Better(&'static str),
    /// Displayed or recorded without effect on results.
    Shown(&'static str),
    /// Not used.
    Unused,
}

/// All boxes in the order of the report.
pub(super) const DATA_TYPES: [DataType; 12] = {
    use DatagramType as T;
    use Use::{Better, Needed, Shown, Substitute, Unused};
    const fn one(kind: T, title: &'static str, label: &'static str, use_: Use) -> DataType {
        DataType { kind, title, label, use_ }
    }
    [
        one(T::POSE_QUATERNION, "02 pose quaternion", POSE, Needed),
        one(
            T::SCALE,
            "13 scaling",
            "Avatar Scaling data",
            Better("the body's bones are known at once, instead of from its first poses"),
        ),
        one(
            T::LINEAR_KINEMATICS,
            "21 linear kinematics",
            "Linear Segment Kinematics",
            Better("the suit's own accelerations, which improve estimates in fast motion"),
        ),
        one(
            T::ANGULAR_KINEMATICS,
            "22 angular kinematics",
            "Angular Segment Kinematics",
            Shown("the suit's own angular velocities, kept in recordings"),
        ),
        one(
            T::CENTRE_OF_MASS,
            "24 centre of mass",
            "Center of Mass",
            Shown("MVN's own centre of mass, to compare"),
        ),
        one(
            T::JOINT_ANGLES,
            "20 joint angles",
            "Joint Angles",
            Shown("MVN's joint angles, kept in recordings"),
        ),
        one(T::META, "12 meta data", "Avatar Meta Data", Shown("the character's name, shown here")),
        one(T::POSE_EULER, "01 pose Euler", "Position + Orientation (Euler)", Substitute),
        one(T::UNITY, "05 Unity 3D", "Unity 3D", Substitute),
        one(T::VIRTUAL_MARKERS, "03 virtual markers", "Virtual Optical Marker Set", Unused),
        one(T::TRACKER_KINEMATICS, "23 motion trackers", "Motion Tracker Kinematics", Unused),
        one(T::TIME_CODE, "25 time code", "Time Code", Unused),
    ]
};

/// Reports which boxes are ticked, which are required, and which are unnecessary.
pub(super) fn evaluate(character: &Character, seconds: f64) -> Vec<Check> {
    let mut checks: Vec<Check> = DATA_TYPES
        .iter()
        .filter_map(|one| one.evaluate(character, character.of(one.kind), seconds))
        .collect();
    let is_listed = |kind: &DatagramType| DATA_TYPES.iter().any(|one| one.kind == *kind);
    let unknown: Vec<String> =
        character.types.keys().filter(|kind| !is_listed(kind)).map(ToString::to_string).collect();
    if !unknown.is_empty() {
        let found = format!("{}: not known here, and not used", unknown.join(", "));
        checks.push(Check { fix: Some("may be unticked".to_owned()), ..Check::ok("other types", found) });
    }
    checks
}

impl DataType {
    fn evaluate(&self, character: &Character, stream: Option<&TypeCounts>, seconds: f64) -> Option<Check> {
        let DataType { title, label, .. } = *self;
        let has_quaternions = character.of(DatagramType::POSE_QUATERNION).is_some();
        let tick = |reason: &str| format!("tick the box \"{label}\"{reason}");
        let with_fix = |check: Check, fix: String| Check { fix: Some(fix), ..check };
        Some(match (&self.use_, stream) {
            (Use::Needed, Some(stream)) => {
                Check::ok(title, format!("{}: needed, and there", self.amount(character, stream)))
            }
            (Use::Needed, None) if character.pose().is_none() => {
                Check::fail(title, "not sent: no pose comes at all", tick(": nothing works without"))
            }
            (Use::Needed, None) => {
                Check::warn(title, "not sent: another type stands in", tick(": it is the most exact"))
            }
            (Use::Substitute, Some(stream)) if has_quaternions => {
                self.superfluous(stream, "not used together with 02", seconds)
            }
            (Use::Substitute, Some(_))
                if character.of(DatagramType::POSE_EULER).is_some() && self.kind == DatagramType::UNITY =>
            {
                Check::ok(title, "sent; not used together with 01")
            }
            (Use::Substitute, Some(stream)) => {
                Check::ok(title, format!("{}: stands in for 02", self.amount(character, stream)))
            }
            (Use::Better(reason) | Use::Shown(reason), Some(stream)) => {
                Check::ok(title, format!("{}: {reason}", self.amount(character, stream)))
            }
            (Use::Better(reason), None) => Check::warn(title, "not sent", tick(&format!(": {reason}"))),
            (Use::Shown(reason), None) => {
                with_fix(Check::ok(title, "not sent"), tick(&format!(" if wanted: {reason}")))
            }
            (Use::Unused, Some(stream)) => self.superfluous(stream, "not used", seconds),
            (Use::Substitute | Use::Unused, None) => return None,
        })
    }

    fn superfluous(&self, stream: &TypeCounts, reason: &str, seconds: f64) -> Check {
        let found = format!("sent, {:.0} kB/s; {reason}", stream.bytes as f64 / seconds / 1e3);
        Check {
            fix: Some(format!("the box \"{}\" may be unticked", self.label)),
            ..Check::ok(self.title, found)
        }
    }

    /// Observed amount of data.
    fn amount(&self, character: &Character, stream: &TypeCounts) -> String {
        match self.kind {
            DatagramType::SCALE => {
                let (segments, points) = character.null_pose();
                format!("{} and {points} points", if segments { "23 segments" } else { "no segments yet" })
            }
            DatagramType::META => character.name().map_or("no name".to_owned(), |name| format!("\"{name}\"")),
            _ => format!("{:.1} a second", stream.rate_hz()),
        }
    }
}
