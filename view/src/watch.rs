//! The screen of `equipoise watch`: displays a station in a terminal, with `ratatui`, at any size from 40 × 12 on.
//!
//! [`Watch`] contains the data of one moment, [`draw`] arranges it. Values come from [`crate::words`] and
//! `State::unless`: invalid ones are not displayed, and none at all while the daemon is silent.

mod health;
mod joints;
mod plate;

use equipoise_core::message::{Incidents, State};
use equipoise_latency::Report;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Borders, Clear, Paragraph, Wrap};

use crate::banner::Headline;
use crate::terminal;
use crate::words::Tone;

/// Minimum width for the two-column layout, columns.
const TWO_COLUMNS_FROM: u16 = 80;
/// Minimum height of the body for the plate to be drawn, lines.
const PLATE_FROM: u16 = 16;
/// Maximum width of a text column for easy reading.
const JOINTS_WIDTH_MAX: u16 = 100;

/// Health of an adapter, as displayed.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensor {
    /// `suit` or `ground`.
    pub name: &'static str,
    /// Samples per second over the last second.
    pub rate_hz: f64,
    /// Lost samples.
    pub lost: u64,
    /// Refused samples by reason, only counts above 0.
    pub refused: Vec<(&'static str, u64)>,
}

/// Contents of the screen.
#[derive(Debug, Clone, Copy)]
pub struct Watch<'a> {
    /// The station's name.
    pub station: &'a str,
    /// The active subject; empty if none with a name is loaded.
    pub subject: &'a str,
    /// The newest state; `None` while there is no current one: an old one is never displayed.
    pub state: Option<&'a State>,
    /// Process ID of the daemon, if it exists and is stopped.
    pub stopped: Option<u32>,
    /// Time since the last state, s; `None` if there was none.
    pub silent_s: Option<f64>,
    /// Headline above the values, with hysteresis; without one it is derived from the state alone.
    pub headline: Option<&'a Headline>,
    /// The suggested pose in words, if there is one.
    pub pose: Option<&'a str>,
    /// Adapters with a recent health message.
    pub sensors: &'a [Sensor],
    /// Incidents, with their start times.
    pub incidents: Option<&'a Incidents>,
    /// Percentiles since the screen was opened; `None` without cycle records.
    pub latency: Option<&'a Report>,
    /// CLOCK_MONOTONIC, ns.
    pub now_ns: u64,
    /// Whether the help is displayed on top.
    pub help: bool,
}

/// Draws the screen into a frame of any size.
pub fn draw(frame: &mut Frame<'_>, watch: &Watch<'_>) {
    let area = frame.area();
    let head = head(watch, area);
    let incidents = health::incidents(watch, area.height);
    let [top, wrong, body, foot] = Layout::vertical([
        Constraint::Length(head.len() as u16),
        Constraint::Length(incidents.len() as u16),
        Constraint::Min(0),
        Constraint::Length(1),
    ])
    .areas(area);
    frame.render_widget(Paragraph::new(head), top);
    frame.render_widget(Paragraph::new(incidents), wrong);
    match watch.state {
        Some(state) if body.width >= TWO_COLUMNS_FROM => two_columns(frame, watch, state, body),
        Some(state) => below(frame, watch, state, body),
        None => frame.render_widget(Paragraph::new(nothing(watch)).wrap(Wrap { trim: true }), body),
    }
    frame.render_widget(Line::from(" q quit   ? help").style(faint()), foot);
    if watch.help {
        help(frame, area);
    }
}

/// Two columns: joints and load on the left; plate, sensors and latency on the right.
fn two_columns(frame: &mut Frame<'_>, watch: &Watch<'_>, state: &State, area: Rect) {
    let left_width = (area.width * 11 / 20).min(JOINTS_WIDTH_MAX);
    let [left, _, right] =
        Layout::horizontal([Constraint::Length(left_width), Constraint::Length(1), Constraint::Min(0)])
            .areas(area);
    let load = load_lines(state, left.width);
    let [joints, loads] =
        Layout::vertical([Constraint::Min(4), Constraint::Length(load.len() as u16)]).areas(left);
    joints::draw(frame, state, joints);
    frame.render_widget(Paragraph::new(load), loads);
    let sensors = health::sensors(watch, state, right.width);
    let latency = health::latency(watch);
    let text = (sensors.len() + latency.len()) as u16;
    let plate_height = area.height.saturating_sub(text);
    let shown = if area.height >= PLATE_FROM && plate_height >= 6 { plate_height } else { 0 };
    let [picture, below] = Layout::vertical([Constraint::Length(shown), Constraint::Min(0)]).areas(right);
    if shown > 0 {
        plate::draw(frame, state, picture);
    }
    frame.render_widget(Paragraph::new([sensors, latency].concat()), below);
}

/// Load, low back and accumulated exposure of the shift, one value per line; `-` if it is withheld.
fn load_lines(state: &State, width: u16) -> Vec<Line<'static>> {
    let or_withheld = |value: Option<String>| value.unwrap_or_else(|| "-".to_owned());
    let rows = [
        ("load", or_withheld(terminal::load(state))),
        ("low back", or_withheld(terminal::back(state))),
        ("worst", or_withheld(terminal::worst(state))),
        ("shift", terminal::shift(state)),
    ];
    let lines = rows.map(|(name, value)| Line::raw(cut(&format!(" {name:<8} {value}"), width)));
    if width >= TWO_COLUMNS_FROM / 2 + 4 {
        [heading("Load and dose")].into_iter().chain(lines).collect()
    } else {
        lines.to_vec()
    }
}

/// One column: joints, load, sensors, and further parts if there is room.
fn below(frame: &mut Frame<'_>, watch: &Watch<'_>, state: &State, area: Rect) {
    let load = load_lines(state, area.width);
    let sensors = health::sensors(watch, state, area.width);
    let latency = health::latency(watch);
    // At least four joints are displayed; load, sensors, latency and the plate share the rest, in this order.
    let mut room = area.height.saturating_sub(4);
    let mut take = |wanted: usize| {
        let taken = room.min(wanted as u16);
        room -= taken;
        taken
    };
    let (for_load, for_sensors) = (take(load.len()), take(sensors.len()));
    let for_latency = if room as usize >= latency.len() + 4 { latency.len() as u16 } else { 0 };
    room -= for_latency;
    let for_plate = if room >= 14 { 10.max(room / 2) } else { 0 };
    let [joints, loads, picture, healthy, late] = Layout::vertical([
        Constraint::Min(0),
        Constraint::Length(for_load),
        Constraint::Length(for_plate),
        Constraint::Length(for_sensors),
        Constraint::Length(for_latency),
    ])
    .areas(area);
    joints::draw(frame, state, joints);
    frame.render_widget(Paragraph::new(load), loads);
    if for_plate > 0 {
        plate::draw(frame, state, picture);
    }
    frame.render_widget(Paragraph::new(sensors), healthy);
    frame.render_widget(Paragraph::new(latency), late);
}

/// Station and phase, instruction in plain words, progress of the identification, and why values are withheld.
fn head(watch: &Watch<'_>, area: Rect) -> Vec<Line<'static>> {
    let mut title = vec![Span::styled(format!(" {} ", watch.station), bold())];
    if !watch.subject.is_empty() && area.width >= 60 {
        title.push(Span::raw(format!(" {} ", watch.subject)));
    }
    let Some(state) = watch.state else {
        title.push(Span::styled(" The daemon is silent ", bold().fg(Color::Red)));
        return vec![Line::from(title)];
    };
    let headline = watch.headline.cloned().unwrap_or_else(|| Headline::of(state, watch.pose));
    title.push(Span::raw(format!(" {}", headline.phase)));
    if area.width >= 60 {
        title.push(Span::styled(format!("  cycle {}", state.cycle), faint()));
    }
    let instruction = &headline.instruction;
    let style = bold().fg(tone(instruction.tone));
    let rows = if area.height < 16 { 1 } else { 2 };
    let mut lines = vec![Line::from(title)];
    lines
        .extend(wrapped(&instruction.text, area.width, rows).into_iter().map(|row| Line::styled(row, style)));
    if area.height >= 14 {
        lines.push(Line::raw(format!(" {}", terminal::progress(state))));
    }
    if area.height >= 18 {
        let reasons = &headline.reasons;
        // The first reason may also be the instruction.
        let rows = if area.height >= 30 { 3 } else { 1 };
        let below = reasons.iter().take(rows).map(|reason| {
            let style = if reason.fault { Style::new().fg(Color::Red) } else { faint() };
            Line::styled(format!(" {}", cut(reason.text, area.width.saturating_sub(1))), style)
        });
        lines.extend(below);
        lines.push(Line::default());
    }
    lines
}

/// Contents while the daemon is silent.
fn nothing(watch: &Watch<'_>) -> Vec<Line<'static>> {
    let since = match watch.silent_s {
        Some(silent_s) => {
            format!("Nothing has come for {silent_s:.0} s; what came before is old and not shown.")
        }
        None => format!("Nothing has come from station {} yet.", watch.station),
    };
    let remedy = match watch.stopped {
        Some(process) => {
            format!("Its process {process} is stopped: `kill -CONT {process}` lets it continue.")
        }
        None => "Is it running? `systemctl status equipoise`, or `equipoise run --config FILE`.".to_owned(),
    };
    vec![
        Line::default(),
        Line::raw(since),
        Line::raw(remedy),
        Line::raw("This screen goes on by itself as soon as it is."),
    ]
}

fn help(frame: &mut Frame<'_>, area: Rect) {
    let lines = [
        "q, Esc, Ctrl-C   quit",
        "?                this help, and away again",
        "",
        "Bars: overload torque over the joint's limit,",
        "worst joint first, colours and signs as on the page.",
        "Plate, from above, forward is up: + CoP measured,",
        "o CoP of the body alone with 2 σ, x CoM,",
        "L and R hands, lines: feet and support.",
        "- : withheld; the reasons stand at the top.",
    ];
    let width = area.width.min(54);
    let height = area.height.min(lines.len() as u16 + 2);
    let centred =
        Rect { x: area.x + (area.width - width) / 2, y: area.y + (area.height - height) / 2, width, height };
    frame.render_widget(Clear, centred);
    let block = Block::new().borders(Borders::ALL).title(" Help ");
    frame.render_widget(Paragraph::new(lines.map(Line::raw).to_vec()).block(block), centred);
}

/// Wraps a text into at most `rows` lines that start with a blank; the rest is cut off.
fn wrapped(text: &str, width: u16, rows: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ') {
        let room = lines.last().map_or(0, |line| (width as usize).saturating_sub(line.chars().count() + 1));
        let full = lines.len() == rows;
        match lines.last_mut() {
            Some(line) if word.chars().count() <= room => line.extend([" ", word]),
            Some(_) if full => break,
            _ => lines.push(format!(" {word}")),
        }
    }
    lines
}

/// Cuts a text to at most `width` columns.
fn cut(text: &str, width: u16) -> String {
    text.chars().take(width as usize).collect()
}

fn tone(tone: Tone) -> Color {
    match tone {
        Tone::Calm => Color::Reset,
        Tone::Good => Color::Green,
        Tone::Warn => Color::Yellow,
        Tone::Alarm => Color::Red,
    }
}

fn bold() -> Style {
    Style::new().add_modifier(Modifier::BOLD)
}

fn faint() -> Style {
    Style::new().add_modifier(Modifier::DIM)
}

fn heading(text: &str) -> Line<'static> {
    Line::styled(format!(" {text}"), bold())
}

#[cfg(test)]
mod tests;
