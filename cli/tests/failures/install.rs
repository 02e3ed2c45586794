//! The real program installs itself, below a folder that needs no root.

use std::io::ErrorKind;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::process::wait_for;
use crate::station::Station;

/// The program with a daemon next to it, as after a build of both; the daemon is not started here.
fn built(station: &Station) -> PathBuf {
    let program = station.file("built/equipoise");
    std::fs::create_dir_all(station.file("built")).expect("a folder");
    std::fs::copy(env!("CARGO_BIN_EXE_equipoise"), &program).expect("a copy of the program");
    std::fs::write(program.with_file_name("equipoise-daemon"), "a daemon").expect("a file");
    program
}

/// Runs a copy of the program. A process that another test has just started holds it open for writing until it executes
/// its own program.
fn output(command: &mut Command) -> Output {
    wait_for("the copy to be closed", || match command.output() {
        Err(error) if error.kind() == ErrorKind::ExecutableFileBusy => None,
        ended => Some(ended.expect("the program runs")),
    })
}

fn run(program: &Path, arguments: &[&str]) -> String {
    let ended = output(Command::new(program).args(arguments));
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    String::from_utf8_lossy(&ended.stdout).into_owned()
}

#[test]
fn install_and_uninstall_of_a_running_program() {
    let station = Station::new();
    let (built, root) = (built(&station), station.file("root"));
    let below = root.display().to_string();
    let arguments = ["install", "--root", &below, "--prefix", "/opt/equipoise"];
    let installed = run(&built, &arguments);
    assert!(installed.contains("installed /opt/equipoise/bin/equipoise\n"), "{installed}");
    assert!(installed.contains("installed /opt/equipoise/bin/equipoise-daemon\n"), "{installed}");
    assert!(installed.contains("next: systemd-sysusers"), "{installed}");
    let unit = std::fs::read_to_string(root.join("etc/systemd/system/equipoise.service")).expect("the unit");
    assert!(unit.contains("ExecStart=/opt/equipoise/bin/equipoise-daemon --sensors-apart"), "{unit}");
    let program = root.join("opt/equipoise/bin/equipoise");
    assert_eq!(program.metadata().expect("the program").permissions().mode() & 0o777, 0o755);
    let configuration = root.join("etc/equipoise/equipoise.toml");
    let mut check = Command::new(&program);
    let checked = output(check.arg("check").arg(&configuration));
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
    assert!(!run(&built, &arguments).contains("installed "), "a second time does nothing");

    let uninstall = ["uninstall", "--root", &below, "--prefix", "/opt/equipoise"];
    assert!(station.run(&uninstall).assert_done().contains("removed /opt/equipoise/bin/equipoise"));
    assert!(!program.exists() && configuration.exists());
    assert!(station.run(&["uninstall", "--root", &below]).assert_done().contains("left /etc/equipoise"));
}

#[test]
fn write_errors_are_reported_with_a_remedy() {
    let station = Station::new();
    let file = station.write("file", "no folder").display().to_string();
    let refused = output(Command::new(built(&station)).args(["install", "--root", &file]));
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(1), "{message}");
    assert!(["cannot write", &file, "--root"].iter().all(|part| message.contains(part)), "{message}");
    station.run(&["install", "--prefix", "here"]).assert_failed(1, &["--prefix here", "absolute"]);
}
