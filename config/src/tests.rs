use super::*;

pub(super) const SMALLEST: &str = r#"
station = "station-1"
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

fn refusal(text: &str) -> String {
    Config::parse(text, "c.toml").expect_err("must be refused").to_string()
}

#[test]
fn the_smallest_file_has_defaults_for_the_rest() {
    let config = Config::parse(SMALLEST, "c.toml").unwrap();
    assert_eq!(config.tick.rate_hz, 1000);
    assert_eq!(
        config.wait_strategy(),
        WaitStrategy::Sleeping,
        "polling costs cores, so it must be asked for"
    );
    assert_eq!(config.suit.listen.port(), 9763);
    assert!(config.settings().start_identifying);
    let again = Config::parse(&config.to_toml(), "written").unwrap();
    assert_eq!(again, config);
}

#[test]
fn an_unknown_key_is_named_with_its_line_and_the_nearest_key() {
    let message = refusal(&SMALLEST.replace("height_m", "heigth_m"));
    assert!(
        message.starts_with("c.toml, line 11: `heigth_m` is not known; did you mean `height_m`?"),
        "{message}"
    );
    let message = refusal(&SMALLEST.replace("ati-rdt", "ati-rtd"));
    assert!(message.contains("line 6") && message.contains("did you mean `ati-rdt`?"), "{message}");
}

#[test]
fn a_value_out_of_range_is_named_with_its_line() {
    let message = refusal(&SMALLEST.replace("1.77", "177"));
    assert!(
        message.starts_with("c.toml, line 11: subject.height_m: 177 is not between 1 and 2.3"),
        "{message}"
    );
    let counted = SMALLEST.replace("counts_per_newton = 1000000", "");
    assert!(Config::parse(&counted, "c.toml").is_ok(), "the device's own page states it");
    let axia = Config::parse(include_str!("../../examples/sensors/ati-rdt.toml"), "axia.toml").unwrap();
    assert_eq!(axia.ground.ati.unwrap().model, ground::ati_rdt::Model::Axia);
    let message = refusal(&format!("{counted}\n[ground.ati]\npage = false"));
    assert!(message.contains("ground.counts_per_newton: must be given"), "{message}");
    let message = refusal(&format!("{SMALLEST}\n[ground.ati]\nmodel = \"axis\""));
    assert!(message.contains("line 14") && message.contains("did you mean `axia`?"), "{message}");
    let message = refusal(&format!("{SMALLEST}\n[subject.tau_max_nm]\nRightKne = 80"));
    assert!(message.contains("did you mean `RightKnee`?"), "{message}");
}

#[test]
fn a_measurement_without_error_is_refused() {
    for key in ["cop_sigma_mm", "force_sigma_n", "insole_cop_sigma_mm", "insole_force_sigma_n"] {
        let message = refusal(&format!("{SMALLEST}\n[overload]\n{key} = 0"));
        assert!(message.contains(&format!("overload.{key}: 0 is not between 0.1 and")), "{message}");
    }
}

#[test]
fn a_value_of_another_type_is_named_with_its_key_and_line() {
    let cases = [
        (
            "height_m = 1.77",
            "height_m = \"1.77\"",
            "c.toml, line 11: subject.height_m: string \"1.77\" is given where a number",
        ),
        (
            "id = \"anon-1\"",
            "id = 7",
            "c.toml, line 10: subject.id: integer 7 is given where a text in quotation marks",
        ),
        (
            "[ground]",
            "forwarded = [{ avatar = 1.5, station = \"b\" }]\n[ground]",
            "c.toml, line 5: suit.forwarded.avatar: floating point",
        ),
        (
            "\"ati-rdt\"",
            "\"ati-rdt\"\nframe = { origin_m = [0, true, 0] }",
            "c.toml, line 7: ground.frame.origin_m: boolean true is",
        ),
        ("\"mvn-udp\"", "5", "c.toml, line 4: suit.source: "),
    ];
    for (right, wrong, expected) in cases {
        let message = refusal(&SMALLEST.replace(right, wrong));
        assert!(message.starts_with(expected), "{message}");
    }
}

#[test]
fn counts_that_no_device_has_are_refused_with_the_range() {
    for counts in ["1e300", "0", "nan", "inf", "-inf", "-1e6", "0.5"] {
        for key in ["counts_per_newton", "counts_per_newton_metre"] {
            let given = format!("{key} = 1000000\n");
            let message = refusal(&SMALLEST.replace(&given, &format!("{key} = {counts}\n")));
            assert!(message.contains(&format!("ground.{key}: ")), "{message}");
            assert!(message.ends_with("is not between 1 and 1000000000") && message.len() < 100, "{message}");
        }
    }
}

#[test]
fn a_page_for_the_whole_network_needs_a_token() {
    let open = format!("{SMALLEST}\n[page]\nlisten = \"0.0.0.0:80\"");
    assert!(refusal(&open).contains("loopback only"));
    let config = Config::parse(&format!("{open}\ntoken_file = \"page.token\""), "c.toml").unwrap();
    assert!(config.to_toml().contains("token_file = \"page.token\""));
}

#[test]
fn each_receiver_of_datagrams_is_named_once_with_its_address() {
    let to = |addresses: &str| format!("{SMALLEST}[gateways.udp]\nto = [{addresses}]\n");
    assert!(Config::parse(&to("\"192.0.2.17:7411\", \"192.0.2.17:7412\""), "c.toml").is_ok());
    for address in ["192.0.2.17:0", "0.0.0.0:7411", "[::]:7411", "255.255.255.255:7411"] {
        let message = refusal(&to(&format!("\"{address}\"")));
        assert!(message.contains(&format!("gateways.udp.to: {address} is not a unicast")), "{message}");
    }
    let message = refusal(&to("\"192.0.2.17:7411\", \"192.0.2.17:7411\""));
    assert!(message.contains("gateways.udp.to: 192.0.2.17:7411 is listed twice"), "{message}");
}

#[test]
fn a_pose_is_new_only_by_more_than_a_held_one_varies() {
    let with = |keys: &str| format!("{SMALLEST}[static_pose]\n{keys}\n");
    assert!(Config::parse(&with("joint_deg = 7.0"), "c.toml").is_ok());
    for keys in ["joint_deg = 7.1", "new_pose_deg = 0.9"] {
        let message = refusal(&with(keys));
        assert!(message.contains("static_pose.new_pose_deg: ") && message.contains("joint_deg"), "{message}");
    }
}

#[test]
fn a_station_with_a_path_in_its_name_is_refused() {
    assert!(refusal(&SMALLEST.replace("station-1", "../etc")).contains("c.toml, line 2: station:"));
}

#[test]
fn several_suits_share_a_port_with_separate_stations() {
    let with = |keys: &str| SMALLEST.replace("[ground]", &format!("{keys}\n[ground]"));
    let others = "forwarded = [{ avatar = 1, station = \"station-2\" }, { avatar = 4, station = \"c\" }]";
    let config = Config::parse(&with(others), "c.toml").unwrap();
    let settings = config.suit.mvn_settings().unwrap();
    assert_eq!((settings.suit.avatar, settings.others), (0, vec![1, 4]));
    assert_eq!(Config::parse(&config.to_toml(), "written").unwrap(), config);
    let tables = format!("{SMALLEST}[[suit.forwarded]]\navatar = 1\nstation = \"b\"\n");
    assert_eq!(Config::parse(&tables, "c.toml").unwrap().suit.forwarded.len(), 1);

    let twice = refusal(&with(&others.replace("avatar = 4", "avatar = 1")));
    assert!(twice.starts_with("c.toml, line 5: suit.forwarded: avatar 1 is named twice"), "{twice}");
    assert!(refusal(&with(&others.replace("avatar = 4", "avatar = 0"))).contains("avatar 0 is named twice"));
    assert!(refusal(&with(&others.replace("\"c\"", "\"station-2\""))).contains("gets two workers"));
    assert!(refusal(&with(&others.replace("\"c\"", "\"station-1\""))).contains("gets two workers"));
    assert!(refusal(&with(&others.replace("\"c\"", "\"../etc\""))).contains("letters, digits"));
    assert!(refusal(&with(&others.replace("station =", "stations ="))).contains("did you mean `station`?"));
    let external = with(others).replace("mvn-udp", "external");
    assert!(
        refusal(&external).contains("suit.forwarded: with source = \"external\""),
        "{}",
        refusal(&external)
    );
}

#[test]
fn transport_and_up_axis_reach_the_adapter() {
    use equipoise_adapters::source::MvnTransport;
    use equipoise_adapters::suit::UpAxis;
    let settings = |text: &str| Config::parse(text, "c.toml").unwrap().suit.mvn_settings();
    let plain = settings(SMALLEST).unwrap();
    assert_eq!((plain.transport, plain.suit.up), (MvnTransport::Udp, UpAxis::Z));
    let other = SMALLEST.replace("\"mvn-udp\"", "\"mvn-tcp\"\nup_axis = \"y\"");
    let other = settings(&other).unwrap();
    assert_eq!((other.transport, other.suit.up), (MvnTransport::Tcp, UpAxis::Y));
    assert!(settings(&SMALLEST.replace("mvn-udp", "external")).is_err());
    assert!(refusal(&SMALLEST.replace("mvn-udp", "mvn-tpc")).contains("did you mean `mvn-tcp`?"));
}

#[test]
fn a_latency_reaches_adapters_and_cycle_and_is_bounded() {
    let with = |suit_ms: f64, ground_ms: f64| {
        SMALLEST
            .replace("source = \"mvn-udp\"", &format!("source = \"mvn-udp\"\nlatency_ms = {suit_ms:?}"))
            .replace("source = \"ati-rdt\"", &format!("source = \"ati-rdt\"\nlatency_ms = {ground_ms:?}"))
    };
    let config = Config::parse(&with(37.5, 8.0), "c.toml").unwrap();
    assert_eq!(config.suit.settings().latency_ns, 37_500_000);
    assert_eq!(config.ground.settings().latency_ns, 8_000_000);
    let settings = config.settings();
    assert_eq!((settings.suit_latency_ns, settings.ground_latency_ns), (37_500_000, 8_000_000));
    assert_eq!(Config::parse(SMALLEST, "c.toml").unwrap().settings().suit_latency_ns, 0);

    assert!(
        refusal(&with(-1.0, 0.0)).starts_with("c.toml, line 5: suit.latency_ms: -1 is not between 0 and")
    );
    assert!(refusal(&with(1000.5, 1000.0)).contains("suit.latency_ms"));
    assert!(refusal(&with(0.0, 2000.0)).contains("ground.latency_ms"));
    assert!(refusal(&with(510.0, 0.0)).contains("suit.latency_ms: the streams are 510 ms apart"));
    assert!(refusal(&with(0.0, 510.0)).contains("ground.latency_ms: the streams are 510 ms apart"));
    for [suit_ms, ground_ms] in [[1000.0, 950.0], [500.0, 0.0], [0.0, 500.0]] {
        assert!(Config::parse(&with(suit_ms, ground_ms), "c.toml").is_ok(), "{suit_ms} and {ground_ms}");
    }
    // Of 819 ms of ground samples, the window needs 500.
    let wide = |suit_ms: f64| format!("{}[overload]\nmotion_window_ms = 250.0\n", with(suit_ms, 0.0));
    assert!(Config::parse(&wide(310.0), "c.toml").is_ok());
    let message = refusal(&wide(330.0));
    assert!(message.contains("suit.latency_ms: the streams are 330 ms apart"), "{message}");
    assert!(message.contains("overload.motion_window_ms the suit may be 319 ms later"), "{message}");
    assert!(Config::parse(&format!("{}motion = \"paper\"\n", wide(500.0)), "c.toml").is_ok(), "not in use");
}

#[test]
fn missing_keys_have_the_defaults_of_core() {
    let settings = Config::parse(SMALLEST, "c.toml").unwrap().settings();
    let core = Settings { library: settings.library, ..Settings::for_height(1.77) };
    assert_eq!(format!("{settings:?}"), format!("{core:?}"));
}

#[test]
fn a_model_next_to_the_configuration_reaches_the_cycle() {
    let folder = tempfile::tempdir().unwrap();
    let (path, model) = (folder.path().join("c.toml"), folder.path().join("models/m.toml"));
    std::fs::write(&path, format!("{SMALLEST}[model]\nfile = \"models/m.toml\"")).unwrap();
    let message = Config::read(&path).expect_err("there is no model").to_string();
    assert!(
        message.starts_with("[model] file: cannot read the model") && message.contains("models/m.toml"),
        "{message}"
    );
    let without = Config::read_without_model(&path).unwrap();
    assert_eq!((without.model.is_some(), without.loaded_model), (true, None));

    std::fs::create_dir(folder.path().join("models")).unwrap();
    let effect = "[[effect]]\nname = \"plate_offset\"\nspan_s = [0, 1]\nopen_ended = true\nlog_odds = 9.0\n";
    let text =
        format!("version = 1\n{effect}parameters.dx_m = {{ value = 0.01, sigma = 0.001, unit = \"m\" }}\n");
    std::fs::write(&model, text.replace("dx_m", "dxm")).unwrap();
    let message = Config::read(&path).expect_err("no such parameter").to_string();
    assert!(message.contains("m.toml, effect 1, parameters.dxm") && message.contains("`dx_m`"), "{message}");

    std::fs::write(&model, &text).unwrap();
    let config = Config::read(&path).unwrap();
    assert_eq!(config.settings().model.terms[0].map(|term| term.value[0]), Some(0.01));
    assert_eq!(config.model_toml(), text, "recordings keep it");
    // The recorded configuration names the model; the model's text is stored separately.
    let parsed = Config::parse(&config.to_toml(), "kept").unwrap();
    assert_eq!((&parsed.model, parsed.loaded_model), (&config.model, None));
    assert!(refusal(&format!("{SMALLEST}[model]\nfiel = \"m.toml\"")).contains("did you mean `file`?"));
}

#[test]
fn a_recorded_configuration_has_no_hosts_and_no_folders() {
    let text = r#"
station = "station-1"
[suit]
source = "mvn-udp"
[ground]
source = "bota-serial"
[ground.serial]
port = "/srv/jane/ports/ttyPlate"
[subject]
id = "anon-1"
height_m = 1.77
[page]
listen = "192.0.2.10:8080"
token_file = "/srv/jane/token"
[metrics]
listen = "127.0.0.1:9187"
[recording]
directory = "/srv/jane/recordings"
[gateways.mqtt]
broker = "broker.hall-3.example"
ca_file = "/srv/jane/ca.pem"
[gateways.udp]
to = ["192.0.2.11:9000"]
[gateways.opcua]
listen = "127.0.0.1:4840"
host = "plc.hall-3.example"
[gateways.zenoh]
connect = ["tcp/192.0.2.12:7447"]
"#;
    let config = Config::parse(text, "c.toml").unwrap();
    let recorded = config.clone().for_recording();
    let written = recorded.to_toml();
    for private in ["jane", "srv", "192.0.2", "example", "127.0.0.1:4840", "127.0.0.1:9187"] {
        assert!(config.to_toml().contains(private), "{private}");
        assert!(!written.contains(private), "{private} is in {written}");
    }
    assert!(written.contains("/ttyPlate") && written.contains("recordings"), "{written}");
    assert_eq!(Config::parse(&written, "recorded").unwrap(), recorded);
}
