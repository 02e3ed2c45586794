mod described;

use super::*;
use crate::Config;

const TEXT: &str = include_str!("../../../examples/sensors/text-udp.toml");
const CELLS: &str = include_str!("../../../examples/sensors/load-cells-serial.toml");
const KISTLER: &str = include_str!("../../../examples/sensors/kistler-volts.toml");
const MOTICON: &str = include_str!("../../../examples/sensors/moticon.toml");

const BOTA: &str = include_str!("../../../examples/sensors/bota-frames.toml");
const RDT: &str = include_str!("../../../examples/sensors/ati-rdt-records.toml");
const AMTI: &str = include_str!("../../../examples/sensors/amti-frames.toml");
const SCANS: &str = include_str!("../../../examples/sensors/cells-24-bit-udp.toml");

/// The error for an example with one change; checks and removes the line that it names.
fn refusal(example: &str, from: &str, to: &str) -> String {
    assert!(example.contains(from), "{from}");
    let text = example.replacen(from, to, 1);
    let message = Config::parse(&text, "c.toml").expect_err("must be refused").to_string();
    let (place, what) = message.split_once(": ").expect("a place");
    let line: usize = place.strip_prefix("c.toml, line ").and_then(|line| line.parse().ok()).expect(&message);
    let named = text.lines().nth(line - 1).expect("such a line");
    // The line contains the change or the named key, or is the header of the section that lacks something.
    let key = what.split(':').next().and_then(|key| key.rsplit('.').next()).unwrap_or_default();
    let changed = to.lines().any(|changed| !changed.is_empty() && named.contains(changed.trim()));
    assert!(changed || named.starts_with('[') || named.starts_with(key), "{message}: line {line} is {named}");
    what.to_owned()
}

#[test]
fn examples_are_read_written_and_read_again() {
    for example in [TEXT, CELLS, KISTLER, MOTICON, BOTA, RDT, AMTI, SCANS] {
        let config = Config::parse(example, "c.toml").unwrap();
        let again = Config::parse(&config.to_toml(), "written").unwrap();
        assert_eq!(again, config);
        // Commented-out lines are defaults or optional settings.
        let switched_on = |line: &str| match line.strip_prefix('#') {
            Some(rest)
                if rest.starts_with(|sign: char| sign.is_ascii_lowercase()) && rest.contains(" = ") =>
            {
                rest.to_owned()
            }
            _ => line.to_owned(),
        };
        let all: Vec<String> = example.lines().map(switched_on).collect();
        assert!(Config::parse(&all.join("\n"), "all").is_ok());
        assert!(config.ground.device().unwrap().is_some() && config.ground.transport().unwrap().is_some());
        assert!(Config::parse(&config.clone().for_recording().to_toml(), "kept").is_ok());
    }
    assert_eq!(Config::parse(MOTICON, "c").unwrap().ground.settings().device, DeviceKind::Insoles);
    assert_eq!(Config::parse(KISTLER, "c").unwrap().ground.settings().device, DeviceKind::Plate);
}

#[test]
fn a_udp_source_without_requests_must_listen() {
    let listens = TEXT.lines().find(|line| line.starts_with("listen = ")).unwrap();
    let message = refusal(TEXT, listens, "address = \"192.168.1.20:8888\"");
    assert!(
        message.starts_with("ground.address: ") && message.contains("give `listen` in its place"),
        "{message}"
    );
}

#[test]
fn sections_and_keys_of_other_sources_are_refused() {
    for (foreign, named) in [
        ("[ground.serial]\nport = \"/dev/ttyUSB0\"", "ground.serial: is for devices on a serial line"),
        ("[ground.labamp]", "ground.labamp: is for source = \"kistler-labamp\""),
        ("[ground.tec_gihan]", "ground.tec_gihan: is for source = \"tec-gihan\""),
    ] {
        let message = refusal(TEXT, "[subject]", &format!("{foreign}\n[subject]"));
        assert!(message.starts_with(named), "{message}");
    }
    let message = refusal(TEXT, "source = \"text\"", "source = \"text\"\ncounts_per_newton = 1e6");
    assert!(message.starts_with("ground.counts_per_newton: is for source = \"ati-rdt\""), "{message}");
}

#[test]
fn a_prefix_that_no_line_can_have_is_refused() {
    let with = |keys: &str| format!("transport = \"udp\"\n{keys}");
    for (keys, expected) in [
        (r#"prefix = " W""#, "ground.text.prefix: white space before it is ignored"),
        (r#"prefix = "\tW""#, "ground.text.prefix: white space before it is ignored"),
        (r#"prefix = "W\r\n""#, "ground.text.prefix: it contains the end of a line"),
        ("comment = \"#\"\nprefix = \"#W\"", "ground.text.prefix: it begins with ground.text.comment"),
        (r#"comment = " ""#, "ground.text.comment: one visible sign"),
        (r#"comment = "°""#, "ground.text.comment: one visible sign"),
    ] {
        let message = refusal(TEXT, "transport = \"udp\"", &with(keys));
        assert!(message.starts_with(expected), "{keys}: {message}");
    }
    for keys in [r#"prefix = "W ""#, "comment = \"#\"\nprefix = \"W#\""] {
        let text = TEXT.replace("transport = \"udp\"", &with(keys));
        assert!(Config::parse(&text, "c.toml").is_ok(), "{keys}");
    }
}

#[test]
fn keys_of_other_connections_are_refused() {
    let (listen, file) = ("listen = \"0.0.0.0:9000\"", "[ground.file]\npath = \"export.txt\"\n[subject]");
    let address = "address = \"192.168.1.20:8888\"";
    let tcp = TEXT.replace("transport = \"udp\"", "transport = \"tcp\"");
    let to_file = TEXT.replace("transport = \"udp\"", "transport = \"file\"").replace("[subject]", file);
    let tcp = &tcp.replace(listen, &format!("{listen}\n{address}"));
    let unlistened =
        |text: &str| text.lines().filter(|line| !line.starts_with("listen")).collect::<Vec<_>>().join("\n");
    for (text, from, to, named) in [
        (TEXT, "[subject]", file, "ground.file: is for source = \"text\""),
        (tcp.as_str(), "station", "station", "ground.listen: is for devices that send datagrams"),
        (&unlistened(tcp), "station", "station", "ground.allow_remote: is for"),
        (
            &unlistened(&to_file),
            "source = \"text\"",
            &format!("source = \"text\"\n{address}"),
            "ground.address: is for",
        ),
        (
            MOTICON,
            "source = \"moticon-udp\"",
            &format!("source = \"moticon-udp\"\n{address}"),
            "ground.address: is for",
        ),
        (
            RDT,
            "source = \"binary\"",
            "source = \"binary\"\nallow_remote = true",
            "ground.allow_remote: is for",
        ),
    ] {
        let message = refusal(text, from, to);
        assert!(message.starts_with(named), "{message}, not {named}");
    }
    // Another process reads the device with this file.
    let external = tcp.replace("source = \"text\"", "source = \"external\"");
    assert!(Config::parse(&external, "c.toml").is_ok());
}

/// A device with sample blocks may be silent for the length of a block; that is not stale data.
#[test]
fn the_latency_includes_a_block_and_long_blocks_are_refused() {
    let with = |rate_hz: u32, suit: &str, ground: &str| {
        let text = format!(
            "station = \"s\"\n[suit]\nsource = \"mvn-udp\"\n{suit}[ground]\nsource = \"tec-gihan\"\n{ground}[ground.frame]\n\
             axes = \"z-down\"\n[ground.serial]\nport = \"/dev/ttyUSB0\"\n[ground.tec_gihan]\nrate_hz = {rate_hz}\n\
             [subject]\nid = \"a\"\nheight_m = 1.7\n"
        );
        Config::parse(&text, "c.toml").map_err(|error| error.to_string())
    };
    let config = with(2500, "", "").unwrap();
    assert_eq!(config.settings().ground_latency_ns, 40_000_000);
    assert_eq!(config.ground.settings().latency_ns, 0, "sample times are as they are");
    let (late, later) = ("latency_ms = 60.0\n", "latency_ms = 120.0\n");
    assert!(with(250, "", late).is_ok(), "460 ms");
    let message = with(250, "", later).unwrap_err();
    assert!(
        message.contains("ground.tec_gihan.rate_hz: the streams are 520 ms apart, since it gathers"),
        "{message}"
    );
    assert!(with(250, late, later).is_ok(), "the suit is late as well");
    // The loop stores a fixed number of samples, which is 51 ms at this rate.
    assert!(with(10_000, late, "").unwrap_err().contains("suit.latency_ms: the streams are 60 ms apart"));
    let message = with(2500, "[overload]\nmotion_window_ms = 250.0\n", "").unwrap_err();
    assert!(
        message.starts_with("c.toml, line 5: overload.motion_window_ms: the window spans 500 ms"),
        "{message}"
    );
    // Another process reads the device with the same keys.
    let external = "station = \"s\"\n[suit]\nsource = \"mvn-udp\"\n[ground]\nsource = \"external\"\n\
                    [ground.tec_gihan]\nrate_hz = 2500\n[subject]\nid = \"a\"\nheight_m = 1.7\n";
    assert_eq!(Config::parse(external, "c.toml").unwrap().settings().ground_latency_ns, 40_000_000);
}

#[test]
fn errors_in_a_text_format_are_reported_with_key_and_line() {
    let message = refusal(TEXT, "\"fx\", \"fy\"", "\"fx\", \"-\"");
    assert!(message.contains("fx and fy"), "{message}");
    let message = refusal(TEXT, "\"mx\"", "\"mx\", \"extra\"");
    assert!(message.starts_with("ground.text.columns: [ground.channels] does not use `extra`"), "{message}");
    let message = refusal(TEXT, "\"mx\"", "\"fx\"");
    assert!(message.contains("`fx` is the name of two columns"), "{message}");
    let message = refusal(TEXT, "\"mx\"", "{ name = \"mx\", scale = 0 }");
    assert!(
        message.contains("`mx`: scale is 0.0 and offset 0.0; scale is between 1e-15 and 1e15"),
        "{message}"
    );
    let message = refusal(TEXT, "\"mx\"", "{ name = \"mx\", offset = 1e300 }");
    assert!(
        message.contains("offset 1e300; ") && message.ends_with("offset between -1e15 and 1e15"),
        "{message}"
    );
    let message = refusal(TEXT, "\"mx\"", "{ nmae = \"mx\" }");
    assert!(message.contains("did you mean `name`"), "{message}");
    let message = refusal(TEXT, "column = \"count\"", "column = \"cuont\"");
    assert!(
        message.starts_with("ground.text.sequence: no column is called `cuont`; did you mean `count`?"),
        "{message}"
    );
    assert!(refusal(TEXT, "65536", "2").contains("reveals no loss"));
    let message = refusal(TEXT, "\"count\"", "{ name = \"count\", scale = 0.1 }");
    assert!(message.starts_with("ground.text.columns: a time or a count is taken as it stands"), "{message}");
    assert!(refusal(TEXT, "unit = \"s\"", "unit = \"min\"").contains("did you mean"));
    assert!(
        refusal(TEXT, "delimiter = \"semicolon\"", "delimiter = \"comma\"\ndecimal = \",\"")
            .contains("as well")
    );
    assert!(
        refusal(TEXT, "transport = \"udp\"", "transport = \"tcp\"")
            .starts_with("ground.address: must be given")
    );
    assert!(
        refusal(TEXT, "transport = \"udp\"", "transport = \"serial\"")
            .starts_with("ground.serial: must be given")
    );
    assert!(refusal(TEXT, "moment = \"N m\"", "moment = \"Nm\"").contains("did you mean `N m"));
    assert!(
        refusal(TEXT, "moment = \"N m\"", "").starts_with("ground.channels.wrench.moment: must be given")
    );
    assert!(refusal(TEXT, "listen = \"0.0.0.0:9000\"", "").starts_with("ground.listen: must be given"));
    let both = "listen = \"0.0.0.0:9000\"\naddress = \"1.2.3.4:9\"";
    assert!(refusal(TEXT, "listen = \"0.0.0.0:9000\"", both).contains("one of the two"));
}

#[test]
fn errors_in_channels_are_reported_with_key_and_line() {
    assert!(
        refusal(CELLS, "measures = \"reaction\"", "measures = \"action\"").contains("must be \"reaction\"")
    );
    let message = refusal(CELLS, "{ channel = \"back_left\"", "{ channel = \"back_lift\"");
    assert!(message.contains("no channel is called `back_lift`; did you mean `back_left`?"), "{message}");
    let message = refusal(CELLS, "x_m = -0.20, y_m = -0.15", "x_m = -200, y_m = -0.15");
    assert!(message.contains("in metres"), "{message}");
    assert!(refusal(KISTLER, "axes = \"z-down\"", "axes = \"z-up\"").contains("have z down"));
    assert!(refusal(KISTLER, "surface_height_m = 0.048", "surface_height_m = 0").contains("-az0"));
    assert!(refusal(KISTLER, "unit = \"V\"", "unit = \"N\"").contains("is the unit \"V\"?"));
    assert!(refusal(KISTLER, "38.117", "0").contains("not zero"));
    assert!(refusal(KISTLER, "\"fz4\"", "\"fz5\"").contains("no channel is called `fz4`"));
    assert!(refusal(KISTLER, "a_m = 0.12", "a_m = -0.12").contains("a and b"));
    let message = refusal(KISTLER, "b_m = 0.20", "b_m = 200");
    assert!(message.starts_with("ground.channels.kistler.b_m: 200 must be 0.01 to 2 m"), "{message}");
    let message = refusal(CELLS, "{ channel = \"back_left\"", "{ channel = \"front_left\"");
    assert!(message.contains("`front_left` is the channel of two cells"), "{message}");
    let message = refusal(AMTI, "channels = [\"g0\", \"g1\"", "channels = [\"g0\", \"g0\"");
    assert!(message.starts_with("ground.channels.matrix.channels: channel `g0` is named twice"), "{message}");
    let other = TEXT.replace("[ground.channels.wrench]", "[ground.channels.wrnch]");
    let message = Config::parse(&other, "c.toml").unwrap_err().to_string();
    assert!(message.contains("did you mean `wrench`?"), "{message}");
    let none = TEXT
        .replace("[ground.channels.wrench]", "[loop]\n#")
        .replace("force = \"N\"", "")
        .replace("moment = \"N m\"", "");
    let message = Config::parse(&none, "c.toml").unwrap_err().to_string();
    assert!(message.contains("ground.channels: must be given") && message.contains(".insoles"), "{message}");
    for (source, keys) in [("text", "transport, delimiter"), ("binary", "transport, endian")] {
        let text = format!(
            "station = \"s\"\n[suit]\nsource = \"mvn-udp\"\n[ground]\nsource = \"{source}\"\n[subject]\nid = \"a\"\nheight_m = 1.7\n"
        );
        let message = Config::parse(&text, "c.toml").unwrap_err().to_string();
        assert!(message.contains(keys), "{message}");
    }
}

#[test]
fn errors_in_a_binary_format_are_reported_with_key_and_line() {
    let message = refusal(BOTA, "at = 23, type = \"f32\"", "at = 34, type = \"f32\"");
    assert!(
        message.starts_with("ground.binary.fields: `mz`: it stands beyond the frame, which has 37 bytes"),
        "{message}"
    );
    let message = refusal(BOTA, "name = \"mz\"", "name = \"temperature\"");
    assert!(message.contains("does not use `temperature`"), "{message}");
    assert!(refusal(BOTA, "name = \"mz\"", "name = \"my\"").contains("two fields have this name"));
    assert!(
        refusal(BOTA, "at = 23, type = \"f32\"", "at = 23, type = \"f32\", mask = 1")
            .contains("mask requires an unsigned type")
    );
    assert!(refusal(BOTA, "at = 23, type = \"f32\"", "at = 23, type = \"f32\", per = 0").contains("per 0.0"));
    assert!(refusal(BOTA, "at = 23, type = \"f32\"", "at = 23, type = \"flaot\"").contains("did you mean"));
    assert!(
        refusal(BOTA, "name = \"CRC-16/X-25\"", "name = \"CRC-16/X25\"")
            .contains("did you mean `CRC-16/X-25`?")
    );
    assert!(refusal(BOTA, "to = -2", "to = 0").contains("not of its own"));
    assert!(refusal(BOTA, "length = 37", "length = 0").contains("1 to 65536"));
    let short = Config::parse(&BOTA.replace("length = 37", "length = 20"), "c.toml").unwrap_err().to_string();
    assert!(short.contains("beyond the frame, which has 20 bytes"), "{short}");
    assert!(
        refusal(BOTA, "length = 37", "length = { at = 1, tpye = \"u8\", most = 40 }")
            .contains("did you mean `type`")
    );
    assert!(refusal(BOTA, "sync = \"aa\"", "sync = \"a\"").contains("two hexadecimal digits"));
    assert!(
        refusal(BOTA, "transport = \"serial\"", "transport = \"serial\"\nsend_on_open = \"xx\"")
            .contains("two hexadecimal digits")
    );
    assert!(refusal(BOTA, "type = \"u32\", unit", "type = \"i32\", unit").contains("no sign"));
    assert!(refusal(RDT, "sequence = { at = 0, type = \"u32\" }", "").contains("call it `sequence`"));
    assert!(
        refusal(RDT, "address = \"192.168.1.1:49152\"", "listen = \"127.0.0.1:9\"")
            .contains("has an address")
    );
    assert!(
        refusal(AMTI, "mask = 0xf000, is = [0x3000]", "mask = 0xf000, is = [0x3001]")
            .contains("without bits outside the mask")
    );
    let untagged = AMTI.replace("tags = [", "kind_of = [");
    assert!(Config::parse(&untagged, "c.toml").unwrap_err().to_string().contains("`kind_of` is not known"));
    let unmarked = BOTA.replace("sync = \"aa\"", "").replace("crc = ", "# ");
    assert!(
        Config::parse(&unmarked, "c.toml")
            .unwrap_err()
            .to_string()
            .contains("without sync, tags and checksum")
    );
    assert!(
        refusal(AMTI, "\"lbf in\"\nchannels = [\"g0\", ", "\"lbf in\"\nchannels = [").contains("12 numbers")
    );
    assert!(refusal(SCANS, "sequence = { at = 10, type = \"u16\" }", "").contains("need a `sequence`"));
    let many = Config::parse(&SCANS.replace("count = 10", "count = 12"), "c.toml").unwrap_err().to_string();
    assert!(many.contains("`a`: it stands beyond"), "{many}");
    assert!(
        refusal(SCANS, "sequence = {", "time = { at = 12, type = \"u32\", unit = \"us\" }\nsequence = {")
            .contains("leave it out")
    );
}

#[test]
fn bits_beyond_a_number_and_bits_of_two_numbers_are_refused() {
    let message = refusal(BOTA, "mask = 0x000e", "mask = 0x1000e");
    assert!(message.starts_with("ground.binary.status: requires an unsigned type"), "{message}");
    let g0 = "name = \"g0\", at = 0, type = ";
    let message = refusal(AMTI, &format!("{g0}\"u16\""), &format!("{g0}\"u8\""));
    assert!(
        message.contains("`g0`: mask requires an unsigned type") && message.contains("none outside"),
        "{message}"
    );
    for at in [3, 5] {
        let message = refusal(BOTA, "name = \"fy\", at = 7", &format!("name = \"fy\", at = {at}"));
        assert!(message.starts_with("ground.binary.fields: field `fy` overlaps `fx`"), "{message}");
    }
    let g1 = "{ name = \"g1\", at = 2, type = \"u16\", mask = 0x0fff";
    let of_one_word = AMTI.replace(g1, "{ name = \"g1\", at = 0, type = \"u16\", mask = 0xf000");
    assert!(AMTI.contains(g1) && Config::parse(&of_one_word, "c.toml").is_ok());
    let counter = "sequence = { at = 0, type = ";
    let message =
        refusal(RDT, &format!("{counter}\"u32\" }}"), &format!("{counter}\"u16\", modulus = 65537 }}"));
    assert!(message.starts_with("ground.binary.sequence: a 16-bit counter wraps at 65536"), "{message}");
}

#[test]
fn insoles_need_their_size_and_their_sides() {
    assert!(refusal(MOTICON, "length_m = 0.2486", "length_m = 24.86").contains("no insole's length"));
    let message = refusal(MOTICON, "y_to = \"medial\"", "");
    assert!(message.starts_with("ground.moticon.y_to: must be given"), "{message}");
    let message =
        refusal(MOTICON, "width_m = 0.089", "width_m = 0.089\nfields = [\"time\",\n\"left_farce\"]");
    assert!(
        message.contains("`left_farce` is no field") && message.contains("did you mean `left_force`?"),
        "{message}"
    );
    assert!(
        refusal(MOTICON, "width_m = 0.089", "width_m = 0.089\nfields = [\"time\"]")
            .contains("no field is `left_force`")
    );
}

#[test]
fn a_section_of_another_source_is_refused() {
    let message = refusal(MOTICON, "[ground.moticon]", "[ground.file]\npath = \"a\"\n[ground.moticon]");
    assert!(message.starts_with("ground.file: is for source = "), "{message}");
}

#[test]
fn a_second_device_is_checked_with_its_own_keys() {
    let second = "\n[ground.second]\nsource = \"moticon-udp\"\nlisten = \"127.0.0.1:8888\"\n[ground.second.moticon]\nlength_m = 0.25\nwidth_m = 9\n";
    let text = format!("{TEXT}{second}");
    let message = Config::parse(&text, "c.toml").unwrap_err().to_string();
    assert!(message.contains("ground.second.moticon.width_m: 9 m is no insole's width"), "{message}");
    assert_eq!(message.split(':').next(), Some(&*format!("c.toml, line {}", text.lines().count())));
}

#[test]
fn the_corners_of_a_plate_are_turned_with_it() {
    let frame = FrameConfig {
        origin_m: [1.0, 2.0, 0.0],
        yaw_deg: 90.0,
        size_m: Some([0.6, 0.4]),
        ..FrameConfig::default()
    };
    let expected = [[0.8, 2.3], [1.2, 2.3], [1.2, 1.7], [0.8, 1.7]];
    for (corner, expected) in frame.corners_m().unwrap().iter().zip(expected) {
        assert!(
            (corner[0] - expected[0]).abs() < 1e-9 && (corner[1] - expected[1]).abs() < 1e-9,
            "{corner:?}"
        );
    }
    assert_eq!(FrameConfig::default().corners_m(), None);
    assert!(
        refusal(KISTLER, "[ground.frame]", "[ground.frame]\nsize_m = [600, 400]").contains("0.01 to 10 m")
    );
}

#[test]
fn a_surface_is_above_its_sensor_and_near_the_suit_s_floor() {
    let height = |value: &str| refusal(KISTLER, "surface_height_m = 0.048", value);
    assert!(height("surface_height_m = -0.048").contains("-0.048 is not between 0 and 0.5"));
    assert!(height("surface_height_m = 0.6").contains("0.6 is not between 0 and 0.5"));
    let origin = |z_m: &str| {
        refusal(KISTLER, "[ground.frame]", &format!("[ground.frame]\norigin_m = [1.0, 2.0, {z_m}]"))
    };
    assert!(origin("0.26").contains("is 0.308 m; at most ±0.3 m"), "{}", origin("0.26"));
    assert!(origin("-0.4").contains("is -0.352 m"));
    let text = KISTLER.replacen("[ground.frame]", "[ground.frame]\norigin_m = [1.0, 2.0, -0.2]", 1);
    assert!(Config::parse(&text, "c.toml").is_ok());
}
