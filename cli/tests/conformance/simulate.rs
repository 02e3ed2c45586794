//! `equipoise simulate --ground` of the real program: its output is a configuration, and the data that it sends match
//! it.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use equipoise_simulator::GRAVITY_M_PER_S2;
use equipoise_simulator::ports::free_address;

use crate::host::{Host, Sample};

/// Time limit of every wait.
const TIMEOUT: Duration = Duration::from_secs(90);
const MASS_KG: f64 = 72.0;

/// Ends the program that it started, and no other.
struct Program(Child);

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Starts the program; returns the section that it prints.
fn started(arguments: &[&str]) -> (Program, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_equipoise"));
    command
        .args([
            "simulate",
            "--suit",
            &free_address().unwrap().to_string(),
            "--mass-kg",
            "72",
            "--for",
            "60",
            "--ground",
        ])
        .args(arguments);
    let mut child =
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::inherit()).spawn().unwrap();
    let message = BufReader::new(child.stdout.take().unwrap());
    let program = Program(child);
    let lines = message.lines().map(Result::unwrap).skip(1).take_while(|line| line != "Ctrl-C ends");
    let section = lines.map(|line| line + "\n").collect();
    (program, section)
}

/// The mean weight of the first samples with the printed configuration.
fn weight_n(arguments: &[&str]) -> Result<f64, String> {
    let (_program, section) = started(arguments);
    let mut host = Host::open(section.trim_start())?;
    let (mut newtons, started) = (Vec::new(), Instant::now());
    while newtons.len() < 200 {
        newtons.extend(host.receive()?.into_iter().filter_map(|sample| match sample {
            Sample::Ground(sample) => Some(sample.force_n[2]),
            Sample::Suit(_) => None,
        }));
        if started.elapsed() > TIMEOUT {
            return Err(format!("{} samples, {:?}\n{section}", newtons.len(), host.fault()));
        }
    }
    Ok(newtons.iter().sum::<f64>() / newtons.len() as f64)
}

#[test]
fn every_device_can_be_simulated_from_the_command_line() {
    let folder = tempfile::tempdir().unwrap();
    let name = |end: &str| folder.path().join(end).display().to_string();
    let any = || "127.0.0.1:0".to_owned();
    let spawned: Vec<Vec<String>> = [
        vec!["ati-rdt".into(), any()],
        vec!["ati-rdt".into(), any(), "--two".into()],
        vec!["amti-serial".into(), name("amti")],
        vec!["bota-serial".into(), name("bota")],
        vec!["kistler-labamp".into(), any()],
        vec!["tec-gihan".into(), name("tec-gihan")],
        vec!["moticon-udp".into(), free_address().unwrap().to_string()],
        vec!["qtm".into(), any()],
        vec!["lsl".into(), any()],
        vec!["text".into(), format!("udp:{}", free_address().unwrap())],
        vec!["binary".into(), name("binary")],
    ]
    .into();
    let threads: Vec<_> = spawned
        .into_iter()
        .map(|mut arguments: Vec<String>| {
            arguments.insert(1, "--ground-address".into());
            std::thread::spawn(move || {
                let weight_n = weight_n(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
                (arguments.join(" "), weight_n)
            })
        })
        .collect();
    for spawned in threads {
        let (arguments, weight_n) = spawned.join().unwrap();
        let weight_n = weight_n.unwrap_or_else(|error| panic!("{arguments}: {error}"));
        // The human moves between poses; on average the ground carries the weight.
        let weight_ratio = weight_n / (MASS_KG * GRAVITY_M_PER_S2);
        assert!((0.9..1.1).contains(&weight_ratio), "{arguments}: {weight_n} N");
    }
}
