use super::*;
use bytemuck::Zeroable;
use equipoise_core::body::{Joint, Segment};
use equipoise_core::message::state::Phase;
use equipoise_core::message::{CycleRecord, Incident, Validity};
use equipoise_latency::PathHistograms;
use ratatui::Terminal;
use ratatui::backend::TestBackend;

const SIZES: [(u16, u16); 6] = [(40, 12), (60, 20), (79, 24), (80, 24), (120, 40), (200, 60)];

fn carrying() -> State {
    let mut state = State::zeroed();
    (state.cycle, state.phase, state.converged, state.poses_used) = (4242, Phase::Monitoring as u32, 1, 9);
    state.predicted_cop_sigma_m = 0.0062;
    (state.suit_sample_time_ns, state.suit_age_ns, state.ground_age_ns) = (1, 12_000_000, 3_000_000);
    state.group_delay_ns = 70_000_000;
    state.delta_f_n = [0.0, 0.0, 98.0665];
    (state.lifted_mass_kg, state.lifted_mass_sigma_kg) = (10.0, 0.3);
    (state.l5s1_compression_n, state.l5s1_compression_sigma_n) = (2410.0, 390.0);
    (state.lifts, state.dose_damage, state.dose_probability) = (12, 1e-4, 0.07);
    state.torque_limit_nm = [100.0; _];
    for (name, torque_nm, level) in [("RightElbow", 41.0, 2), ("RightHip", 12.0, 1), ("LeftKnee", 73.0, 3)] {
        let index = Joint::named(name).unwrap().index();
        (state.torque_nm[index], state.joint_level[index]) = ([0.0, torque_nm, 0.0], level);
        state.torque_sigma_nm[index] = 4.0;
        state.worst_joint = index as u32;
    }
    state.fatigue[Joint::named("LeftKnee").unwrap().index()] = 0.31;
    let places = [
        (Segment::LeftFoot, [0.0, 0.1, 0.1]),
        (Segment::LeftToe, [0.15, 0.12, 0.02]),
        (Segment::RightFoot, [0.0, -0.1, 0.1]),
        (Segment::RightToe, [0.15, -0.12, 0.02]),
        (Segment::LeftHand, [0.3, 0.2, 1.0]),
        (Segment::RightHand, [0.3, -0.2, 1.0]),
    ];
    for (segment, origin_m) in places {
        state.segment_origin_m[segment.index()] = origin_m;
    }
    state.cop_measured_m = [0.08, 0.05];
    (state.cop_estimated_m, state.cop_sigma_m) = ([0.03, -0.06], [0.005, 0.006]);
    state
}

fn empty() -> Watch<'static> {
    Watch {
        station: "station-1",
        subject: "anon-1",
        state: None,
        stopped: None,
        silent_s: None,
        headline: None,
        pose: None,
        sensors: &[],
        incidents: None,
        latency: None,
        now_ns: 20_000_000_000,
        help: false,
    }
}

/// Draws the screen and returns its lines.
fn drawn(watch: &Watch<'_>, (width, height): (u16, u16)) -> Vec<String> {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| draw(frame, watch)).unwrap();
    let buffer = terminal.backend().buffer();
    let row = |y| (0..width).map(|x| buffer[(x, y)].symbol()).collect::<String>().trim_end().to_owned();
    (0..height).map(row).collect()
}

fn shows(lines: &[String], text: &str) -> bool {
    lines.iter().any(|line| line.contains(text))
}

#[track_caller]
fn place(lines: &[String], text: &str) -> usize {
    lines
        .iter()
        .position(|line| line.contains(text))
        .unwrap_or_else(|| panic!("{text:?} is not in\n{}", lines.join("\n")))
}

#[test]
fn at_every_size_it_says_what_to_do_and_which_joint_is_worst() {
    let state = carrying();
    let watch = Watch { state: Some(&state), ..empty() };
    for size in SIZES {
        let lines = drawn(&watch, size);
        assert!(shows(&lines, "Load monitoring"), "{size:?}\n{}", lines.join("\n"));
        place(&lines, "Left knee: high load");
        let (knee, elbow, hip) =
            (place(&lines, " left knee  "), place(&lines, " right elbow  "), place(&lines, " right hip  "));
        assert!(knee < elbow && elbow < hip, "{size:?}\n{}", lines.join("\n"));
        assert!(lines[knee].contains("high") && lines[knee].contains("73"), "{}", lines[knee]);
        assert!(lines[elbow].contains("medium") && lines[elbow].contains("41"), "{}", lines[elbow]);
        place(&lines, "load 98 N (10.0 ± 0.3 kg)");
        place(&lines, "q quit");
    }
}

#[test]
fn bars_are_as_long_as_the_torque_over_its_limit() {
    let state = carrying();
    let lines = drawn(&Watch { state: Some(&state), ..empty() }, (200, 60));
    let full = |name: &str| lines[place(&lines, name)].chars().filter(|c| *c == '█').count();
    let (knee, elbow, hip) = (full(" left knee  "), full(" right elbow  "), full(" right hip  "));
    assert_eq!((knee, elbow, hip), (21, 12, 3), "of 30 columns: 73, 41 and 12 %");
}

#[test]
fn what_is_withheld_is_on_no_screen() {
    let mut state = carrying();
    state.valid = Validity::GROUND_STALE.0;
    for size in SIZES {
        let lines = drawn(&Watch { state: Some(&state), ..empty() }, size);
        place(&lines, "The force plate is silent");
        place(&lines, "Overload: withheld");
        for invalid in ["73", "98 N", "2410", "10.0"] {
            assert!(!shows(&lines, invalid), "{invalid} at {size:?}\n{}", lines.join("\n"));
        }
        let measured = lines.iter().any(|line| line.contains('+'));
        assert!(!measured, "the plate's CoP at {size:?}\n{}", lines.join("\n"));
    }
    let lines = drawn(&Watch { state: Some(&state), ..empty() }, (120, 40));
    place(&lines, "ground  silent");
    // Fatigue stays valid while other values are withheld.
    assert!(lines[place(&lines, "% tired")].contains("left knee"));
}

#[test]
fn while_the_daemon_is_silent_nothing_of_it_is_shown() {
    let mut incidents = Incidents::zeroed();
    incidents.active = 1 << Incident::SuitSilent as u32;
    let watch = Watch { silent_s: Some(7.4), incidents: Some(&incidents), ..empty() };
    for size in SIZES {
        let lines = drawn(&watch, size);
        place(&lines, "The daemon is silent");
        place(&lines, "Nothing has come for 7 s");
        assert!(!shows(&lines, "Overload") && !shows(&lines, "suit_silent"), "{}", lines.join("\n"));
    }
    place(&drawn(&empty(), (80, 24)), "Nothing has come from station station-1 yet.");
    let stopped = Watch { stopped: Some(4711), ..empty() };
    place(&drawn(&stopped, (80, 24)), "Its process 4711 is stopped: `kill -CONT 4711`");
}

#[test]
fn sensors_incidents_and_latency_are_shown_where_there_is_room() {
    let state = carrying();
    let sensors = [
        Sensor { name: "suit", rate_hz: 60.0, lost: 3, refused: vec![("stale", 2)] },
        Sensor { name: "ground", rate_hz: 1000.0, lost: 0, refused: vec![] },
    ];
    let mut incidents = Incidents::zeroed();
    for (kind, begun_ns) in [(Incident::DeadlineMissed, 10_000_000_000), (Incident::NotSaved, 8_000_000_000)]
    {
        incidents.active |= 1 << kind as u32;
        incidents.last_begun_ns[kind as usize] = begun_ns;
    }
    let mut path = PathHistograms::new();
    for cycle in 1..=100 {
        let due_ns = cycle * 1_000_000;
        path.record(&CycleRecord {
            cycle,
            due_ns,
            woken_ns: due_ns + 50_000,
            compute_start_ns: due_ns + 60_000,
            compute_end_ns: due_ns + 70_000,
            publish_start_ns: due_ns + 80_000,
            published_ns: due_ns + 250_000,
            period_ns: 1_000_000,
            ..CycleRecord::zeroed()
        });
    }
    let report = Report::of(&path);
    let watch = Watch {
        state: Some(&state),
        sensors: &sensors,
        incidents: Some(&incidents),
        latency: Some(&report),
        ..empty()
    };
    let lines = drawn(&watch, (120, 40));
    place(&lines, "suit     12 ms old, 60 Hz, 3 lost, 2 stale");
    place(&lines, "ground    3 ms old, 1000 Hz, 0 lost");
    place(&lines, "values are 70 ms behind the suit");
    place(&lines, "deadline_missed for 10 s");
    place(&lines, "not_saved for 12 s");
    place(&lines, "late awake         0.050    0.050    0.050");
    place(&lines, "100 cycles, 0 deadlines missed, 0 slots skipped");
    let small = drawn(&watch, (40, 12));
    place(&small, "deadline_missed for 10 s (and 1 more)");
}

#[test]
fn the_plate_has_left_on_the_left_and_forward_up() {
    let state = carrying();
    let lines = drawn(&Watch { state: Some(&state), ..empty() }, (120, 40));
    let top = place(&lines, "Plate, forward is up");
    let at = |mark: char| {
        lines.iter().enumerate().skip(top + 1).find_map(|(y, line)| {
            let x = line.chars().enumerate().skip(67).find(|(_, c)| *c == mark)?.0;
            Some((x, y))
        })
    };
    let (measured, estimated) = (at('+').expect("+"), at('o').expect("o"));
    assert!(measured.0 < estimated.0 && measured.1 < estimated.1, "{measured:?} {estimated:?}");
    assert!(lines.iter().any(|line| line.chars().any(|c| ('\u{2801}'..='\u{28ff}').contains(&c))), "feet");
}

#[test]
fn help_covers_whatever_stands_below_it_and_no_size_is_too_small() {
    let state = carrying();
    for size in SIZES.into_iter().chain([(1, 1), (7, 3), (300, 2), (20, 100)]) {
        let (mut watch, silent) = (Watch { state: Some(&state), ..empty() }, empty());
        drawn(&silent, size);
        drawn(&watch, size);
        watch.help = true;
        let lines = drawn(&watch, size);
        assert!(size.0 < 40 || size.1 < 12 || shows(&lines, "q, Esc, Ctrl-C   quit"));
    }
}
