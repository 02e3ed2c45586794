//! Tests of refusals in the sections of amplifiers and of plates that are read through other programs.

use crate::Config;

const LABAMP: &str = include_str!("../../../examples/sensors/kistler-labamp.toml");
const TEC_GIHAN: &str = include_str!("../../../examples/sensors/tec-gihan.toml");
const QTM: &str = include_str!("../../../examples/sensors/qualisys.toml");
const LSL: &str = include_str!("../../../examples/sensors/lsl.toml");

/// The error for an example with one change; the reported position must be a line of the text.
fn refusal(example: &str, from: &str, to: &str) -> String {
    assert!(example.contains(from), "{from}");
    let message =
        Config::parse(&example.replacen(from, to, 1), "c.toml").expect_err("must be refused").to_string();
    let (place, what) = message.split_once(": ").expect("a place");
    assert!(place.starts_with("c.toml"), "{message}");
    what.to_owned()
}

#[test]
fn examples_are_read_with_their_defaults_switched_on_and_lead_to_a_device() {
    for example in [LABAMP, TEC_GIHAN, QTM, LSL] {
        // "#key = value" is an optional setting that may be enabled.
        let switched_on: String = example
            .lines()
            .map(|line| {
                line.strip_prefix('#')
                    .filter(|rest| {
                        rest.split_once(" = ")
                            .is_some_and(|(key, _)| key.chars().all(|c| c.is_ascii_lowercase() || c == '_'))
                    })
                    .unwrap_or(line)
                    .to_owned()
                    + "\n"
            })
            .collect();
        for text in [example.to_owned(), switched_on] {
            let config = Config::parse(&text, "c.toml").unwrap();
            assert_eq!(Config::parse(&config.to_toml(), "written").unwrap(), config);
            assert!(
                config.ground.device().unwrap().is_some() && config.ground.transport().unwrap().is_some()
            );
        }
    }
}

#[test]
fn a_labamp_is_configured_within_its_limits() {
    let message = refusal(LABAMP, "#rate_hz = 62500", "rate_hz = 62501");
    assert!(message.starts_with("ground.labamp.rate_hz: 62501 is none of 10, 100,"), "{message}");
    let message = refusal(LABAMP, "#scans_per_frame = 512", "scans_per_frame = 100");
    assert!(message.starts_with("ground.labamp.scans_per_frame: 100 is not between 512 and"), "{message}");
    assert!(
        refusal(LABAMP, "#decimate = 62", "decimate = 2").starts_with("ground.labamp.decimate: 2 is not")
    );
    assert!(refusal(LABAMP, "\"z-down\"", "\"z-up\"").starts_with("ground.frame.axes: must be \"z-down\""));
    let reaction = "source = \"kistler-labamp\"\nmeasures = \"reaction\"";
    assert!(
        refusal(LABAMP, "source = \"kistler-labamp\"", reaction)
            .starts_with("ground.measures: must be \"action\" for Kistler's plates")
    );
    assert!(
        refusal(LABAMP, "surface_height_m = 0.048", "surface_height_m = 0.0")
            .starts_with("ground.frame.surface_height_m: must be given for Kistler's plates")
    );
    assert!(refusal(LABAMP, "a_m = 0.12 ", "a_m = -0.12 ").starts_with("ground.labamp.eight.a_m"));
    let message = refusal(LABAMP, "fz2 = \"Sensor-6\"", "fz2 = \"sensor-5\"");
    assert!(message.starts_with("ground.labamp.eight: channel \"sensor-5\" is named twice"), "{message}");
    assert!(refusal(LABAMP, "address = ", "#address = ").starts_with("ground.address: must be given"));
    let direct = "[ground.labamp.direct]\nfz = \"Sensor-1\"\n";
    let both = format!("{direct}[ground.frame]");
    assert!(refusal(LABAMP, "[ground.frame]", &both).contains("either [ground.labamp.eight] or"));
    // Without the eight-channel section some channels are sufficient, but not half of a pair.
    let (before, rest) = LABAMP.split_once("[ground.labamp.eight]").unwrap();
    let (_, after) = rest.split_once("[ground.frame]").unwrap();
    let one = format!("{before}{direct}[ground.frame]{after}");
    assert!(Config::parse(&one, "c").is_ok());
    assert!(
        refusal(&one, "fz = ", "fx = \"a\"\nfz = ").starts_with("ground.labamp.direct: fz must be named")
    );
}

#[test]
fn a_controller_of_tec_gihan_has_its_rates_and_axes() {
    let message = refusal(TEC_GIHAN, "#rate_hz = 2500", "rate_hz = 2000");
    assert!(message.starts_with("ground.tec_gihan.rate_hz: 2000 is none of 10000, 5000, 2500,"), "{message}");
    assert!(
        refusal(TEC_GIHAN, "#plate = 1", "plate = 0").starts_with("ground.tec_gihan.plate: 0 is not between")
    );
    assert!(refusal(TEC_GIHAN, "#range = \"3kN\"", "range = \"3 kN\"").contains("3kN"));
    assert!(
        refusal(TEC_GIHAN, "\"z-down\"", "\"z-up\"").starts_with("ground.frame.axes: must be \"z-down\"")
    );
    let reaction = "source = \"tec-gihan\"\nmeasures = \"reaction\"";
    assert!(
        refusal(TEC_GIHAN, "source = \"tec-gihan\"", reaction)
            .starts_with("ground.measures: must be \"action\"")
    );
    let (head, rest) = TEC_GIHAN.split_once("[ground.serial]").unwrap();
    let (_, rest) = rest.split_once("[ground.tec_gihan]").unwrap();
    let message = Config::parse(&format!("{head}[ground.tec_gihan]{rest}"), "c").unwrap_err().to_string();
    assert!(message.contains("ground.serial: must be given"), "{message}");
}

#[test]
fn the_axes_of_a_qtm_plate_are_required_and_consistent() {
    assert!(refusal(QTM, "coordinates = \"plate\"", "").contains("coordinates"));
    assert!(refusal(QTM, "\"plate\" ", "\"lab\" ").starts_with("ground.frame.axes: must be \"z-up\" where"));
    assert!(
        refusal(QTM, "\"z-down\" ", "\"z-up\" ").starts_with("ground.frame.axes: must be \"z-down\" where")
    );
    assert!(
        refusal(QTM, "#plate = 1", "plate = 0").starts_with("ground.qtm.plate: plates are counted from 1")
    );
    assert!(
        refusal(QTM, "#divisor = 1", "divisor = 11")
            .starts_with("ground.qtm.divisor: 11 is not from 1 to 10")
    );
    assert!(refusal(QTM, "address = ", "#address = ").starts_with("ground.address: must be given"));
}

#[test]
fn a_stream_and_its_channels_are_named() {
    assert!(
        refusal(LSL, "name = ", "#name = ").starts_with("ground.lsl: name, type or source_id must be given")
    );
    let with_address = LSL.replace("#address = ", "address = ").replace("name = ", "#name = ");
    assert!(Config::parse(&with_address, "c").is_ok());
    assert!(refusal(LSL, "AMTI Force Plate", "AMTI's").starts_with("ground.lsl.name: must not be empty"));
    assert!(refusal(LSL, "fz = \"Fz\"\n", "").starts_with("ground.lsl.channels: fz must be named"));
    let message = refusal(LSL, "my = \"My\"", "my = \"Mx\"");
    assert!(message.starts_with("ground.lsl.channels: channel \"Mx\" is named twice"), "{message}");
    assert!(refusal(LSL, "#force_unit = \"N\"", "force_unit = \"V\"").starts_with("ground.lsl.force_unit"));
    assert!(
        refusal(LSL, "#moment_unit = \"Nm\"", "moment_unit = \"N\"").starts_with("ground.lsl.moment_unit")
    );
}
