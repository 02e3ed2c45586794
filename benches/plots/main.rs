//! Draws the plots of `docs/performance/` from the figures that the benches wrote: `cargo run --release -p
//! equipoise-benches --bin plots`. A bench that has not run keeps its old plot.

mod chart;

use std::path::Path;

use chart::{Chart, Kind, Series};
use equipoise_benches::figures::{self, Figure};

const FOLDER: &str = "docs/performance";

fn main() -> std::io::Result<()> {
    if !Path::new(FOLDER).is_dir() {
        eprintln!("{FOLDER} is not here: run this in the folder of the sources");
        std::process::exit(2);
    }
    let plots = [
        ("path", path as fn(&[Figure]) -> Vec<(&'static str, Chart)>),
        ("wakeup", wakeup),
        ("fan_out", fan_out),
        ("stations", stations),
    ];
    for (bench, draw) in plots {
        let figures = figures::read(bench);
        if figures.is_empty() {
            println!("{bench}: no figures; cargo bench -p equipoise-benches --bench {bench} makes them");
            continue;
        }
        for (name, chart) in draw(&figures) {
            let file = format!("{FOLDER}/{name}.svg");
            std::fs::write(&file, chart.svg())?;
            println!("{file}");
        }
    }
    Ok(())
}

/// The different values of a condition, in the order of their first appearance.
fn classes(figures: &[Figure], condition: &str) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    for value in figures.iter().filter_map(|figure| figure.of.get(condition)) {
        if !found.contains(value) {
            found.push(value.clone());
        }
    }
    found
}

/// A value for each class under other fixed conditions; NaN where it was not measured.
fn values(
    figures: &[Figure],
    (condition, classes): (&str, &[String]),
    fixed: &[(&str, &str)],
    value: &str,
) -> Vec<f64> {
    let is =
        |figure: &Figure, name: &str, wanted: &str| figure.of.get(name).is_some_and(|found| found == wanted);
    let of_class = |class: &String| {
        let found = figures.iter().find(|figure| {
            is(figure, condition, class) && fixed.iter().all(|(name, wanted)| is(figure, name, wanted))
        });
        found.and_then(|figure| figure.values.get(value)).copied().unwrap_or(f64::NAN)
    };
    classes.iter().map(of_class).collect()
}

fn path(figures: &[Figure]) -> Vec<(&'static str, Chart)> {
    let arrangements = classes(figures, "arrangement");
    let series = classes(figures, "carrier").into_iter().map(|carrier| Series {
        values: values(figures, ("arrangement", &arrangements), &[("carrier", &carrier)], "sum_p50_us"),
        name: carrier,
    });
    let chart = Chart {
        title: "Arrival → consumer, without the wait for the next cycle",
        x: "",
        y: "p50, µs",
        kind: Kind::Bars,
        logarithmic: false,
        series: series.collect(),
        classes: arrangements,
    };
    vec![("path", chart)]
}

fn wakeup(figures: &[Figure]) -> Vec<(&'static str, Chart)> {
    let conditions = classes(figures, "condition");
    let of = |value: &str| -> Vec<Series> {
        let contenders = classes(figures, "contender").into_iter();
        contenders
            .map(|contender| Series {
                values: values(figures, ("condition", &conditions), &[("contender", &contender)], value),
                name: contender,
            })
            .collect()
    };
    let lateness = Chart {
        title: "Wake-up lateness",
        x: "",
        y: "p99, µs",
        kind: Kind::Bars,
        logarithmic: true,
        series: of("p99_us"),
        classes: conditions.clone(),
    };
    let ratio = Chart {
        title: "p99 of wake-up lateness ÷ cyclictest's on the other core",
        y: "ratio",
        logarithmic: false,
        series: of("p99_ratio"),
        ..lateness.clone()
    };
    vec![("wakeup", lateness), ("wakeup_ratio", ratio)]
}

fn fan_out(figures: &[Figure]) -> Vec<(&'static str, Chart)> {
    let consumers: Vec<String> =
        classes(figures, "consumers").into_iter().filter(|count| count != "slope").collect();
    let series = classes(figures, "kind").into_iter().map(|kind| Series {
        values: values(figures, ("consumers", &consumers), &[("kind", &kind)], "publish_p50_us"),
        name: kind,
    });
    let chart = Chart {
        title: "Publishing one state: copied, recorded, everybody woken",
        x: "consumers",
        y: "p50, µs",
        kind: Kind::Lines,
        logarithmic: false,
        series: series.collect(),
        classes: consumers,
    };
    vec![("fan_out", chart)]
}

fn stations(figures: &[Figure]) -> Vec<(&'static str, Chart)> {
    let counts = classes(figures, "stations");
    let of = |value: &str| -> Vec<Series> {
        let rates = classes(figures, "rate_hz").into_iter();
        rates
            .map(|rate| Series {
                values: values(figures, ("stations", &counts), &[("rate_hz", &rate)], value),
                name: format!("loop at {rate} Hz"),
            })
            .collect()
    };
    let lateness = Chart {
        title: "Stations on one machine: from due to published",
        x: "stations",
        y: "p99, µs",
        kind: Kind::Lines,
        logarithmic: true,
        series: of("to_state_p99_us"),
        classes: counts.clone(),
    };
    let cpu = Chart {
        title: "Stations on one machine: CPU of one daemon",
        y: "% of a core",
        logarithmic: false,
        series: of("cpu_percent"),
        ..lateness.clone()
    };
    vec![("stations_lateness", lateness), ("stations_cpu", cpu)]
}
