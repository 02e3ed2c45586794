//! Recordings of a loop driven by the test, cycle by cycle: complete parts are replayed exactly, and missing ones are
//! reported with their start.

use std::path::{Path, PathBuf};

use bytemuck::Zeroable;
use equipoise_adapters::recording::{Recorder, RecordingHeader, Reloaded};
use equipoise_config::{Config, similar};
use equipoise_core::body::{SEGMENTS, Skeleton};
use equipoise_core::cycle::Checkpoint;
use equipoise_core::cycle::memory::MEMORY_VERSION;
use equipoise_core::cycle::{Inputs, Memory, Settings, Similar, Tare, Tick, step};
use equipoise_core::message::{CommandKind, CycleRecord, GroundSample, State, SuitSample};
use equipoise_core::sesc::PARAMETERS;
use equipoise_recording::replay::input::Input;
use equipoise_recording::replay::{Replay, Summary};

use crate::common::{describe_output, equipoise};

pub(crate) const CONFIG: &str = r#"
station = "test"
[suit]
source = "mvn-udp"
[ground]
source = "ati-rdt"
counts_per_newton = 1000000
counts_per_newton_metre = 1000000
[subject]
id = "anon-1"
height_m = 1.77
"#;
const START_NS: u64 = 5_000_000_000;
pub(crate) const CYCLES: u64 = 1500;

/// All published messages of a run.
#[derive(Default)]
pub(crate) struct Live {
    pub(crate) cycles: Vec<CycleRecord>,
    pub(crate) states: Vec<State>,
    checkpoints: Vec<Box<Checkpoint>>,
    suit: Vec<SuitSample>,
    ground: Vec<GroundSample>,
    pub(crate) format: u64,
    header: RecordingHeader,
    /// The recorder's data on reloads.
    reloads: Vec<(u64, Reloaded)>,
    /// Cycles after which the recorder attached the profile of another subject, and its pseudonym.
    pub(crate) subjects: Vec<(u64, &'static str)>,
}

/// The number of a reload in cycle 900.
const RELOAD: u64 = 123_456_789;

/// Its content: a shorter window, and therefore other states.
fn reloaded_toml() -> String {
    format!("{CONFIG}[overload]\nmotion_window_ms = 50.0\n")
}

/// A slightly swaying worker. Checkpoints are taken after the named cycles, commands given before them.
pub(crate) fn live(checkpoint_after: &[u64], commands: &[(u64, CommandKind)]) -> Live {
    live_with(&Tare::zeroed(), checkpoint_after, commands)
}

/// The same on a plate that was tared before.
pub(crate) fn live_with(tare: &Tare, checkpoint_after: &[u64], commands: &[(u64, CommandKind)]) -> Live {
    live_of([CONFIG, &reloaded_toml()], None, tare, checkpoint_after, commands)
}

/// The same with the configurations before and after a reload, and the similar subject of both.
fn live_of(
    configs: [&str; 2],
    similar: Option<Similar>,
    tare: &Tare,
    checkpoint_after: &[u64],
    commands: &[(u64, CommandKind)],
) -> Live {
    let settings_of = |text: &str| Settings { similar, ..Config::parse(text, "test").unwrap().settings() };
    let (mut settings, mut settings_number) = (settings_of(configs[0]), 0);
    let mut memory = bytemuck::zeroed_box::<Memory>();
    memory.start(&settings);
    memory.resume_tare(tare);
    let mut live = Live {
        format: MEMORY_VERSION,
        header: RecordingHeader {
            config_toml: configs[0].to_owned(),
            software_version: "9.9.9".to_owned(),
            started_monotonic_ns: START_NS,
            similar_toml: similar::to_toml(similar.as_ref()),
            ..RecordingHeader::default()
        },
        ..Live::default()
    };
    for cycle in 1..=CYCLES {
        let due_ns = START_NS + cycle * 1_000_000;
        let sway_m = 0.002 * (cycle as f64 * 1e-3).sin();
        let mut record = CycleRecord { cycle, due_ns, period_ns: 1_000_000, ..CycleRecord::zeroed() };
        let mut suit = Vec::new();
        if cycle % 17 == 0 {
            suit.push(suit_sample(cycle / 17, due_ns - 700_000, sway_m));
            record.suit_taken = 1;
            record.suit_first = cycle / 17;
            record.suit_last = cycle / 17;
            record.suit_sample_time_ns = suit[0].sample_time_ns;
        }
        // Every other cycle ingests two.
        let mut ground: Vec<GroundSample> = Vec::new();
        if cycle % 2 == 0 {
            ground.extend([cycle - 1, cycle].map(|sequence| ground_sample(sequence, sway_m)));
            record.ground_taken = 2;
            record.ground_first = cycle - 1;
            record.ground_last = cycle;
            record.ground_sample_time_ns = ground[1].sample_time_ns;
        }
        let command = commands.iter().find(|(at, _)| *at == cycle).map(|(_, command)| *command);
        record.command = command.map_or(0, |command| command as u32);
        if command == Some(CommandKind::SubjectLoad) {
            // As in the live loop: the subject is replaced as a whole.
            memory.identification.mass_kg = 81.5;
        }
        if command == Some(CommandKind::Reload) {
            settings = settings_of(configs[1]);
            record.command_argument[0] = RELOAD as f64;
            settings_number = RELOAD;
        }
        let inputs = Inputs { suit: &suit, ground: &ground, body: None, command };
        live.states.push(*step(&settings, &mut memory, Tick { cycle, due_ns }, inputs));
        live.cycles.push(record);
        live.suit.extend(suit);
        live.ground.extend(ground);
        if checkpoint_after.contains(&cycle) {
            let mut checkpoint = bytemuck::zeroed_box::<Checkpoint>();
            checkpoint.take(cycle, &memory);
            checkpoint.settings_number = settings_number;
            live.checkpoints.push(checkpoint);
        }
    }
    live
}

fn suit_sample(sequence: u64, sample_time_ns: u64, sway_m: f64) -> SuitSample {
    SuitSample {
        sample_time_ns,
        published_ns: sample_time_ns + 200_000,
        arrival_ns: sample_time_ns + 100_000,
        sequence,
        position_m: Skeleton::nominal(1.77).t_pose_m().map(|[x, y, z]| [x + sway_m, y, z + 0.96]),
        orientation_wxyz: [[1.0, 0.0, 0.0, 0.0]; SEGMENTS],
        ..SuitSample::zeroed()
    }
}

fn ground_sample(sequence: u64, sway_m: f64) -> GroundSample {
    GroundSample {
        sample_time_ns: START_NS + sequence * 1_000_000 - 300_000,
        published_ns: START_NS + sequence * 1_000_000 - 100_000,
        sequence,
        force_n: [0.0, 0.0, 706.0],
        moment_nm: [0.0, -706.0 * (0.05 + sway_m), 0.0],
        ..GroundSample::zeroed()
    }
}

impl Live {
    /// Writes it as the recorder does: in bursts, stream by stream.
    fn record(&self, directory: &Path) -> PathBuf {
        let path = directory.join("live.mcap");
        let _ = std::fs::remove_file(&path);
        let mut recorder = Recorder::create(&path, &self.header).unwrap();
        for (number, reloaded) in &self.reloads {
            recorder.add_reload(START_NS, *number, reloaded).unwrap();
        }
        for (cycle, id) in &self.subjects {
            let profile = format!("subject = \"{id}\"\n");
            recorder.add_subject(START_NS + cycle * 1_000_000, &profile).unwrap();
        }
        for burst in 0..CYCLES / 10 {
            let of_burst = |time_ns: u64| (time_ns - START_NS) / 10_000_000 == burst;
            for record in self.cycles.iter().filter(|record| of_burst(record.due_ns)) {
                recorder.write(record.due_ns, record).unwrap();
            }
            for state in self.states.iter().filter(|state| of_burst(state.time_ns)) {
                recorder.write(state.time_ns, state).unwrap();
            }
            for checkpoint in self.checkpoints.iter().filter(|one| one.cycle / 10 == burst) {
                let mut checkpoint = checkpoint.clone();
                checkpoint.memory_version = self.format;
                recorder.write(START_NS + burst * 10_000_000, &*checkpoint).unwrap();
            }
            for sample in self.suit.iter().filter(|sample| of_burst(sample.published_ns)) {
                recorder.write(sample.published_ns, sample).unwrap();
            }
            for sample in self.ground.iter().filter(|sample| of_burst(sample.published_ns)) {
                recorder.write(sample.published_ns, sample).unwrap();
            }
        }
        recorder.finish().unwrap();
        path
    }

    fn replay(&self) -> anyhow::Result<(Summary, Vec<State>)> {
        let directory = tempfile::tempdir().unwrap();
        replay(&self.record(directory.path()))
    }

    /// With a given configuration.
    pub(crate) fn replay_with(&self, config: &str) -> (Summary, Vec<State>) {
        let directory = tempfile::tempdir().unwrap();
        let input = Input::open(&self.record(directory.path())).unwrap();
        run(&input, &Config::parse(config, "test").unwrap(), false).unwrap()
    }
}

fn replay(path: &Path) -> anyhow::Result<(Summary, Vec<State>)> {
    let input = Input::open(path)?;
    let chosen = input.configuration(None)?;
    run(&input, &chosen.config, true)
}

fn run(input: &Input, config: &Config, as_recorded: bool) -> anyhow::Result<(Summary, Vec<State>)> {
    let replay = Replay { input, config, as_recorded, residual_s: None };
    let mut states = Vec::new();
    let summary = replay.run_with(|state| {
        states.push(*state);
        Ok(())
    })?;
    Ok((summary, states))
}

#[test]
fn a_whole_recording_gives_the_same_states_byte_for_byte() {
    let commands = [(700, CommandKind::IdentifyStop), (900, CommandKind::IdentifyStart)];
    let live = live(&[101, 700, 900], &commands);
    let (summary, states) = live.replay().unwrap();
    let fidelity = summary.fidelity.clone().unwrap();
    assert!(summary.is_complete() && fidelity.is_exact(), "{summary}");
    // Cycle 1500 would begin another burst and is not in the file.
    assert_eq!((fidelity.cycles, fidelity.before_checkpoint), (CYCLES - 1 - 101, 101));
    assert_eq!((fidelity.states_compared, fidelity.states_differing), (fidelity.cycles, 0));
    assert_eq!((fidelity.memories_compared, fidelity.memories_differing), (2, 0));
    assert!(
        bytemuck::cast_slice::<State, u8>(&states)
            == bytemuck::cast_slice::<State, u8>(&live.states[101..1499])
    );
    assert!(states.iter().any(|state| state.com_m[2] > 0.5), "there is a body in it");
}

#[test]
fn a_state_that_was_tampered_with_is_found() {
    let mut live = live(&[101], &[]);
    live.states[800].cop_measured_m[0] += 1e-15;
    let (summary, _) = live.replay().unwrap();
    let fidelity = summary.fidelity.clone().unwrap();
    assert_eq!((fidelity.states_differing, fidelity.first_differing), (1, Some(801)), "{summary}");
    assert!(!summary.is_complete());
}

#[test]
fn missing_cycles_are_reported_and_a_later_checkpoint_restores_exactness() {
    let mut live = live(&[101, 1000], &[]);
    live.cycles.drain(600..605);
    let (summary, _) = live.replay().unwrap();
    let fidelity = summary.fidelity.clone().unwrap();
    assert_eq!((fidelity.cycles_missing, fidelity.uncertain_from), (5, Some(606)), "{summary}");
    // From 606 to 999; cycle 1000 has its checkpoint.
    assert_eq!((fidelity.uncertain, fidelity.resumed, fidelity.states_differing), (394, 1, 0), "{summary}");
    assert_eq!(fidelity.states_compared, 499 + 1000 - 500, "{summary}");
    assert!(!summary.is_complete());
}

#[test]
fn an_export_and_a_report_of_an_inexact_replay_have_exit_code_3() {
    let directory = tempfile::tempdir().unwrap();
    let (table, page) = (directory.path().join("table.csv"), directory.path().join("page.html"));
    let mut live = live(&[101], &[]);
    live.states.clear();
    for (is_complete, code) in [(true, 0), (false, 3)] {
        if !is_complete {
            live.cycles.drain(600..605);
        }
        let recording = live.record(directory.path());
        for (command, out) in [("export", &table), ("report", &page)] {
            let _ = std::fs::remove_file(out);
            let output = equipoise().arg(command).arg(&recording).arg("--out").arg(out).output().unwrap();
            let message = describe_output(&output);
            assert_eq!(output.status.code(), Some(code), "{command}: {message}");
            assert_eq!(message.contains("cycle records are missing"), !is_complete, "{command}: {message}");
        }
    }
    let mut with_config = equipoise();
    with_config.arg("export").arg(directory.path().join("live.mcap")).arg("--out").arg(&table);
    let output = with_config.args(["--topic", "ground", "--config", "none.toml"]).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", describe_output(&output));
    assert!(describe_output(&output).contains("leave one of them out"), "{}", describe_output(&output));
}

#[test]
fn missing_samples_are_reported() {
    let mut live = live(&[101], &[]);
    live.ground.retain(|sample| sample.sequence != 801);
    let (summary, _) = live.replay().unwrap();
    let fidelity = summary.fidelity.clone().unwrap();
    assert_eq!((fidelity.cycles_lacking_samples, fidelity.uncertain_from), (1, Some(802)), "{summary}");
    assert!(summary.to_string().contains("not exact from cycle 802"), "{summary}");
}

#[test]
fn a_loaded_subject_is_read_from_the_checkpoint_of_the_same_cycle() {
    let with = live(&[101, 800], &[(800, CommandKind::SubjectLoad)]);
    let (summary, states) = with.replay().unwrap();
    assert!(summary.is_complete(), "{summary}");
    assert_eq!(states.last().unwrap().mass_kg, 81.5);

    let without = live(&[101], &[(800, CommandKind::SubjectLoad)]);
    let (summary, _) = without.replay().unwrap();
    assert_eq!(summary.fidelity.unwrap().uncertain_from, Some(800));
}

#[test]
fn a_reload_is_replayed_with_its_configuration_and_without_it_the_replay_stops() {
    let mut live = live(&[101, 1200], &[(900, CommandKind::Reload)]);
    let reloaded = Reloaded { config_toml: reloaded_toml(), ..Reloaded::default() };
    live.reloads.push((RELOAD, reloaded.clone()));
    let (summary, states) = live.replay().unwrap();
    let fidelity = summary.fidelity.clone().unwrap();
    assert!(summary.is_complete() && fidelity.is_exact(), "{summary}");
    assert_eq!((fidelity.reloads, fidelity.memories_compared), (1, 1));
    assert_eq!(states.last().unwrap().group_delay_ns, live.states.last().unwrap().group_delay_ns);
    assert_ne!(states[500].group_delay_ns, states[1390].group_delay_ns, "the reload changed something");

    live.reloads = vec![(RELOAD + 1, reloaded)];
    let (summary, states) = live.replay().unwrap();
    let fidelity = summary.fidelity.clone().unwrap();
    assert_eq!((fidelity.unknown_settings_at, fidelity.states_differing), (Some(900), 0), "{summary}");
    assert_eq!(states.last().unwrap().cycle, 899);
    assert!(!summary.is_complete() && summary.to_string().contains("stopped at cycle 900"), "{summary}");
}

#[test]
fn a_similar_subject_in_the_prior_is_replayed_before_and_after_a_reload() {
    let (deviation_m, variance_m2) = ([2e-3; PARAMETERS], [1e-6; PARAMETERS]);
    let similar = Similar { deviation_m, variance_m2, likeness: 0.7 };
    let prior = "[identification]\nprior = \"similar-subject\"\n";
    let configs = [format!("{CONFIG}{prior}"), format!("{}{prior}", reloaded_toml())];
    let commands = [(900, CommandKind::Reload), (1000, CommandKind::IdentifyReset)];
    let texts = [&*configs[0], &*configs[1]];
    let mut live = live_of(texts, Some(similar), &Tare::zeroed(), &[101], &commands);
    let (config_toml, similar_toml) = (configs[1].clone(), live.header.similar_toml.clone());
    live.reloads.push((RELOAD, Reloaded { config_toml, similar_toml, ..Reloaded::default() }));
    let replay = |live: &Live| live.replay().unwrap().0.fidelity.unwrap();
    assert!(replay(&live).is_exact(), "{}", replay(&live));
    live.reloads[0].1.similar_toml.clear();
    let first_differing = replay(&live).first_differing;
    assert!(
        first_differing.is_some_and(|cycle| cycle >= 900),
        "the prior has an effect: {first_differing:?}"
    );
    live.header.similar_toml.clear();
    let first_differing = replay(&live).first_differing;
    assert!(first_differing.is_some_and(|cycle| cycle < 900), "the prior has an effect: {first_differing:?}");
}

#[test]
fn a_reload_whose_cycle_record_is_missing_is_found_in_the_next_checkpoint() {
    let mut live = live(&[101, 1000], &[(900, CommandKind::Reload)]);
    live.cycles.drain(895..905);
    live.reloads.push((RELOAD, Reloaded { config_toml: reloaded_toml(), ..Reloaded::default() }));
    let (summary, _) = live.replay().unwrap();
    let fidelity = summary.fidelity.clone().unwrap();
    assert_eq!((fidelity.reloads, fidelity.resumed, fidelity.states_differing), (1, 1, 0), "{summary}");
    assert!(fidelity.states_compared > 1200, "{summary}");

    live.reloads.clear();
    let (summary, _) = live.replay().unwrap();
    let fidelity = summary.fidelity.clone().unwrap();
    assert_eq!((fidelity.unknown_settings_at, fidelity.states_differing), (Some(1000), 0), "{summary}");
}

#[test]
fn a_replay_stops_at_a_restart_of_the_daemon_whose_configuration_is_unknown() {
    let mut live = live(&[101, 901], &[]);
    // Cycles from 901 on belong to another daemon, which numbers its cycles from 1.
    let renumbered = |cycle: u64| if cycle > 900 { cycle - 900 } else { cycle };
    live.cycles.iter_mut().for_each(|record| record.cycle = renumbered(record.cycle));
    live.states.iter_mut().for_each(|state| state.cycle = renumbered(state.cycle));
    let (summary, states) = live.replay().unwrap();
    let fidelity = summary.fidelity.clone().unwrap();
    assert_eq!((fidelity.unknown_daemon_at, fidelity.states_differing), (Some(1), 0), "{summary}");
    assert_eq!((fidelity.restarts, states.last().unwrap().cycle), (1, 900), "{summary}");
    assert!(!summary.is_complete() && summary.to_string().contains("of a restarted daemon"), "{summary}");
}

#[test]
fn a_checkpoint_of_another_version_is_refused_with_what_to_do() {
    let mut live = live(&[101], &[]);
    live.format = MEMORY_VERSION + 1;
    let error = live.replay().unwrap_err().to_string();
    assert!(
        error.contains("another version") && error.contains("9.9.9") && error.contains("--config"),
        "{error}"
    );
}

#[test]
fn without_a_checkpoint_it_is_replayed_from_an_empty_memory_and_reported() {
    let (summary, states) = live(&[], &[]).replay().unwrap();
    // From the first cycle that took a sample.
    assert_eq!(states.len() as u64, CYCLES - 2);
    assert!(!summary.is_complete() && summary.to_string().contains("no checkpoint"), "{summary}");
}

#[test]
fn a_trace_of_a_recording_cut_short_has_exit_code_3() {
    let directory = tempfile::tempdir().unwrap();
    let path = live(&[101], &[]).record(directory.path());
    let whole = std::fs::read(&path).unwrap();
    for (cut, code) in [(0, 0), (9, 3)] {
        std::fs::write(&path, &whole[..whole.len() - cut]).unwrap();
        let out = directory.path().join(format!("{cut}.json"));
        let output = equipoise().arg("trace").arg(&path).arg("-o").arg(&out).output().unwrap();
        assert_eq!(output.status.code(), Some(code), "{}", describe_output(&output));
        assert!(out.exists());
    }
}

#[test]
fn a_recording_cut_anywhere_is_read_up_to_the_cut() {
    let directory = tempfile::tempdir().unwrap();
    let path = live(&[101], &[]).record(directory.path());
    let whole = std::fs::read(&path).unwrap();
    for twelfths in 1..12 {
        let cut = directory.path().join("cut.mcap");
        std::fs::write(&cut, &whole[..whole.len() * twelfths / 12]).unwrap();
        // An error message or a summary that reports it; never a panic, never a false difference.
        if let Ok((summary, _)) = replay(&cut) {
            assert!(!summary.is_complete(), "{summary}");
            assert_eq!(summary.fidelity.map_or(0, |fidelity| fidelity.states_differing), 0);
        }
        let mut damaged = whole.clone();
        let at = damaged.len() * twelfths / 12;
        damaged[at..at + 3].fill(0xa5);
        std::fs::write(&cut, &damaged).unwrap();
        let _ = replay(&cut);
    }
}
