//! The whole daemon in real time, at 1 kHz, while everything around it joins and leaves.
//!
//! The daemon's threads run in this process, so that their allocator can be armed, and on a separate bus, so that
//! leftovers are detectable. Both require a separate process: the test starts this file again ([`inside`]).

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use equipoise_cli::page_feed::ServedPage;
use equipoise_config::Config;
use equipoise_daemon::pipeline::Pipeline;
use equipoise_simulator::ports::free_address;
use equipoise_station::proc::{MemoryUse, TaskFacts};

use crate::churn::Churn;
use crate::consumers::Storm;
use crate::process::{Process, TIMEOUT, wait_for};
use crate::station::{NAME, Station};
use crate::{Watch, number};

/// Folder of the test's files; set for [`inside`] only.
const DIRECTORY: &str = "STEADY_DIRECTORY";
/// Two seconds, in which the loop has processed sensors, consumers and commands.
const WARM_CYCLES: u64 = 2000;
/// Time limit beyond the requested duration.
const LATER_AT_MOST: Duration = Duration::from_secs(240);

#[test]
fn the_loop_is_steady_while_everything_around_it_comes_and_goes() {
    let station = Station::new();
    let mut again = Command::new(std::env::current_exe().expect("this test"));
    again.args(["--exact", "under_churn::inside", "--ignored", "--nocapture", "--test-threads=1"]);
    again.env("EQUIPOISE_BUS_ROOT", station.root()).env("STATE_DIRECTORY", station.state_directory());
    again.env("EQUIPOISE_STATION", NAME).env(DIRECTORY, station.file(""));
    let mut inside = Process::start(again, station.file("inside.out"), station.file("inside.err"));
    let patience = Duration::from_secs(seconds()) + LATER_AT_MOST;
    let started = Instant::now();
    while inside.is_running() && started.elapsed() < patience {
        std::thread::sleep(Duration::from_millis(50));
    }
    assert!(!inside.is_running(), "it does not end");
    print!("{}", inside.stdout());
    assert!(inside.wait().success(), "{}\n{}", inside.stdout(), inside.stderr());
    assert!(inside.stdout().contains("1 passed"), "{}", inside.stdout());
    let left = left_of_the_bus(&station);
    assert!(left.is_empty(), "left behind: {left:?}");
}

fn seconds() -> u64 {
    number("STEADY_SECONDS", 8)
}

/// Remaining shared memory, except the small files that iceoryx2 keeps permanently, one per version.
fn left_of_the_bus(station: &Station) -> Vec<PathBuf> {
    let is_kept = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "global_mgmt");
    let is_shared_memory = |path: &PathBuf| path.starts_with("/dev/shm");
    station.files_of_the_bus().into_iter().filter(|path| is_shared_memory(path) && !is_kept(path)).collect()
}

fn config(page: std::net::SocketAddr) -> Config {
    let text = format!(
        "station = \"{NAME}\"\n[loop]\nrate_hz = 1000\n[suit]\nsource = \"mvn-udp\"\nlisten = \"{}\"\n[ground]\n\
         source = \"ati-rdt\"\naddress = \"{}\"\ncounts_per_newton = 1e6\ncounts_per_newton_metre = 1e6\n[subject]\n\
         id = \"t\"\nheight_m = 1.77\n[identification]\nposes_min = 2\nstop_cop_sigma_mm = 20\n[page]\nlisten = \
         \"{page}\"\n",
        free_address().expect("a free port"),
        free_address().expect("a free port")
    );
    Config::parse(&text, "the suite's configuration").expect("a good configuration")
}

/// Open descriptors of this process; those closed during the reading are left out.
fn descriptors() -> Vec<PathBuf> {
    let entries = std::fs::read_dir("/proc/self/fd").expect("this process");
    entries.flatten().filter_map(|entry| std::fs::read_link(entry.path()).ok()).collect()
}

fn wait_for_descriptors(before: &[PathBuf]) {
    let started = Instant::now();
    loop {
        let now = descriptors();
        if now.len() <= before.len() {
            return;
        }
        let new: Vec<&PathBuf> = now.iter().filter(|path| !before.contains(path)).collect();
        assert!(
            started.elapsed() < TIMEOUT,
            "{} descriptors were open, now {}: {new:#?}",
            before.len(),
            now.len()
        );
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Files of the bus's participants, dead or alive.
fn nodes() -> usize {
    fn below(directory: &Path) -> usize {
        let entries = std::fs::read_dir(directory).into_iter().flatten().flatten();
        entries.map(|entry| if entry.path().is_dir() { below(&entry.path()) } else { 1 }).sum()
    }
    below(&equipoise_bus::root::root_of_environment().join("nodes"))
}

fn faults(the_loop: i32) -> [u64; 2] {
    let facts = TaskFacts::read(the_loop).expect("the loop's thread");
    [facts.minor_faults, facts.major_faults]
}

/// Started by the test above, in a separate process and on a separate bus.
#[test]
#[ignore = "a process of the suite: the test of the same file starts it"]
fn inside() {
    let Some(directory) = std::env::var_os(DIRECTORY).map(PathBuf::from) else {
        panic!("run the_loop_is_steady_while_everything_around_it_comes_and_goes");
    };
    let watch = Watch::after(WARM_CYCLES);
    let config = config(free_address().expect("a free port"));
    let pipeline = Pipeline::start_observed(&config, Box::new(watch.clone())).expect("a pipeline");
    let the_loop = pipeline.threads().iter().find(|thread| thread.thread == "loop").expect("a loop").clone();
    println!("loop: {:?}, asked {:?}; memory: {:?}", the_loop.granted, the_loop.asked, MemoryUse::read());

    let (storm, churn, stop) = (Storm::default(), Churn::default(), AtomicBool::new(false));
    let (mut warm_faults, mut cycles_before) = ([0; 2], 0);
    let page = config.page.as_ref().expect("a page");
    let plate = config.ground.address.expect("a plate");
    let _served = ServedPage::start(&config, page, Path::new("")).expect("a page that is served");
    let (before, after) = std::thread::scope(|scope| {
        let _stop = Stop(&stop);
        scope.spawn(|| churn.sensors(config.suit.listen, plate, &stop));
        wait_for("the loop to be warm", || (watch.armed_cycles() > 0).then_some(()));
        let before = (descriptors(), nodes());
        scope.spawn(|| storm.run(&directory, &stop));
        scope.spawn(|| churn.page(&page.listen, &stop));
        scope.spawn(|| churn.recorder(&directory, &stop));
        scope.spawn(|| churn.commands(NAME, &stop));
        (warm_faults, cycles_before) = (faults(the_loop.id), watch.armed_cycles());
        wait_until_enough(&storm, &pipeline);
        (before, faults(the_loop.id))
    });
    // The daemon clears away processes killed last, with its check once a second.
    let (descriptors_before, nodes_before) = before;
    wait_for_descriptors(&descriptors_before);
    println!(
        "{} small files of killed participants are not cleared away yet",
        nodes().saturating_sub(nodes_before)
    );
    watch.disarm.store(true, Ordering::Relaxed);
    let armed_cycles = watch.armed_cycles() - cycles_before;
    let locked = MemoryUse::read();
    let summary = pipeline.stop().expect("an orderly end");

    let faults = [0, 1].map(|kind| after[kind] - warm_faults[kind]);
    let (allocations, frees) = watch.touched();
    println!(
        "{armed_cycles} armed cycles: {allocations} allocations, {frees} frees, {faults:?} minor and major faults of the \
         loop; {storm:?}; {churn:?}; {:?}",
        summary.cycles
    );
    assert_eq!((allocations, frees), (0, 0), "the loop touched the heap");
    if locked.is_locked() {
        assert_eq!(faults, [0, 0], "minor and major page faults after the warm-up");
    } else {
        println!("page faults are not checked: this user may not lock memory");
    }
    assert!(summary.cycles.adds_up, "{:?}", summary.cycles);
    assert!(churn.sensor_drops.into_inner() > 0 && churn.page_loads.into_inner() > 0, "no churn");
    let [recorders, recordings] =
        [&churn.recorders, &churn.recordings].map(|count| count.load(Ordering::Relaxed));
    assert!(recordings > 0 && 2 * recordings >= recorders, "{recordings} of {recorders} recorders recorded");
    let [joined, turned_away] =
        [&storm.joined, &storm.turned_away].map(|count| count.load(Ordering::Relaxed));
    assert!(joined > turned_away, "{turned_away} consumers found no place, {joined} did");
    assert!(churn.commands.into_inner() > 0, "no churn");
}

/// Ends the churn, also on a panic.
struct Stop<'a>(&'a AtomicBool);

impl Drop for Stop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Waits for the required duration and number of consumers. A daemon that ends by itself ends the wait.
fn wait_until_enough(storm: &Storm, pipeline: &Pipeline) {
    let (started, wanted) = (Instant::now(), number("STEADY_CONSUMERS", 10));
    let long = Duration::from_secs(seconds());
    while started.elapsed() < long || storm.joined.load(Ordering::Relaxed) < wanted {
        assert!(pipeline.is_running(), "a part of the daemon has ended");
        assert!(started.elapsed() < long + LATER_AT_MOST / 2, "too few consumers: {storm:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
}
