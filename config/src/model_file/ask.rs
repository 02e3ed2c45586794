//! `[ask]`: the experiment that would discriminate between explanations of the file's recording.

use std::fmt::Write as _;

use equipoise_core::cycle::{POSE_REQUESTS_MAX, PoseRequest};
use equipoise_core::pose_suggestion::library::LIBRARY;

use serde::{Deserialize, Deserializer, Serialize};

use super::limits::{ASK_MAX, NAME_MAX};
use super::text;

/// An experiment that separates explanations: poses, a step, standing, or fast motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ask {
    /// The two most probable explanations, by name with place.
    pub between: [String; 2],
    /// Names of the poses of the core's library to hold, one after the other, at most [`POSE_REQUESTS_MAX`]; empty for a
    /// step, standing or a motion. Also accepted: one name.
    #[serde(
        default,
        alias = "pose",
        deserialize_with = "one_or_many",
        skip_serializing_if = "Vec::is_empty"
    )]
    pub poses: Vec<String>,
    /// Rotation of the body before, degrees to the left.
    #[serde(default)]
    pub turn_deg: f64,
    /// Displacement of the stance before: forward and to the left, m.
    #[serde(default)]
    pub step_m: [f64; 2],
    /// Duration of static standing, s; 0: as long as a pose takes.
    #[serde(default)]
    pub still_s: f64,
    /// Whether fast motion is requested.
    #[serde(default)]
    pub fast: bool,
    /// Difference of the two predictions, 1-σ of the noise.
    pub separation_sigma: f64,
    /// Expected decrease of the entropy of the names' probabilities, nats.
    #[serde(default)]
    pub information_nats: f64,
    /// Probability that one explanation is certain afterwards, in [0, 1].
    #[serde(default)]
    pub decides: f64,
}

/// A list of names, or one name.
fn one_or_many<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<String>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged, expecting = "a name or a list of names")]
    enum Names {
        One(String),
        Many(Vec<String>),
    }
    Ok(match Names::deserialize(deserializer)? {
        Names::One(name) => vec![name],
        Names::Many(names) => names,
    })
}

impl Ask {
    /// The sentence of `ask_next` in the finding.
    pub fn sentence(&self) -> String {
        let [one, other] = &self.between;
        let what = self.what();
        format!(
            "{what}: {one} and {other} then differ by {:.1} σ; decides with {:.0} %",
            self.separation_sigma,
            100.0 * self.decides
        )
    }

    /// The instruction for the worker on the plate.
    pub fn what(&self) -> String {
        if self.fast {
            return "squat quickly and stop, a few times".to_owned();
        }
        if self.still_s > 0.0 {
            return format!("stand still for {:.0} minutes", self.still_s / 60.0);
        }
        if let [forward_m, left_m] = self.step_m
            && (forward_m, left_m) != (0.0, 0.0)
        {
            let side = |metres: f64, [plus, minus]: [&str; 2]| {
                format!("{:.0} cm {}", 100.0 * metres.abs(), if metres < 0.0 { minus } else { plus })
            };
            return format!(
                "step to another place on the plate, {} and {}",
                side(forward_m, ["forward", "back"]),
                side(left_m, ["to the left", "to the right"])
            );
        }
        let turned =
            if self.turn_deg == 0.0 { String::new() } else { format!("{} and ", turn(self.turn_deg)) };
        match self.poses.as_slice() {
            [pose] => format!("{turned}hold this pose: {pose}"),
            poses => format!("{turned}hold these poses, one after the other: {}", poses.join("; ")),
        }
    }
}

/// `turn by 90° to the left`.
pub fn turn(turn_deg: f64) -> String {
    let side = if turn_deg < 0.0 { "right" } else { "left" };
    if turn_deg.abs() == 180.0 {
        return "turn around".to_owned();
    }
    format!("turn by {:.0}° to the {side}", turn_deg.abs())
}

/// The table as written; absent values are left out.
pub(super) fn write(file: &mut String, ask: &Ask) {
    let [one, other] = ask.between.each_ref().map(|name| toml::Value::from(name.as_str()).to_string());
    // Writing to a string cannot fail.
    let _ = write!(file, "\n# {}\n[ask]\nbetween = [{one}, {other}]\n", ask.what());
    if !ask.poses.is_empty() {
        let _ = writeln!(file, "poses = {}", toml::Value::from(ask.poses.clone()));
    }
    for (key, value) in [("turn_deg", ask.turn_deg), ("still_s", ask.still_s)] {
        if value != 0.0 {
            let _ = writeln!(file, "{key} = {value:?}");
        }
    }
    if ask.step_m != [0.0; 2] {
        let _ = writeln!(file, "step_m = {:?}", ask.step_m);
    }
    if ask.fast {
        let _ = writeln!(file, "fast = true");
    }
    let evidence = [
        ("separation_sigma", ask.separation_sigma),
        ("information_nats", ask.information_nats),
        ("decides", ask.decides),
    ];
    for (key, value) in evidence {
        let _ = writeln!(file, "{key} = {value:?}");
    }
}

/// The invalid key and its error message; comparisons with NaN are false, so NaN is rejected too.
pub(super) fn check(ask: &Ask) -> Result<(), (String, String)> {
    let refuse = |key: &str, what: String| Err((key.to_owned(), what));
    let is_shown =
        |name: &String| (1..=NAME_MAX).contains(&name.len()) && !name.chars().any(char::is_control);
    if !ask.between.iter().all(is_shown) {
        return refuse("between", format!("give two names of 1 to {NAME_MAX} characters"));
    }
    if let Some(pose) = ask.poses.iter().find(|pose| index_of(pose).is_none()) {
        let known: Vec<&str> = LIBRARY.iter().map(|posture| posture.name).collect();
        let what = format!("`{pose}` is no pose of the library{}", text::hint(pose, &known));
        return refuse("poses", what);
    }
    if ask.poses.len() > POSE_REQUESTS_MAX {
        return refuse("poses", format!("give at most {POSE_REQUESTS_MAX} poses"));
    }
    let [turn_deg, step_m, still_s, separation_sigma, information_nats] = ASK_MAX;
    let numbers = [
        ("turn_deg", ask.turn_deg, [-turn_deg, turn_deg]),
        ("step_m", ask.step_m[0], [-step_m, step_m]),
        ("step_m", ask.step_m[1], [-step_m, step_m]),
        ("still_s", ask.still_s, [0.0, still_s]),
        ("separation_sigma", ask.separation_sigma, [0.0, separation_sigma]),
        ("information_nats", ask.information_nats, [0.0, information_nats]),
        ("decides", ask.decides, [0.0, 1.0]),
    ];
    for (key, value, [min, max]) in numbers {
        if !(min..=max).contains(&value) {
            return refuse(key, format!("{value} is not between {min} and {max}"));
        }
    }
    let things = [!ask.poses.is_empty(), ask.step_m != [0.0; 2], ask.still_s > 0.0, ask.fast];
    if things.into_iter().filter(|thing| *thing).count() != 1 {
        return refuse("poses", "ask for one thing: poses, step_m, still_s or fast".to_owned());
    }
    if ask.turn_deg != 0.0 && ask.poses.is_empty() {
        return refuse("turn_deg", "a turn goes with a pose".to_owned());
    }
    Ok(())
}

fn index_of(pose: &str) -> Option<usize> {
    LIBRARY.iter().position(|posture| posture.name == pose)
}

impl Ask {
    /// The poses for the loop's guidance; all `None` if no pose is requested.
    pub fn pose_requests(&self) -> [Option<PoseRequest>; POSE_REQUESTS_MAX] {
        let turn_rad = self.turn_deg.to_radians();
        std::array::from_fn(|index| Some(PoseRequest { pose: index_of(self.poses.get(index)?)?, turn_rad }))
    }
}

#[cfg(test)]
mod tests {
    use super::super::ModelFile;
    use super::*;

    const ASK: &str = "version = 1\n[ask]\nbetween = [\"hand_load right\", \"worn_mass T8\"]\npose = \"both arms up\"\n\
                       turn_deg = 90.0\nseparation_sigma = 4.25\n";

    #[test]
    fn what_is_asked_for_is_written_read_and_given_to_the_loop() {
        let file = ModelFile::parse(ASK, "m.toml").unwrap();
        let ask = file.ask.clone().unwrap();
        let [Some(asked), None, None, None] = ask.pose_requests() else { panic!("{ask:?}") };
        assert_eq!((LIBRARY[asked.pose].name, asked.turn_rad.to_degrees()), ("both arms up", 90.0));
        let sentence = "turn by 90° to the left and hold this pose: both arms up: hand_load right and worn_mass T8 then \
                        differ by 4.2 σ; decides with 0 %";
        assert_eq!(ask.sentence(), sentence);
        let again = |ask: Ask| {
            let written = ModelFile { ask: Some(ask), ..ModelFile::default() };
            assert_eq!(ModelFile::parse(&written.to_toml(), "written").unwrap(), written);
            written.ask.unwrap()
        };
        again(ask.clone());
        let poses: Vec<String> = LIBRARY[1..4].iter().map(|posture| posture.name.to_owned()).collect();
        let several = again(Ask { poses, decides: 0.9, ..ask.clone() });
        assert!(
            several.sentence().contains("hold these poses, one after the other"),
            "{}",
            several.sentence()
        );
        assert_eq!(
            several.pose_requests().map(|one| one.map(|one| one.pose)),
            [Some(1), Some(2), Some(3), None]
        );
        let other = Ask { poses: Vec::new(), turn_deg: 0.0, ..ask };
        for (one, what) in [
            (Ask { fast: true, ..other.clone() }, "squat quickly"),
            (Ask { still_s: 180.0, ..other.clone() }, "stand still for 3 minutes"),
            (Ask { step_m: [0.15, -0.15], ..other.clone() }, "15 cm forward and 15 cm to the right"),
        ] {
            let one = again(one);
            assert!(one.sentence().contains(what), "{}", one.sentence());
            assert_eq!(one.pose_requests(), [None; POSE_REQUESTS_MAX], "that is no pose");
        }
    }

    #[test]
    fn what_cannot_be_asked_for_is_refused() {
        let refusal = |from: &str, to: &str| {
            assert!(ASK.contains(from));
            ModelFile::parse(&ASK.replace(from, to), "m.toml").unwrap_err().to_string()
        };
        for (from, to, expected) in [
            (
                "both arms up",
                "both arms upp",
                "m.toml, ask, poses: `both arms upp` is no pose of the library; did you mean",
            ),
            ("90.0", "900.0", "ask, turn_deg: 900 is not between -180 and 180"),
            ("4.25", "nan", "ask, separation_sigma"),
            ("worn_mass T8", "\\u001b[2J", "ask, between"),
            ("pose = \"both arms up\"\n", "", "ask for one thing"),
            ("turn_deg", "fast = true\nturn_deg", "ask for one thing"),
            ("pose = \"both arms up\"\n", "fast = true\n", "a turn goes with a pose"),
            ("turn_deg", "turn", "`turn` is not known; did you mean `turn_deg`"),
        ] {
            let said = refusal(from, to);
            assert!(said.contains(expected), "{said}");
        }
    }
}
