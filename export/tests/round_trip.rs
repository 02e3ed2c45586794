//! Tables read back: each value equals that of the state's JSON, and an invalid one is absent.
#![expect(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

use std::collections::BTreeMap;
use std::path::Path;

use bytemuck::Zeroable;
use equipoise_adapters::recording::{Recorder, RecordingHeader};
use equipoise_core::body::Joint;
use equipoise_core::body::SEGMENTS;
use equipoise_core::message::suit::SuitBlocks;
use equipoise_core::message::{CycleRecord, GroundSample, Message, State, SuitSample, Validity};
use equipoise_export::{Export, Format, Progress, Summary, Topic};
use equipoise_view::StateJson;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use tempfile::TempDir;

const STARTED_NS: u64 = 5_000_000_000;
/// More than one group of rows.
const STATES: u64 = 9000;

/// A row by column: what is there.
type Row = BTreeMap<String, String>;

/// Numbers without a pattern that follow from where one begins.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0 >> 11
    }

    fn real(&mut self) -> f64 {
        self.next() as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// A state of which every number is some number, and every third has no reason to withhold anything.
fn state(cycle: u64, numbers: &mut Numbers) -> State {
    let mut state = State::zeroed();
    let reals = bytemuck::cast_slice_mut::<u8, f64>(bytemuck::bytes_of_mut(&mut state));
    for field in State::FIELDS.iter().filter(|field| field.primitive.size() == 8) {
        for real in reals.iter_mut().skip(field.offset / 8).take(field.count) {
            *real = numbers.real();
        }
    }
    (state.cycle, state.time_ns) = (cycle, STARTED_NS + cycle * 1_000_000);
    (state.suit_sample_time_ns, state.suit_age_ns) = (numbers.next() % 3, numbers.next());
    state.ground_age_ns = if numbers.next().is_multiple_of(3) { u64::MAX } else { numbers.next() };
    (state.group_delay_ns, state.published_ns) = (numbers.next(), numbers.next());
    let reason = Validity::NAMES[numbers.next() as usize % Validity::NAMES.len()].0;
    state.valid = if cycle.is_multiple_of(3) { 0 } else { reason.0 };
    state.phase = (numbers.next() % 4) as u32;
    state.suggested_pose = if numbers.next().is_multiple_of(2) { u32::MAX } else { 3 };
    state.worst_joint = (numbers.next() % 22) as u32;
    state.unavailable = (numbers.next() % 4) as u32;
    state.joint_level = std::array::from_fn(|_| (numbers.next() % 6) as u32);
    state.cop_measured_sigma_m = state.cop_measured_sigma_m.map(f64::abs);
    if numbers.next().is_multiple_of(4) {
        state.advice_direction = [0.0; 3];
    }
    state
}

fn write<M: equipoise_adapters::recording::topic::Recorded>(
    folder: &TempDir,
    messages: &[M],
    time_ns: fn(&M) -> u64,
) -> std::path::PathBuf {
    let path = folder.path().join("made.mcap");
    let header = RecordingHeader {
        software_version: "0.0.9".to_owned(),
        started_unix_ns: 17,
        started_monotonic_ns: STARTED_NS,
        config_toml: "station = \"bench-1\"\n[subject]\nid = \"anon-7\"\n".to_owned(),
        ..RecordingHeader::default()
    };
    let mut recorder = Recorder::create(&path, &header).unwrap();
    for message in messages {
        recorder.write(time_ns(message), message).unwrap();
    }
    recorder.finish().unwrap();
    path
}

fn export(recording: &Path, out: &Path, topic: Topic) -> anyhow::Result<Summary> {
    let format = Format::of(out)?;
    let export = Export { recording, states: None, is_replayed: false, topic, format, span_s: None, out };
    export.run(&mut Progress::new(&mut |_, _| {}))
}

/// All tables of a recording, which must hold the same; and the footer.
fn tables(folder: &TempDir, recording: &Path, topic: Topic) -> (Vec<Row>, BTreeMap<String, String>) {
    let exported = |ending: &str| {
        let out = folder.path().join(format!("{topic:?}.{ending}"));
        assert_eq!(export(recording, &out, topic).unwrap().rejected, [] as [String; 0]);
        out
    };
    std::thread::scope(|scope| {
        let csv = scope.spawn(|| read_csv(&exported("csv")));
        let json = scope.spawn(|| read_json_lines(&exported("jsonl")));
        let (rows, footer) = read_parquet(&exported("parquet"));
        assert_eq!(csv.join().unwrap(), rows, "{topic:?}");
        assert_eq!(json.join().unwrap(), rows, "{topic:?}");
        (rows, footer)
    })
}

fn read_json_lines(path: &Path) -> Vec<Row> {
    let value = |(name, value): (&String, &serde_json::Value)| {
        let text = match value {
            serde_json::Value::String(text) if text.is_empty() => return None,
            serde_json::Value::String(text) => text.clone(),
            // As CSV and Parquet print them, 5 and not 5.0.
            number if number.is_f64() => number.as_f64().unwrap().to_string(),
            number => number.to_string(),
        };
        Some((name.clone(), text))
    };
    let row = |line: &str| {
        let object: serde_json::Map<String, serde_json::Value> = serde_json::from_str(line).unwrap();
        object.iter().filter_map(value).collect()
    };
    std::fs::read_to_string(path).unwrap().lines().map(row).collect()
}

fn read_parquet(path: &Path) -> (Vec<Row>, BTreeMap<String, String>) {
    let reader = SerializedFileReader::new(std::fs::File::open(path).unwrap()).unwrap();
    let pairs = reader.metadata().file_metadata().key_value_metadata().unwrap();
    let footer = pairs.iter().map(|pair| (pair.key.clone(), pair.value.clone().unwrap())).collect();
    let there = |(name, value): (&String, &Field)| {
        let reported = match value {
            // CSV does not distinguish an empty text from a missing one.
            Field::Null => return None,
            Field::Str(text) if text.is_empty() => return None,
            Field::Double(value) => value.to_string(),
            Field::ULong(value) => value.to_string(),
            Field::UInt(value) => value.to_string(),
            Field::Str(text) => text.clone(),
            other => panic!("{name}: {other:?}"),
        };
        Some((name.clone(), reported))
    };
    let rows = reader.get_row_iter(None).unwrap();
    (rows.map(|row| row.unwrap().get_column_iter().filter_map(there).collect()).collect(), footer)
}

fn read_csv(path: &Path) -> Vec<Row> {
    let reported = std::fs::read_to_string(path).unwrap();
    let mut lines = reported.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!(cells.len(), names.len());
        let there = names.iter().zip(cells).filter(|(_, cell)| !cell.is_empty());
        there.map(|(name, cell)| ((*name).to_owned(), cell.to_owned())).collect()
    };
    lines.map(row).collect()
}

/// Columns whose number has the same name in a state's JSON.
const SAME: [&str; 28] = [
    "mass_kg",
    "lifted_mass_kg",
    "lifted_mass_sigma_kg",
    "load_hand_distance_m",
    "reach_m",
    "l5s1_moment_nm",
    "l5s1_moment_sigma_nm",
    "l5s1_compression_n",
    "l5s1_compression_sigma_n",
    "dose_damage",
    "dose_probability",
    "variance_max_m2",
    "predicted_cop_sigma_m",
    "nis",
    "prior_inflation",
    "pose_mismatch_rad",
    "suit_skew_s",
    "suit_skew_sigma_s",
    "suit_age_ns",
    "ground_age_ns",
    "advice_gain_nm_per_cm",
    "delta_f_sigma_n",
    "cycle",
    "poses_used",
    "stance",
    "group_delay_ns",
    "lifts",
    "suggested_pose",
];

/// Columns, and where a state's JSON has the same number.
fn pairs() -> Vec<(String, Vec<String>)> {
    let mut pairs: Vec<_> = SAME.map(|name| (name.to_owned(), vec![name.to_owned()])).into();
    pairs.push(("t_s".to_owned(), vec!["t".to_owned()]));
    for (field, key, names) in [
        ("cop_measured_m", "cop_measured", &["x", "y"][..]),
        ("cop_measured_sigma_m", "cop_measured_sigma", &["x", "y"]),
        ("cop_estimated_m", "cop_estimated", &["x", "y"]),
        ("cop_sigma_m", "cop_sigma", &["x", "y"]),
        ("com_m", "com", &["x", "y", "z"]),
        ("suit_com_m", "suit_com", &["x", "y", "z"]),
        ("ground_force_n", "ground_force_n", &["x", "y"]),
        ("delta_f_n", "delta_f_n", &["x", "y", "z"]),
        ("foot_load_fraction", "foot_load_fraction", &["left", "right"]),
        ("hand_load_fraction", "hand_load_fraction", &["left", "right"]),
        ("advice_direction", "advice_direction", &["x", "y", "z"]),
    ] {
        for (index, name) in names.iter().enumerate() {
            pairs.push((format!("{field}_{name}"), vec![key.to_owned(), index.to_string()]));
        }
    }
    pairs.push(("ground_force_n_z".to_owned(), vec!["vertical_force_n".to_owned()]));
    for joint in Joint::ALL.map(Joint::name) {
        let of = |key: &str| vec!["joints".to_owned(), joint.to_owned(), key.to_owned()];
        pairs.push((format!("torque_sigma_nm_{joint}"), of("sigma_nm")));
        pairs.push((format!("torque_limit_nm_{joint}"), of("limit_nm")));
        pairs.push((format!("fatigue_{joint}"), vec!["fatigue".to_owned(), joint.to_owned()]));
        for (index, axis) in ["x", "y", "z"].iter().enumerate() {
            let path = of("torque_nm").into_iter().chain([index.to_string()]).collect();
            pairs.push((format!("torque_nm_{joint}_{axis}"), path));
        }
    }
    pairs
}

#[test]
fn a_table_of_states_is_their_json() {
    let folder = tempfile::tempdir().unwrap();
    let mut numbers = Numbers(7);
    let states: Vec<State> = (1..=STATES).map(|cycle| state(cycle, &mut numbers)).collect();
    let (rows, footer) = tables(&folder, &write(&folder, &states, |state| state.time_ns), Topic::State);
    assert_eq!(rows.len(), states.len());
    let pairs: Vec<(String, String)> =
        pairs().into_iter().map(|(column, path)| (column, format!("/{}", path.join("/")))).collect();
    let (mut there, mut withheld) = (0, 0);
    for (state, row) in states.iter().zip(&rows) {
        let t_s = (state.time_ns - STARTED_NS) as f64 / 1e9;
        let json = serde_json::to_value(StateJson::new(state, t_s)).unwrap();
        for (column, pointer) in &pairs {
            let reported = row.get(column).map(|reported| reported.parse::<f64>().unwrap());
            let said = json.pointer(pointer).map(|value| value.as_f64().unwrap());
            assert_eq!(reported.map(f64::to_bits), said.map(f64::to_bits), "{column} {:?}", json["valid"]);
            if reported.is_some() { there += 1 } else { withheld += 1 }
        }
        assert_eq!(row["phase_name"], json["phase"].as_str().unwrap());
        let names: Vec<&str> =
            json["valid"].as_array().unwrap().iter().filter_map(|name| name.as_str()).collect();
        assert_eq!(row.get("valid_names").map_or("", String::as_str), names.join(" "));
    }
    assert!(there > 100_000 && withheld > 100_000, "{there} there, {withheld} withheld");
    let json = |key: &str| -> serde_json::Value { serde_json::from_str(&footer[key]).unwrap() };
    assert_eq!(json("equipoise.units")["torque_nm_L5S1_x"], "N m");
    assert_eq!(json("equipoise.names")["phase"]["2"], "monitoring");
    assert_eq!(json("equipoise.names")["valid"]["1"], "suit_stale");
    for (key, value) in [("station", "bench-1"), ("subject", "anon-7"), ("type_name", State::TYPE_NAME)] {
        assert_eq!(footer[&format!("equipoise.{key}")], value);
    }
}

#[test]
fn what_the_loop_masks_is_withheld_and_what_it_publishes_is_not() {
    let mut numbers = Numbers(11);
    let mut state = state(1, &mut numbers);
    (state.suggested_pose, state.suit_sample_time_ns, state.unavailable) = (3, STARTED_NS, 0);
    let pose = ["suit_com_m_x", "pose_mismatch_rad", "segment_origin_m_Pelvis_z"];
    let load = ["foot_load_fraction_left", "sharing_source", "hand_load_fraction_right", "torque_nm_L5S1_y"];
    let distance = ["load_hand_distance_m"];
    for (flag, withheld, there) in [
        (Validity::SUIT_IMPLAUSIBLE, [&pose[..], &load, &distance].concat(), vec![]),
        (Validity::POSITION_UNKNOWN, vec!["suit_com_m_x"], vec!["segment_origin_m_Pelvis_z"]),
        (Validity::BELOW_LOAD_THRESHOLD, [&load[..], &distance].concat(), pose.to_vec()),
        (Validity::LOAD_NOT_AT_HANDS, load.to_vec(), [&pose[..], &distance].concat()),
        (Validity::default(), vec![], [&pose[..], &load, &distance].concat()),
    ] {
        state.valid = flag.0;
        let folder = tempfile::tempdir().unwrap();
        let (rows, _) = tables(&folder, &write(&folder, &[state], |state| state.time_ns), Topic::State);
        for (names, expected) in [(&withheld, false), (&there, true)] {
            for name in names {
                assert_eq!(rows[0].contains_key(*name), expected, "{name} with {:?}", state.validity());
            }
        }
    }
}

#[test]
fn samples_lose_what_was_not_measured_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let mut suit = SuitSample { sample_time_ns: STARTED_NS + 500_000_000, ..SuitSample::zeroed() };
    suit.blocks = SuitBlocks::CentreOfMass as u32;
    suit.orientation_wxyz = [[1.0, 0.0, 0.0, 0.0]; SEGMENTS];
    (suit.com_m, suit.position_m[1]) = ([0.1, 0.2, 0.3], [1.5, 0.0, 0.0]);
    let (rows, _) = tables(&folder, &write(&folder, &[suit], |suit| suit.sample_time_ns), Topic::Suit);
    let [row] = &rows[..] else { panic!("{} rows", rows.len()) };
    assert_eq!(
        (row["t_s"].as_str(), row["com_m_y"].as_str(), row["position_m_L5_x"].as_str()),
        ("0.5", "0.2", "1.5")
    );
    assert!(
        !row.keys().any(|name| name.starts_with("velocity") || name.starts_with("joint_angle")),
        "{row:?}"
    );

    let folder = tempfile::tempdir().unwrap();
    let ground =
        GroundSample { sample_time_ns: STARTED_NS, force_n: [1.0, 2.0, 700.0], ..GroundSample::zeroed() };
    let insole = GroundSample { not_measured: 1, per_foot: 1, foot_vertical_n: [700.0, 0.0], ..ground };
    let faulty = GroundSample { device_status: 5, ..ground };
    let all = [ground, insole, faulty];
    let (rows, _) = tables(&folder, &write(&folder, &all, |ground| ground.sample_time_ns), Topic::Ground);
    let has = |row: usize, name: &str| rows[row].contains_key(name);
    assert!(has(0, "force_n_x") && has(0, "moment_nm_y") && !has(0, "foot_vertical_n_left"));
    assert!(
        !has(1, "force_n_x")
            && has(1, "force_n_z")
            && has(1, "foot_cop_m_left_x")
            && !has(1, "foot_cop_m_right_x")
    );
    assert!(!has(2, "force_n_z") && rows[2]["device_status"] == "5");
}

#[test]
fn stamps_of_what_did_not_happen_are_not_there() {
    let folder = tempfile::tempdir().unwrap();
    let record =
        CycleRecord { cycle: 3, due_ns: STARTED_NS + 1, woken_ns: STARTED_NS + 9, ..CycleRecord::zeroed() };
    let (rows, _) = tables(&folder, &write(&folder, &[record], |record| record.due_ns), Topic::Cycle);
    assert_eq!(rows[0]["woken_ns"], (STARTED_NS + 9).to_string());
    for name in ["published_ns", "suit_first", "suit_arrival_ns", "command_argument_0"] {
        assert!(!rows[0].contains_key(name), "{name}");
    }
}

#[test]
fn a_missing_message_is_reported_and_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let recording =
        write(&folder, &[State { time_ns: STARTED_NS, ..State::zeroed() }], |state| state.time_ns);
    for (name, topic, why) in [
        ("none.parquet", Topic::Cycle, "there is no cycle record in it"),
        ("none.xlsx", Topic::State, "ends in .csv, .jsonl, .parquet"),
    ] {
        let out = folder.path().join(name);
        let message = format!("{:#}", export(&recording, &out, topic).unwrap_err());
        assert!(message.contains(why), "{message}");
        assert!(!out.exists() && std::fs::read_dir(folder.path()).unwrap().count() == 1);
    }
    // A truncated recording is exported up to the damage.
    let mut numbers = Numbers(1);
    let states: Vec<State> = (1..=STATES).map(|cycle| state(cycle, &mut numbers)).collect();
    std::fs::remove_file(&recording).unwrap();
    let bytes = std::fs::read(write(&folder, &states, |state| state.time_ns)).unwrap();
    std::fs::write(&recording, &bytes[..bytes.len() / 2]).unwrap();
    let out = folder.path().join("cut.parquet");
    assert!(!export(&recording, &out, Topic::State).unwrap().rejected.is_empty());
    assert!((1..STATES as usize).contains(&read_parquet(&out).0.len()));
}

#[test]
fn a_span_selects_rows_by_their_time() {
    let folder = tempfile::tempdir().unwrap();
    let mut numbers = Numbers(3);
    let states: Vec<State> = (1..=100).map(|cycle| state(cycle, &mut numbers)).collect();
    let (recording, out) = (write(&folder, &states, |state| state.time_ns), folder.path().join("part.csv"));
    let export = |span_s: [f64; 2]| {
        let (topic, format) = (Topic::State, Format::Csv);
        let export = Export {
            recording: &recording,
            states: None,
            is_replayed: false,
            topic,
            format,
            span_s: Some(span_s),
            out: &out,
        };
        export.run(&mut Progress::new(&mut |_, _| {}))
    };
    export([0.01, 0.02]).unwrap();
    let times: Vec<String> = read_csv(&out).iter().map(|row| row["t_s"].clone()).collect();
    assert_eq!((times.len(), &*times[0], &*times[10]), (11, "0.01", "0.02"));
    assert!(export([5.0, 6.0]).unwrap_err().to_string().contains("from 5 to 6 s"));
}
