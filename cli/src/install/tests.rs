use std::fs;
use std::os::unix::fs::PermissionsExt;

use super::*;

fn at(prefix: &str, root: &Path) -> Destination {
    Destination::new(Path::new(prefix), root).unwrap()
}

/// A program to install, with the daemon next to it.
fn program(directory: &Path) -> PathBuf {
    let path = directory.join("program");
    fs::write(&path, "a program").unwrap();
    fs::write(directory.join(DAEMON), "a daemon").unwrap();
    path
}

/// All files and links below a folder, with their permissions.
fn all(folder: &Path) -> Vec<(PathBuf, u32)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if entry.file_type().unwrap().is_dir() {
            found.extend(all(&path));
        } else {
            let mode = fs::symlink_metadata(&path).unwrap().permissions().mode() & 0o777;
            found.push((path, mode));
        }
    }
    found.sort();
    found
}

#[test]
fn all_files_are_installed_once_and_uninstalled() {
    let directory = tempfile::tempdir().unwrap();
    let (program, root) = (program(directory.path()), directory.path().join("root"));
    let destination = at("/usr/local", &root);
    let done = install(&destination, &program, true).unwrap();
    assert!(done.contains(&"installed /usr/local/bin/equipoise".to_owned()), "{done:?}");
    assert!(done.contains(&"enabled equipoise-view.service".to_owned()), "{done:?}");
    let first = all(&root);
    assert_eq!(first.len(), 15, "{first:?}");
    for (path, mode) in &first {
        let is_program = path.ends_with("bin/equipoise") || path.ends_with("bin/equipoise-daemon");
        let expected = if is_program { 0o755 } else { 0o644 };
        assert!(*mode == expected || path.is_symlink(), "{} {mode:o}", path.display());
    }
    let link = root.join("etc/systemd/system/multi-user.target.wants/equipoise.service");
    assert_eq!(
        fs::read_link(link).unwrap(),
        Path::new("/usr/local/lib/systemd/system/equipoise.service"),
        "as it is seen when it runs"
    );

    for stream in ["suit", "ground"] {
        let link = format!("etc/systemd/system/equipoise.service.wants/equipoise-adapter@{stream}.service");
        let target = Path::new("/usr/local/lib/systemd/system/equipoise-adapter@.service");
        assert_eq!(fs::read_link(root.join(link)).unwrap(), target, "{stream} has a unit of its own");
    }

    let again = install(&destination, &program, true).unwrap();
    assert!(!again.iter().any(|line| line.starts_with("installed")), "{again:?}");
    assert_eq!(all(&root), first);

    // Foreign files remain: a drop-in, a subject, the configuration.
    let worker = root.join("var/lib/equipoise/subjects/anon-1.toml");
    let drop_in = root.join("etc/systemd/system/equipoise.service.d/serial.conf");
    let certificate = root.join("var/lib/equipoise-gateways/opcua/own/cert.der");
    for file in [&worker, &drop_in, &certificate] {
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(file, "mine").unwrap();
    }
    let metrics = root.join("etc/systemd/system/equipoise.service.wants/equipoise-metrics.service");
    std::os::unix::fs::symlink("/usr/local/lib/systemd/system/equipoise-metrics.service", &metrics).unwrap();
    let done = uninstall(&destination).unwrap();
    assert!(done.iter().any(|line| line.starts_with("left /var/lib/equipoise")), "{done:?}");
    let remaining: Vec<_> = all(&root).into_iter().map(|(path, _)| path).collect();
    assert_eq!(remaining, [root.join("etc/equipoise/equipoise.toml"), drop_in, worker, certificate]);
    assert!(!uninstall(&destination).unwrap().iter().any(|line| line.starts_with("removed")));
}

#[test]
fn nothing_is_installed_without_the_daemon() {
    let directory = tempfile::tempdir().unwrap();
    let (program, root) = (program(directory.path()), directory.path().join("root"));
    fs::remove_file(directory.path().join(DAEMON)).unwrap();
    let refused = format!("{:#}", install(&at("/usr/local", &root), &program, true).unwrap_err());
    assert!(refused.contains("cargo build --release -p equipoise-daemon"), "{refused}");
    assert!(all(&root).is_empty());
}

#[test]
fn programs_in_its_folder_are_installed_and_others_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    let (program, root) = (program(directory.path()), directory.path().join("root"));
    let destination = at("/opt/equipoise", &root);
    let gateway = directory.path().join("equipoise-gateway-opcua");
    fs::write(&gateway, "a server").unwrap();
    fs::write(directory.path().join("equipoise-study"), "no part of the service").unwrap();
    let done = install(&destination, &program, false).unwrap();
    assert!(done.contains(&"installed /opt/equipoise/bin/equipoise-gateway-opcua".to_owned()), "{done:?}");
    let absent = done.iter().find(|line| line.starts_with("not installed")).unwrap();
    for name in PROGRAMS {
        assert_eq!(absent.contains(name), name != "equipoise-gateway-opcua", "{name}: {absent}");
    }
    assert!(absent.contains("cargo build --release -p NAME"), "{absent}");
    let installed = root.join("opt/equipoise/bin/equipoise-gateway-opcua");
    assert_eq!(fs::read_to_string(&installed).unwrap(), "a server");
    assert_eq!(installed.metadata().unwrap().permissions().mode() & 0o777, 0o755);
    assert!(!root.join("opt/equipoise/bin/equipoise-study").exists());

    // A remaining program may be of another release.
    fs::remove_file(&gateway).unwrap();
    let done = install(&destination, &program, false).unwrap();
    assert!(done.iter().any(|line| line.contains("bin/equipoise-gateway-opcua stays")), "{done:?}");
    assert!(installed.exists());

    let done = uninstall(&destination).unwrap();
    assert!(done.contains(&"removed /opt/equipoise/bin/equipoise-gateway-opcua".to_owned()), "{done:?}");
    assert!(all(&root.join("opt")).is_empty(), "{:?}", all(&root.join("opt")));
}

#[test]
fn gateways_of_the_configuration_are_named_with_what_starts_them_and_none_is_enabled() {
    let directory = tempfile::tempdir().unwrap();
    let (program, root) = (program(directory.path()), directory.path().join("root"));
    let destination = at("/usr/local", &root);
    let of_gateways = |done: Vec<String>| -> Vec<String> {
        done.into_iter()
            .filter(|line| line.contains("[gateways.") || line.contains("gateways were"))
            .collect()
    };
    assert_eq!(of_gateways(install(&destination, &program, true).unwrap()), [""; 0], "the sample has none");

    let configuration = root.join("etc/equipoise/equipoise.toml");
    let gateways =
        "[gateways.udp]\nto = [\"127.0.0.1:7411\"]\n[gateways.opcua]\nlisten = \"127.0.0.1:4840\"\n";
    fs::write(&configuration, format!("{CONFIGURATION}\n{gateways}")).unwrap();
    let enable_udp = "[gateways.udp] is configured: systemctl enable --now equipoise-gateway@udp";
    let build_opcua = "[gateways.opcua] needs equipoise-gateway-opcua, which is not installed: see above";
    assert_eq!(of_gateways(install(&destination, &program, true).unwrap()), [enable_udp, build_opcua]);
    let wants = root.join("etc/systemd/system/equipoise.service.wants");
    assert_eq!(all(&wants).len(), 3, "both sensors and the page: {:?}", all(&wants));

    fs::write(directory.path().join("equipoise-gateway-opcua"), "a server").unwrap();
    let enabled = wants.join("equipoise-gateway@udp.service");
    std::os::unix::fs::symlink("/usr/local/lib/systemd/system/equipoise-gateway@.service", &enabled).unwrap();
    let enable_opcua = "[gateways.opcua] is configured: systemctl enable --now equipoise-gateway@opcua";
    assert_eq!(of_gateways(install(&destination, &program, true).unwrap()), [enable_opcua]);

    let old_unit = root.join("usr/local/lib/systemd/system/equipoise-outlet@.service");
    fs::write(&old_unit, "[Service]\n").unwrap();
    let done = install(&destination, &program, true).unwrap();
    assert!(done.iter().any(|line| line.starts_with("note: equipoise-gateway@ replaces")), "{done:?}");

    fs::write(&configuration, "station = 1\n").unwrap();
    let done = of_gateways(install(&destination, &program, true).unwrap());
    assert!(done.len() == 1 && done[0].starts_with("note: gateways were not checked"), "{done:?}");
    uninstall(&destination).unwrap();
    assert!(!enabled.is_symlink());
}

#[test]
fn an_existing_configuration_is_never_changed() {
    let directory = tempfile::tempdir().unwrap();
    let (program, root) = (program(directory.path()), directory.path().join("root"));
    let configuration = root.join("etc/equipoise/equipoise.toml");
    fs::create_dir_all(configuration.parent().unwrap()).unwrap();
    fs::write(&configuration, "station = \"mine\"\n").unwrap();
    for _ in 0..2 {
        let done = install(&at("/usr/local", &root), &program, false).unwrap();
        assert!(done.iter().any(|line| line.starts_with("kept /etc/equipoise/equipoise.toml")), "{done:?}");
        assert_eq!(fs::read_to_string(&configuration).unwrap(), "station = \"mine\"\n");
        assert_eq!(fs::read_to_string(root.join("etc/equipoise/equipoise.toml.new")).unwrap(), CONFIGURATION);
    }
    assert!(!root.join("etc/systemd/system/multi-user.target.wants").exists(), "not asked to enable");
}

#[test]
fn units_name_the_prefix_and_are_in_a_search_path_of_systemd() {
    let directory = tempfile::tempdir().unwrap();
    let program = program(directory.path());
    for (prefix, units) in [
        ("/usr/local", "usr/local/lib/systemd/system"),
        ("/usr/", "usr/lib/systemd/system"),
        ("/opt/equipoise-1.0", "etc/systemd/system"),
    ] {
        let root = directory.path().join(units.replace('/', "-"));
        install(&at(prefix, &root), &program, false).unwrap();
        for (name, _) in UNITS {
            let text = fs::read_to_string(root.join(units).join(name)).unwrap();
            let program = if name == "equipoise.service" { DAEMON } else { "equipoise" };
            let start = format!("ExecStart={}/bin/{program} ", prefix.trim_end_matches('/'));
            assert!(text.lines().any(|line| line.starts_with(&start)), "{prefix} {name}");
            assert!(prefix == "/usr/local" || !text.contains("/usr/local"), "{prefix} {name}");
        }
    }
}

#[test]
fn a_prefix_that_a_unit_cannot_name_is_refused() {
    for wrong in ["", "usr", "/opt/my tools", "/opt/../etc", "/opt/%n", "/opt/\"x"] {
        assert!(Destination::new(Path::new(wrong), Path::new("/")).is_err(), "{wrong}");
    }
}

#[test]
fn no_link_leads_out_of_the_root() {
    let directory = tempfile::tempdir().unwrap();
    let (program, root) = (program(directory.path()), directory.path().join("root"));
    let outside = directory.path().join("outside");
    for folder in [&root, &outside] {
        fs::create_dir(folder).unwrap();
    }
    fs::write(outside.join("equipoise.toml"), "theirs").unwrap();
    let destination = at("/usr/local", &root);
    for (link, target) in [
        ("usr", outside.clone()),
        ("etc", outside.clone()),
        ("etc/equipoise/equipoise.toml", outside.join("x")),
    ] {
        let link = root.join(link);
        fs::create_dir_all(link.parent().unwrap()).unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        let refused = install(&destination, &program, true).unwrap_err().to_string();
        assert!(refused.contains("is a link"), "{refused}");
        assert_eq!(all(&outside).len(), 1, "{:?}", all(&outside));
        fs::remove_file(&link).unwrap();
    }
    // Neither a link at the temporary file's path nor one at the file's own path is followed.
    let bin = root.join("usr/local/bin");
    fs::create_dir_all(&bin).unwrap();
    std::os::unix::fs::symlink(outside.join("equipoise.toml"), bin.join("equipoise.part")).unwrap();
    install(&destination, &program, false).unwrap();
    assert_eq!(fs::read_to_string(outside.join("equipoise.toml")).unwrap(), "theirs");
    assert_eq!(fs::read_to_string(bin.join("equipoise")).unwrap(), "a program");
}

#[test]
fn files_of_another_prefix_are_not_removed() {
    let directory = tempfile::tempdir().unwrap();
    let (program, root) = (program(directory.path()), directory.path().join("root"));
    let (foreign, own) = (at("/opt/theirs", &root), at("/opt/ours", &root));
    install(&foreign, &program, true).unwrap();
    let before = all(&root);
    let done = uninstall(&own).unwrap();
    assert!(
        done.iter().any(|line| line.starts_with("left /etc/systemd/system/equipoise.service")),
        "{done:?}"
    );
    assert!(!done.iter().any(|line| line.starts_with("removed")), "{done:?}");
    assert_eq!(all(&root), before);
    // A link to another unit of the same name remains; ours is removed, although its target is relative.
    let wants = root.join("etc/systemd/system/multi-user.target.wants");
    let (other, relative) =
        (wants.join("equipoise-view.service"), wants.join("equipoise-adapter@suit.service"));
    std::os::unix::fs::symlink("/usr/lib/systemd/system/equipoise-view.service", &other).unwrap();
    std::os::unix::fs::symlink("../equipoise-adapter@.service", &relative).unwrap();
    uninstall(&foreign).unwrap();
    let remaining: Vec<_> = all(&root).into_iter().map(|(path, _)| path).collect();
    assert_eq!(remaining, [root.join("etc/equipoise/equipoise.toml"), other]);
}

#[test]
fn overriding_units_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    let (program, root) = (program(directory.path()), directory.path().join("root"));
    let admin_unit = root.join("etc/systemd/system/equipoise.service");
    fs::create_dir_all(admin_unit.parent().unwrap()).unwrap();
    fs::write(&admin_unit, "").unwrap();
    let done = install(&at("/usr/local", &root), &program, false).unwrap();
    assert!(
        done.last().unwrap().contains("/etc/systemd/system/equipoise.service overrides the installed unit")
    );
}

#[test]
fn the_embedded_configuration_is_valid() {
    equipoise_config::Config::parse(CONFIGURATION, "the sample").unwrap();
}
