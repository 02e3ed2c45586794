//! `equipoise report` as a program: numbers, form, and its output for incomplete recordings.

use bytemuck::Zeroable;
use equipoise_adapters::recording::{Recorder, RecordingHeader};
use equipoise_core::body::{Joint, Side};
use equipoise_core::message::{AdapterHealth, CycleRecord, State, Validity};
use equipoise_core::overload::Level;
use equipoise_view::words;
use serde_json::Value;

use crate::page::Page;
use crate::session::{LIFTS, RATE_HZ, Session, equipoise, session, text};

/// The page of a recording of the session.
fn report(name: &str, recording: &std::path::Path) -> Page {
    let out = session().file(name);
    let ended = equipoise(&["report", text(recording), "--out", text(&out)]);
    assert_eq!(ended.status.code(), Some(0), "{ended:?}");
    Page::read(&out)
}

fn number(text: &str) -> f64 {
    let end = text.find(|c: char| !(c.is_ascii_digit() || ".-+e".contains(c))).unwrap_or(text.len());
    text[..end].parse().unwrap_or_else(|_| panic!("{text:?}"))
}

#[track_caller]
fn near(cell: &str, expected: f64, within: f64) {
    assert!((number(cell) - expected).abs() <= within, "reported {cell}, expected {expected}");
}

fn magnitude(torque: &Value) -> f64 {
    torque.as_array().unwrap().iter().map(|axis| axis.as_f64().unwrap().powi(2)).sum::<f64>().sqrt()
}

#[test]
fn minutes_and_peaks_of_every_joint_are_those_of_the_states() {
    let (session, page) = (session(), report("joints.html", &session().states));
    let reported: Vec<&Value> = session.values_of("joints").map(|(_, joints)| joints).collect();
    assert!(reported.len() > 500, "too few valid torques for the test: {}", reported.len());
    for joint in Joint::ALL {
        let states = || reported.iter().map(|joints| &joints[joint.name()]);
        let cell = |column: &str| page.cell("Minutes at each level", words::joint(joint), column);
        for (column, level) in [
            ("low", "green"),
            ("medium", "orange"),
            ("high", "red"),
            ("overloaded", "above_max"),
            ("not sure", "undecided"),
        ] {
            let cycles = states().filter(|state| state["level"] == level).count();
            near(cell(column), cycles as f64 / RATE_HZ / 60.0, 0.00051);
        }
        let limit_ratio =
            |state: &Value| magnitude(&state["torque_nm"]) / state["limit_nm"].as_f64().unwrap();
        let peak = states().max_by(|a, b| limit_ratio(a).total_cmp(&limit_ratio(b))).unwrap();
        near(cell("peak, N m"), magnitude(&peak["torque_nm"]), 0.051);
        near(cell("of the limit"), 100.0 * limit_ratio(peak), 0.51);
    }
    let worst = |name: &str| session.values_of("worst_joint").filter(|(_, worst)| *worst == name).count();
    let most = Joint::ALL.into_iter().max_by_key(|joint| worst(joint.name())).unwrap();
    assert!(
        page.text.contains(&format!("The {} was the joint closest", words::joint(most))),
        "{}",
        page.text
    );
}

#[test]
fn lifts_match_the_simulation() {
    let (session, page) = (session(), report("lifts.html", &session().states));
    let rows = page.rows("Lifts");
    let counted = session.lines.last().unwrap()["lifts"].as_u64().unwrap();
    assert_eq!((rows.len(), counted), (2, 2), "{rows:?}");
    for (row, (mass_kg, [from_s, to_s])) in rows.iter().zip(LIFTS) {
        let [reported_from_s, reported_to_s] = [&row[1], &row[2]].map(|cell| number(cell));
        assert!(
            reported_from_s > from_s - 0.6
                && reported_to_s < to_s + 0.6
                && reported_to_s - reported_from_s > 2.0,
            "{row:?}"
        );
        near(&row[3], mass_kg, 0.8);
        let between = |key| {
            let within = |time_s: f64| (reported_from_s - 0.06..reported_to_s + 0.06).contains(&time_s);
            let values = session.values_of(key).filter(move |(time_s, _)| within(*time_s));
            values.map(|(_, value)| value.as_f64().unwrap()).collect::<Vec<_>>()
        };
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        near(&row[3], mean(&between("lifted_mass_kg")), 0.02);
        near(&row[4], mean(&between("reach_m")), 0.003);
    }
}

#[test]
fn identification_dose_and_quality_are_those_of_the_states() {
    let (session, page) = (session(), report("other.html", &session().states));
    let last = session.lines.last().unwrap();
    let poses = page.rows("Identification");
    assert_eq!(number(&poses.last().unwrap()[0]), last["poses_used"].as_f64().unwrap());
    assert_eq!(poses.len() as u64, last["poses_used"].as_u64().unwrap() + 1, "the prior, and one row a pose");
    let sigma = |row: &Vec<String>| number(&row[3]);
    // The first pose is held at once here, before a CoP was predicted from the prior alone.
    assert_eq!(poses[0][3], "-");
    assert!(sigma(poses.last().unwrap()) < 0.5 * sigma(&poses[1]), "{poses:?}");
    for row in &poses[1..] {
        let mut entered =
            session.lines.iter().filter(|line| line["poses_used"].as_u64() == row[0].parse().ok());
        let first = |key: &str| entered.find_map(|line| line[key].as_f64()).unwrap();
        // The filter's results for a pose may be published some cycles later.
        let [t_s, sigma_m, nis] = ["t", "predicted_cop_sigma_m", "nis"].map(first);
        near(&row[1], t_s, 0.051);
        near(&row[3], 1e3 * sigma_m, 0.0051);
        near(&row[5], nis, 0.0051);
    }
    let total = session.lines.len() as f64;
    for row in page.rows("Invalid reasons") {
        let raised = session
            .lines
            .iter()
            .filter(|line| line["valid"].as_array().unwrap().contains(&row[0].as_str().into()));
        near(&row[2], 100.0 * raised.count() as f64 / total, 0.051);
    }
    let damage = format!("{:.3e}", last["dose_damage"].as_f64().unwrap());
    assert!(page.text.contains(&damage), "{damage} is not in {}", page.text);
    let peak_n =
        session.values_of("l5s1_compression_n").map(|(_, n)| n.as_f64().unwrap()).fold(0.0, f64::max);
    assert!(peak_n > 500.0 && page.text.contains(&format!("at most {peak_n:.0} ±")), "{peak_n}");
    for expected in ["2026-09-21T14:13:20Z", "bench-1", "anon-7", "The stop rule was met at t ="] {
        assert!(page.text.contains(expected), "{expected} is not in {}", page.text);
    }
    assert!(
        page.text.contains("no cycle records") && page.text.contains("losses and refusals are unavailable")
    );
}

#[test]
fn the_body_over_time_is_bounded_and_begins_with_the_highest_load() {
    let page = report("body.html", &session().states);
    let at = |index: usize, key: &str| {
        let (_, attributes) = &page.elements[index];
        attributes.iter().find(|(name, _)| name == key).map(|(_, value)| value.as_str())
    };
    let is_button = |index: &usize| page.elements[*index].0 == "input";
    let buttons: Vec<usize> = (0..page.elements.len()).filter(is_button).collect();
    assert!((60..=240).contains(&buttons.len()), "{}", buttons.len());
    for index in &buttons {
        assert_eq!((at(*index, "type"), at(*index, "name")), (Some("radio"), Some("body")));
        assert!(at(*index, "aria-label").unwrap().starts_with("t = "), "{:?}", page.elements[*index]);
        assert_eq!(page.elements[index + 1].0, "svg", "each button has its drawing");
    }
    let checked: Vec<&str> = buttons
        .iter()
        .filter(|index| at(**index, "checked").is_some())
        .map(|index| at(*index, "aria-label").unwrap())
        .collect();
    let highest = &page.rows("Minutes at each level")[0][0];
    let percent = page.cell("Minutes at each level", highest, "of the limit");
    assert_eq!(checked.len(), 1);
    assert!(checked[0].contains(&format!(": {highest} {percent} ± ")), "{checked:?}, {highest} {percent}");
    // Without a valid pose there is no figure.
    let page = report(
        "no-body.html",
        &states("no-body.mcap", &[State { cycle: 1, time_ns: 10_000_000, ..State::zeroed() }], |_| {}),
    );
    assert!(page.text.contains("No pose of the suit was valid"), "{}", page.text);
}

#[test]
fn with_one_configuration_several_recordings_keep_their_subjects() {
    let session = session();
    let [again, other, out] =
        ["again.mcap", "other-subject.toml", "subjects.html"].map(|name| session.file(name));
    std::fs::copy(&session.samples, &again).unwrap();
    let subject = equipoise_studies::subject::Subject::of_the_paper(5);
    std::fs::write(&other, crate::session::config(&subject).replace("anon-7", "anon-9")).unwrap();
    let files = [text(&session.samples), text(&again)];
    let ended = equipoise(&["report", files[0], files[1], "--config", text(&other), "--out", text(&out)]);
    assert!(matches!(ended.status.code(), Some(0 | 3)), "{ended:?}");
    let page = Page::read(&out);
    assert_eq!(page.cell("Comparison", "comparable", "2: anon-7"), "yes");
    let configuration = page.cell("Session 1: Session", "configuration", "value");
    assert!(configuration.contains("with the recording's own [subject]"), "{configuration}");
    let peaks = page.rows("Peak of each joint");
    assert!(!peaks.is_empty() && peaks.iter().all(|row| row[1] == row[2]), "{peaks:?}");
}

#[test]
fn samples_without_states_are_replayed_to_the_same_numbers() {
    let session = session();
    let (recorded, replayed) =
        (report("recorded.html", &session.states), report("replayed.html", &session.samples));
    assert!(replayed.text.contains("computed from the samples by a replay"));
    assert!(!recorded.text.contains("by a replay"));
    assert!(replayed.text.contains("Equipoise 0.0.9"), "the release that recorded");
    for heading in ["Identification", "Minutes at each level", "Lifts", "Invalid reasons", "Dose and fatigue"]
    {
        assert_eq!(recorded.rows(heading), replayed.rows(heading), "{heading}");
    }
}

#[test]
fn the_report_is_reproducible_and_self_contained() {
    let session = session();
    let pages = ["once.html", "again.html"].map(|name| {
        report(name, &session.states);
        std::fs::read_to_string(session.file(name)).unwrap()
    });
    assert_eq!(pages[0], pages[1]);
    let page = Page::read(&session.file("once.html"));
    for (name, attributes) in &page.elements {
        assert!(!["script", "link", "img", "iframe", "object", "a"].contains(&name.as_str()), "<{name}>");
        for (key, value) in attributes {
            assert!(!["src", "href", "xlink:href"].contains(&key.as_str()), "{key} = {value}");
        }
    }
    for outside in ["http:", "https:", "url(", "@import", "file:"] {
        assert!(!pages[0].contains(outside), "{outside}");
    }
    assert!(page.elements.iter().filter(|(name, _)| name == "svg").count() >= 6, "drawings");
}

/// A recording of given states.
fn states(name: &str, states: &[State], more: impl FnOnce(&mut Recorder)) -> std::path::PathBuf {
    let session: &Session = session();
    let path = session.file(name);
    let subject = equipoise_studies::subject::Subject::of_the_paper(5);
    let header = RecordingHeader {
        config_toml: crate::session::config(&subject),
        software_version: "<b>0</b>".to_owned(),
        ..RecordingHeader::default()
    };
    let mut recorder = Recorder::create(&path, &header).unwrap();
    for state in states {
        recorder.write(state.time_ns, state).unwrap();
    }
    more(&mut recorder);
    recorder.finish().unwrap();
    path
}

#[test]
fn invalid_values_are_not_drawn() {
    let state = |cycle: u64| {
        let mut state = State { cycle, time_ns: cycle * 10_000_000, ..State::zeroed() };
        // An invalid value is zero, as in the loop's states.
        if (300..600).contains(&cycle) {
            state.valid = Validity::MOVING.0;
        } else {
            state.l5s1_compression_n = 2000.0 + (cycle % 7) as f64;
            state.torque_limit_nm = [100.0; _];
        }
        state
    };
    let all: Vec<State> = (1..900).map(state).collect();
    let page = report("hole.html", &states("hole.mcap", &all, |_| {}));
    assert_eq!(page.line("compression").matches('M').count(), 2, "two runs, and a hole between them");
    assert!(page.text.contains("2003 N on average, at most 2006 ±"), "{}", page.text);
    near(page.cell("Invalid reasons", "moving", "share"), 100.0 * 300.0 / 899.0, 0.051);
    assert!(page.text.contains("Equipoise <b>0</b>"), "what a file says of itself stays text");
}

#[test]
fn torques_of_a_tenth_of_a_second_give_no_headline() {
    let state = |cycle: u64| State {
        cycle,
        time_ns: cycle * 10_000_000,
        valid: if cycle <= 10 { 0 } else { Validity::MOVING.0 },
        ..State::zeroed()
    };
    let all: Vec<State> = (1..900).map(state).collect();
    let page = report("short.html", &states("short.mcap", &all, |_| {}));
    for expected in ["reported for 0.1 s only: too short to compare", "0.1 s, too short for a recommendation"]
    {
        assert!(page.text.contains(expected), "{expected} is not in {}", page.text);
    }
}

#[test]
fn recommendations_have_a_number_and_a_basis() {
    let joint = Joint::named("L5S1").unwrap().index();
    let state = |cycle: u64| {
        let mut state =
            State { cycle, time_ns: cycle * 10_000_000, suit_sample_time_ns: 1, ..State::zeroed() };
        (state.lifts, state.worst_joint) = (u32::from(cycle >= 650), joint as u32);
        if cycle >= 600 {
            state.valid = Validity::BELOW_LOAD_THRESHOLD.0;
            return state;
        }
        (state.lifted_mass_kg, state.reach_m) = (12.0, 0.5);
        (state.torque_nm[joint], state.torque_limit_nm[joint]) = ([0.0, 90.0, 0.0], 100.0);
        (state.torque_sigma_nm[joint], state.joint_level[joint]) = (4.0, Level::Red as u32);
        (state.l5s1_compression_n, state.l5s1_compression_sigma_n) = (4000.0, 200.0);
        for side in Side::BOTH {
            state.segment_origin_m[side.toe().index()] = [0.2, 0.0, 0.0];
            state.segment_origin_m[side.hand().index()] = [0.5, 0.0, 0.75];
        }
        state
    };
    let all: Vec<State> = (1..900).map(state).collect();
    let page = report("advice.html", &states("advice.mcap", &all, |_| {}));
    for expected in [
        "high or overloaded for 6.0 s, at most 90 % ± 4 % of its limit, with 12.0 kg at 0.50 m. Reduce the load to 8.0 kg",
        "1 of 1 exceed the recommended weight limit; lift 1 most, 1.0 times its limit of 11.5 kg",
        "compression of 4000 ± 200 N at t = 0.0 s exceeds 3400 N",
        "Basis. Joints:",
    ] {
        assert!(page.text.contains(expected), "{expected} is not in {}", page.text);
    }
    assert_eq!(page.rows("Lifts")[0][6..], ["11.5", "1.04"]);
}

#[test]
fn latency_and_adapters_are_reported_where_they_were_recorded() {
    let all: Vec<State> =
        (1..200).map(|cycle| State { cycle, time_ns: cycle * 10_000_000, ..State::zeroed() }).collect();
    let recording = states("path.mcap", &all, |recorder| {
        for cycle in 1..200 {
            let due_ns = cycle * 10_000_000;
            let record = CycleRecord {
                cycle,
                due_ns,
                woken_ns: due_ns + 40_000,
                compute_start_ns: due_ns + 50_000,
                compute_end_ns: due_ns + 60_000,
                publish_start_ns: due_ns + 70_000,
                published_ns: due_ns + 80_000,
                deadline_missed: u32::from(cycle == 100),
                period_ns: 10_000_000,
                ..CycleRecord::zeroed()
            };
            recorder.write(due_ns, &record).unwrap();
        }
        let mut health =
            AdapterHealth { stream: 1, received: 700, published: 690, lost: 3, ..AdapterHealth::zeroed() };
        health.refused[0] = 7;
        recorder.write(1_000_000_000, &health).unwrap();
    });
    let page = report("path.html", &recording);
    near(page.cell("Latency", "loop.wake", "p50"), 40.0, 0.2);
    near(page.cell("Latency", "loop.to_state", "max"), 80.0, 0.2);
    assert!(page.text.contains("1 deadlines missed"), "{}", page.text);
    assert_eq!(page.cell("Sensors", "suit", "lost"), "3");
    assert!(page.cell("Sensors", "suit", "refused").starts_with("7 "));
}

#[test]
fn a_truncated_recording_is_reported_up_to_the_damage() {
    let session = session();
    let bytes = std::fs::read(&session.states).unwrap();
    let (cut, out) = (session.file("cut.mcap"), session.file("cut.html"));
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let ended = equipoise(&["report", text(&cut), "--out", text(&out)]);
    assert_eq!(ended.status.code(), Some(3), "{ended:?}");
    assert!(Page::read(&out).text.contains("the recording was cut short"));
    let itself = equipoise(&["report", text(&session.states), "--out", text(&session.states)]);
    assert_eq!(itself.status.code(), Some(1), "{itself:?}");
    assert_eq!(std::fs::read(&session.states).unwrap(), bytes);
}

#[test]
fn without_chromium_the_page_is_written_and_a_remedy_printed() {
    let session = session();
    let (out, pdf) = (session.file("no-pdf.html"), session.file("no.pdf"));
    let ended = std::process::Command::new(env!("CARGO_BIN_EXE_equipoise"))
        .args(["report", text(&session.states), "--out", text(&out), "--pdf", text(&pdf)])
        .env("PATH", session.file("nothing-here"))
        .env_remove("EQUIPOISE_CHROMIUM")
        .output()
        .unwrap();
    let describe_output = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert_eq!(ended.status.code(), Some(1), "{describe_output}");
    assert!(describe_output.contains("apt install chromium"), "{describe_output}");
    assert!(out.exists() && !pdf.exists());
}
