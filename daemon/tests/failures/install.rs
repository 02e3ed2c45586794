//! The real program installs itself, below a folder that needs no root.

use std::os::unix::fs::PermissionsExt;

use crate::station::Station;

#[test]
fn it_installs_a_program_that_runs_and_takes_it_away_again() {
    let station = Station::new();
    let root = station.file("root");
    let below = root.display().to_string();
    let arguments = ["install", "--root", &below, "--prefix", "/opt/equipoise"];
    let installed = station.run(&arguments);
    assert!(installed.done().contains("installed /opt/equipoise/bin/equipoise"));
    assert!(installed.done().contains("next: systemd-sysusers"), "{}", installed.stdout);
    let program = root.join("opt/equipoise/bin/equipoise");
    assert_eq!(program.metadata().expect("the program").permissions().mode() & 0o777, 0o755);
    let configuration = root.join("etc/equipoise/equipoise.toml");
    let mut check = std::process::Command::new(&program);
    let checked = check.arg("check").arg(&configuration).output().expect("the installed program runs");
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
    assert!(!station.run(&arguments).done().contains("installed "), "a second time does nothing");

    let uninstall = ["uninstall", "--root", &below, "--prefix", "/opt/equipoise"];
    assert!(station.run(&uninstall).done().contains("removed /opt/equipoise/bin/equipoise"));
    assert!(!program.exists() && configuration.exists());
    assert!(station.run(&["uninstall", "--root", &below]).done().contains("left /etc/equipoise"));
}

#[test]
fn what_cannot_be_written_is_said_with_what_to_do() {
    let station = Station::new();
    let file = station.write("file", "no folder").display().to_string();
    station.run(&["install", "--root", &file]).failed_with(1, &["cannot write", &file, "--root"]);
    station.run(&["install", "--prefix", "here"]).failed_with(1, &["--prefix here", "absolute"]);
}
