//! Invalid configurations and command lines.

use crate::station::Station;

#[test]
fn an_unknown_key_is_named_with_file_line_and_nearest_key() {
    let station = Station::new();
    let wrong = station.configuration().replace("height_m", "heigth_m");
    let line = 1 + wrong.lines().position(|line| line.starts_with("heigth_m")).expect("the wrong line");
    let path = station.write("wrong.toml", &wrong).display().to_string();
    let message = format!("{path}, line {line}: `heigth_m` is not known; did you mean `height_m`?");
    station.run(&["check", &path]).assert_failed(1, &[&message]);
    station.run(&["run", "--config", &path]).assert_failed(1, &[&message]);
    station.run(&["adapter", "suit", "--config", &path]).assert_failed(1, &[&message]);

    let wrong = station.configuration().replace("rate_hz = 200", "rate_hz = 5000");
    let path = station.write("range.toml", &wrong).display().to_string();
    let message = format!("{path}, line 3: loop.rate_hz: 5000 is not between 100 and 4000");
    station.run(&["check", &path]).assert_failed(1, &[&message]);
}

#[test]
fn a_valid_configuration_is_ok_and_what_runs_with_it_is_listed() {
    let station = Station::new();
    let gateways = "[gateways.udp]\nto = [\"127.0.0.1:7411\"]\n[gateways.mqtt]\nbroker = \"localhost\"\n";
    let page = "[page]\nlisten = \"127.0.0.1:8080\"\n";
    let path =
        station.write("right.toml", &(station.configuration() + page + gateways)).display().to_string();
    let checked = station.run(&["check", &path]);
    let lines: Vec<&str> = checked.assert_done().lines().collect();
    let (suit, plate) = (station.suit, station.plate);
    let expected = [
        format!("{path}: OK"),
        "  station    bench".to_owned(),
        "  loop       200 Hz, priority 0".to_owned(),
        format!("  suit       mvn-udp, suit.listen = {suit}"),
        format!("  ground     ati-rdt, ground.address = {plate}"),
        "  subject    anon-1, 1.77 m, 72 kg".to_owned(),
        "  model      none".to_owned(),
        "  page       127.0.0.1:8080 (`equipoise view`)".to_owned(),
        "  gateway    udp, 127.0.0.1:7411".to_owned(),
        "  gateway    mqtt, localhost:1883".to_owned(),
    ];
    assert_eq!(lines, expected);
    let external = station.configuration().replace("\"mvn-udp\"", "\"external\"");
    let path = station.write("external.toml", &external).display().to_string();
    let checked = station.run(&["check", &path]);
    assert!(checked.assert_done().contains("  suit       external, published by another process"));
    assert!(checked.stdout.contains("  gateway    none"), "{}", checked.stdout);
}

#[test]
fn missing_and_binary_files_are_reported() {
    let station = Station::new();
    for command in [&["check"][..], &["run", "--config"], &["adapter", "ground", "--config"]] {
        let missing = [command, &["/nowhere/e.toml"]].concat();
        station.run(&missing).assert_failed(
            1,
            &["cannot read the configuration /nowhere/e.toml", "No such file", "name an existing file"],
        );
    }
    let existing = station.write("right.toml", &station.configuration()).display().to_string();
    let missing = station.file("rihgt.toml").display().to_string();
    station.run(&["check", &missing]).assert_failed(1, &[&format!("name an existing file: {existing}")]);
    let path = station.file("binary.toml");
    std::fs::write(&path, [0xff, 0xfe, 0x00, 0x80]).expect("a file");
    station.run(&["check", &path.display().to_string()]).assert_failed(1, &["binary.toml", "UTF-8"]);
    let path = station.write("empty.toml", "").display().to_string();
    station.run(&["check", &path]).assert_failed(1, &[&path, "missing field"]);
    station.run(&["check", "/dev/zero"]).assert_failed(1, &["/dev/zero", "no regular file"]);
    station.run(&["check", "/tmp"]).assert_failed(1, &["cannot read the configuration /tmp"]);
}

#[test]
fn wrong_usage_ends_with_2_and_a_message() {
    let station = Station::new();
    for arguments in [
        &[][..],
        &["fly"],
        &["run"],
        &["check"],
        &["identify", "perhaps"],
        &["adapter", "shoe", "--config", "x"],
        &["status", "--jsno"],
        &["subject", "load"],
        &["latency", "--for", "soon"],
        &["simulate", "--suit", "nowhere"],
        &["simulate", "--play", "x.csv", "--seed", "2"],
    ] {
        let ended = station.run(arguments);
        ended.assert_failed(2, &["--help"]);
        assert!(ended.stdout.is_empty(), "{arguments:?} prints to standard output: {}", ended.stdout);
    }
}

/// Names of the commands in the help.
fn commands(station: &Station) -> Vec<String> {
    let help = station.run(&["--help"]);
    let commands: Vec<String> = help
        .assert_done()
        .lines()
        .skip_while(|line| !line.starts_with("Commands:"))
        .skip(1)
        .take_while(|line| line.starts_with("  "))
        .filter_map(|line| line.split_whitespace().next().map(str::to_owned))
        .filter(|command| command != "help")
        .collect();
    assert!(commands.len() >= 11, "{commands:?}");
    commands
}

#[test]
fn every_command_s_help_shows_an_example() {
    let station = Station::new();
    for command in commands(&station) {
        let help = station.run(&[&command, "--help"]);
        let example = format!("equipoise {command}");
        assert!(
            help.assert_done().split("Example").nth(1).is_some_and(|rest| rest.contains(&example)),
            "{command}: {}",
            help.stdout
        );
    }
}

#[test]
fn every_command_has_completions_and_a_man_page() {
    let station = Station::new();
    let (commands, pages) = (commands(&station), station.file("man"));
    station.run(&["man-pages", &pages.display().to_string()]).assert_done();
    for command in &commands {
        let page = pages.join(format!("equipoise-{command}.1"));
        let text = std::fs::read_to_string(&page).unwrap_or_else(|error| panic!("{command}: {error}"));
        assert!(text.contains("Example"), "{text}");
    }
    for shell in ["bash", "zsh", "fish"] {
        let completions = station.run(&["completions", shell]);
        let script = completions.assert_done();
        assert!(commands.iter().all(|command| script.contains(command.as_str())), "{shell}: {script}");
    }
    let file = station.write("file", "no directory").display().to_string();
    station.run(&["man-pages", &file]).assert_failed(1, &["cannot write man pages", &file]);
}

/// Runs a command whose standard output and error are written to nothing that reads them.
fn without_reader(station: &Station, arguments: &[&str]) -> (Option<i32>, String) {
    let err = station.file("closed.err");
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let mut command = station.command(arguments);
    command.stdout(writer).stderr(std::fs::File::create(&err).expect("a file"));
    let code = command.status().expect("it starts").code();
    (code, std::fs::read_to_string(&err).expect("text"))
}

#[test]
fn a_closed_output_does_not_change_what_a_command_does() {
    let station = Station::new();
    let path = station.write("c.toml", &station.configuration()).display().to_string();
    assert_eq!(without_reader(&station, &["check", &path]), (Some(0), String::new()));
    let subjects = station.state_directory().join("subjects");
    std::fs::create_dir_all(&subjects).expect("a folder");
    std::fs::write(subjects.join("a.toml"), "damaged").expect("a file");
    std::fs::write(subjects.join("b.toml"), "damaged").expect("a file");
    let (code, message) = without_reader(&station, &["subject", "list"]);
    assert!(
        code == Some(3) && message.contains("a.toml") && message.contains("b.toml"),
        "{code:?} {message}"
    );
    // Each deleted file is listed, and all are deleted although nothing can be printed.
    std::fs::write(subjects.join("a.lifts.csv"), "").expect("a file");
    let (code, message) = without_reader(&station, &["subject", "delete", "a"]);
    assert_eq!((code, message.contains("panicked")), (Some(0), false), "{message}");
    let left: Vec<_> =
        std::fs::read_dir(&subjects).expect("a folder").flatten().map(|file| file.file_name()).collect();
    assert_eq!(left, ["b.toml"]);
    let key = station.file("recording.key").display().to_string();
    assert_eq!(without_reader(&station, &["record", "--new-key", &key]), (Some(0), String::new()));
    // A failed check stays a failure: the suit's port is taken.
    let _taken = std::net::UdpSocket::bind(station.suit).expect("the suit's port");
    let doctor = ["doctor", "--config", &path];
    assert_eq!((without_reader(&station, &doctor).0, station.run(&doctor).code), (Some(1), Some(1)));

    // Output that is lost for another reason is an error.
    let full = || std::fs::OpenOptions::new().write(true).open("/dev/full").expect("/dev/full");
    let mut command = station.command(&["check", &path]);
    let output = command.stdout(full()).output().expect("it starts");
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("cannot write to standard output"));
    let mut command = station.command(&["check", "/tmp"]);
    assert_eq!(command.stdout(full()).stderr(full()).status().expect("it starts").code(), Some(1));
}
