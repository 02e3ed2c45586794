//! Invariants of the report: both forms agree, it is self-contained, and it accepts any input.
#![expect(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

#[path = "report/sample.rs"]
mod sample;
#[path = "report/text.rs"]
mod text;

use std::collections::BTreeSet;

use equipoise_discrepancy::report::Pages;
use sample::Sample;
use text::{attributes, html_words, markdown_words, well_formed, without_code};

const WORK_S: f64 = 90.0;

fn samples() -> [(&'static str, Sample); 4] {
    [
        ("named", sample::named(WORK_S)),
        ("none", sample::none(WORK_S)),
        ("ambiguous", sample::ambiguous(WORK_S)),
        ("unexplained", sample::unexplained(WORK_S)),
    ]
}

fn file<'a>(pages: &'a Pages, name: &str) -> &'a str {
    &pages.files.iter().find(|(file, _)| file == name).unwrap().1
}

#[test]
fn page_and_text_tell_the_same_words_and_numbers() {
    for (name, sample) in samples() {
        let pages = sample.report().pages();
        let html = html_words(file(&pages, "report.html"));
        let markdown = markdown_words(file(&pages, "report.md"));
        let numbers = html.iter().filter(|word| word.contains(|c: char| c.is_ascii_digit())).count();
        assert!(numbers > 60, "{name}: {numbers}");
        for (n, (one, other)) in html.iter().zip(&markdown).enumerate() {
            let before = html[n.saturating_sub(8)..n].join(" ");
            assert_eq!(one, other, "{name}: after {before}");
        }
        assert_eq!(html.len(), markdown.len(), "{name}");
    }
}

#[test]
fn the_report_contains_the_gap_of_the_finding() {
    let sample = sample::named(WORK_S);
    let words = html_words(file(&sample.report().pages(), "report.html")).join(" ");
    let gap = &sample.finding.gap;
    let [before, after, floor] = [(gap.before_mm, 1), (gap.after_mm, 2), (gap.noise_floor_mm, 2)]
        .map(|(mm, digits)| format!("{mm:.digits$}"));
    let expected = format!("the gap changes from {before} mm to {after} mm ; noise alone : {floor} mm");
    assert!(words.contains(&expected), "{expected} is not in {words}");
}

#[test]
fn the_page_needs_nothing_from_elsewhere() {
    for (name, sample) in samples() {
        for (file, text) in &sample.report().pages().files {
            let own = text.replace("xmlns=\"http://www.w3.org/2000/svg\"", "").to_lowercase();
            let foreign = [
                "http:", "https:", "//", "src=", "href", "url(", "@import", "<script", "<link", "<img",
                "<iframe",
            ];
            for part in foreign {
                assert!(!own.contains(part), "{name}/{file} contains {part}");
            }
        }
    }
}

#[test]
fn drawings_are_named_once_described_and_well_formed() {
    let mut twice = sample::named(WORK_S);
    twice.finding.effects.extend(twice.finding.effects.clone());
    twice.picture.predictors.extend(twice.picture.predictors.clone());
    for (name, sample) in samples().into_iter().chain([("one effect in two spans", twice)]) {
        let pages = sample.report().pages();
        let html = file(&pages, "report.html");
        well_formed(html.strip_prefix("<!doctype html>\n").unwrap()).unwrap();
        let identifiers = attributes(html, "id");
        let distinct: BTreeSet<_> = identifiers.iter().collect();
        assert_eq!(distinct.len(), identifiers.len(), "{name}");
        for reference in attributes(html, "aria-labelledby") {
            assert!(
                reference.split(' ').all(|part| distinct.contains(&part.to_owned())),
                "{name}: {reference}"
            );
        }
        let drawings: Vec<_> = pages.files.iter().filter(|(file, _)| file.ends_with(".svg")).collect();
        assert!(drawings.len() >= 10, "{name}: {}", drawings.len());
        assert_eq!(html.matches("<svg").count(), drawings.len(), "{name}");
        for (file, text) in drawings {
            well_formed(text).unwrap_or_else(|error| panic!("{name}/{file}: {error}"));
            assert!(text.contains("<title") && text.contains("<desc"), "{name}/{file}");
            let shown = self::file(&pages, "report.md").matches(&format!("]({file})")).count();
            assert_eq!(shown, 1, "{name}/{file}");
        }
    }
}

#[test]
fn hostile_names_stay_text() {
    const NAME: &str = "\"><script>alert('1')</script>|`*_[a](b)\n# c\u{1b}";
    let mut sample = sample::unexplained(WORK_S);
    let hostile = || NAME.to_owned();
    sample.origin.recordings[0].name = hostile();
    sample.origin.recordings[0].sha256 = hostile();
    sample.origin.subject = hostile();
    sample.origin.station = hostile();
    sample.origin.command = hostile();
    sample.finding.effects[0].family = vec![hostile()];
    sample.finding.candidates[3].name = hostile();
    sample.finding.set_aside[0].why = hostile();
    sample.finding.unexplained[0].what = hostile();
    sample.finding.ask_next = Some(hostile());
    sample.finding.spans[0].segment = Some(hostile());
    sample.finding.model = Some(hostile());
    sample.picture.pose[0].feature = hostile();
    let pages = sample.report().pages();
    for (name, text) in &pages.files {
        assert!(!text.contains('\u{1b}'), "{name}");
        if name.ends_with(".md") {
            let text = without_code(text);
            assert!(!text.contains("\n# c"), "a name's second line is a heading");
            let unescaped = text.match_indices("<script").filter(|(at, _)| !text[..*at].ends_with('\\'));
            assert_eq!(unescaped.count(), 0, "{text}");
        } else {
            assert!(!text.contains("<script"), "{name}");
            well_formed(text.trim_start_matches("<!doctype html>\n"))
                .unwrap_or_else(|error| panic!("{name}: {error}"));
        }
    }
}

#[test]
fn twenty_hours_make_no_larger_page() {
    const MOST: usize = 300_000;
    let mut sample = sample::named(20.0 * 3600.0);
    for n in 1..8 {
        let mut effect = sample.finding.effects[0].clone();
        effect.place.insert("hand".to_owned(), format!("{n}").into());
        sample.finding.effects.push(effect);
        let mut plot = sample.picture.predictors[0].clone();
        plot.effect = format!("hand_load {n}");
        sample.picture.predictors.push(plot);
    }
    let pages = sample.report().pages();
    assert_eq!(pages.files.iter().filter(|(name, _)| name.starts_with("predictor-")).count(), 8);
    let size = file(&pages, "report.html").len();
    assert!(size < MOST, "{size}");
}

#[test]
fn what_is_not_a_number_is_never_shown() {
    let mut sample = sample::named(WORK_S);
    for (n, value) in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY].into_iter().enumerate() {
        for plot in &mut sample.picture.time {
            plot.points[3 * n].before = value;
            plot.points[3 * n + 1].after = value;
            plot.points[3 * n + 2].noise_sigma = value;
        }
        sample.picture.pose[0].points[n].feature = value;
        sample.picture.predictors[0].points[n].predicted = value;
        sample.picture.whiteness[0].after[n] = value;
        sample.finding.candidates[n + 4].log_odds = Some(value);
        sample.picture.windows[0].times_noise_after = value;
    }
    sample.finding.gap.after_mm = f64::NAN;
    sample.finding.gap.noise_floor_mm = 0.0;
    sample.finding.effects[0].parameters.get_mut("mass_kg").unwrap().sigma = f64::NAN;
    for (name, text) in &sample.report().pages().files {
        let words: Vec<&str> = text.split(|c: char| !c.is_ascii_alphabetic()).collect();
        assert!(!words.contains(&"NaN") && !words.contains(&"inf"), "{name}");
    }
}

#[test]
fn an_empty_picture_is_still_a_report() {
    for (name, mut sample) in samples() {
        let picture = &mut sample.picture;
        picture.time.clear();
        picture.pose.clear();
        picture.predictors.clear();
        picture.whiteness.clear();
        picture.surprise.clear();
        picture.windows.clear();
        picture.phases.clear();
        sample.finding.candidates.clear();
        sample.finding.gap.per_axis.clear();
        let pages = sample.report().pages();
        assert_eq!(
            html_words(file(&pages, "report.html")),
            markdown_words(file(&pages, "report.md")),
            "{name}"
        );
    }
}

#[test]
fn each_verdict_has_its_own_text() {
    let story = |sample: &Sample| html_words(file(&sample.report().pages(), "report.html")).join(" ");
    let [named, none, ambiguous, unexplained] = samples().map(|(_, sample)| story(&sample));
    assert!(named.contains("The model lacks a load in the right hand ( 1.513 ± 0.031 kg )"));
    assert!(
        named.contains("equipoise replay shift-morning.mcap --model findings / shift-morning / model.toml")
    );
    assert!(named.contains("about") || named.contains("more than a million times less likely"));
    assert!(!none.contains("held-out blocks"), "nothing was changed, so nothing is after it");
    assert!(!none.contains("--model"), "no model, no command for it");
    assert!(none.contains("below the detection limit") && none.contains("0.688 °"));
    assert!(named.contains("probability 98.1 %") && named.contains("No other effect in its place"));
    assert!(
        ambiguous.contains("do not establish which effect") && ambiguous.contains("( 71.0 % )"),
        "{ambiguous}"
    );
    assert!(ambiguous.contains("In its place :") && ambiguous.contains("probability 27.0 %"), "{ambiguous}");
    assert!(ambiguous.contains("Next measurement : Stand on the plate turned by 90°"));
    assert!(unexplained.contains("a further effect that is not in the catalogue"));
    assert!(unexplained.contains("a heading error of the right forearm"));
}

#[test]
fn an_unexplained_part_larger_than_all_named_ones_is_reported_first() {
    let mut sample = sample::unexplained(WORK_S);
    sample.finding.unexplained[0].log_odds = 1e4;
    let pages = sample.report().pages();
    let words = html_words(file(&pages, "report.html")).join(" ");
    let place = |what: &str| words.find(what).unwrap_or_else(|| panic!("{what} is not in {words}"));
    let first =
        place("not in the catalogue Closest generic description : a heading error of the right forearm");
    assert!(first < place("a load in the right hand") && !words.contains("The model lacks"));
    assert!(words.contains("do not run this model"));
    let markdown = file(&pages, "report.md");
    assert!(markdown.contains("**Next measurement:** "), "{markdown}");
}
