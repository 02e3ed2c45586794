//! The real program installs itself, below a folder that needs no root.

use std::os::unix::fs::PermissionsExt;

use crate::station::Station;

#[test]
fn install_and_uninstall_of_a_running_program() {
    let station = Station::new();
    let root = station.file("root");
    let below = root.display().to_string();
    let arguments = ["install", "--root", &below, "--prefix", "/opt/equipoise"];
    let installed = station.run(&arguments);
    assert!(installed.assert_done().contains("installed /opt/equipoise/bin/equipoise"));
    assert!(installed.assert_done().contains("next: systemd-sysusers"), "{}", installed.stdout);
    let program = root.join("opt/equipoise/bin/equipoise");
    assert_eq!(program.metadata().expect("the program").permissions().mode() & 0o777, 0o755);
    let configuration = root.join("etc/equipoise/equipoise.toml");
    let mut check = std::process::Command::new(&program);
    let checked = check.arg("check").arg(&configuration).output().expect("the installed program runs");
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
    assert!(!station.run(&arguments).assert_done().contains("installed "), "a second time does nothing");

    let uninstall = ["uninstall", "--root", &below, "--prefix", "/opt/equipoise"];
    assert!(station.run(&uninstall).assert_done().contains("removed /opt/equipoise/bin/equipoise"));
    assert!(!program.exists() && configuration.exists());
    assert!(station.run(&["uninstall", "--root", &below]).assert_done().contains("left /etc/equipoise"));
}

#[test]
fn write_errors_are_reported_with_a_remedy() {
    let station = Station::new();
    let file = station.write("file", "no folder").display().to_string();
    station.run(&["install", "--root", &file]).assert_failed(1, &["cannot write", &file, "--root"]);
    station.run(&["install", "--prefix", "here"]).assert_failed(1, &["--prefix here", "absolute"]);
}
