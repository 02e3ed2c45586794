//! The joints, worst first: name, bar, torque with its σ, level in words.

use equipoise_core::body::Joint;
use equipoise_core::message::{State, Validity};
use equipoise_core::overload::Level;
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::{Color, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;

use super::{cut, faint, heading};
use crate::levels::LevelStyle;
use crate::words;

/// Length of the longest joint name in words.
const NAME_WIDTH: usize = 22;
/// Width of level, torque and fatigue after the bar.
const FIGURES_WIDTH: usize = 45;
/// Narrower bars are not informative and are left out.
const BAR_MIN: usize = 6;
const BAR_MAX: usize = 40;

pub(super) fn draw(frame: &mut Frame<'_>, state: &State, area: Rect) {
    let mut lines = match state.unless(Validity::INVALIDATES_TORQUES, ()) {
        Some(()) => overload(state, area.width as usize),
        None => fatigue(state, area.width as usize),
    };
    lines.truncate(area.height as usize);
    frame.render_widget(Paragraph::new(lines), area);
}

/// A joint's torque divided by its limit; `None` if the limit is unavailable.
fn limit_ratio(state: &State, joint: Joint) -> Option<f64> {
    let limit_nm = state.torque_limit_nm[joint.index()];
    (limit_nm > 0.0).then(|| words::torque_nm(state, joint) / limit_nm)
}

/// All joints, sorted by their torque relative to the limit, those without a limit last.
fn worst_first(state: &State) -> Vec<(Joint, Option<f64>)> {
    let mut joints: Vec<_> = Joint::ALL.into_iter().map(|joint| (joint, limit_ratio(state, joint))).collect();
    joints.sort_by(|(_, a), (_, b)| b.unwrap_or(-1.0).total_cmp(&a.unwrap_or(-1.0)));
    joints
}

fn overload(state: &State, width: usize) -> Vec<Line<'static>> {
    let wide = width >= 1 + NAME_WIDTH + BAR_MIN + FIGURES_WIDTH;
    let name_width = if wide { NAME_WIDTH } else { 14 };
    let figures_width = if wide { FIGURES_WIDTH } else { 24 };
    let bar_width = width.saturating_sub(name_width + figures_width + 3).min(BAR_MAX);
    let row = |(joint, limit_ratio): (Joint, Option<f64>)| {
        let index = joint.index();
        let level = state.joint_level[index];
        let style = LevelStyle::of(Level::from_number(level).unwrap_or(Level::None));
        let (torque_nm, sigma_nm) = (words::torque_nm(state, joint), state.torque_sigma_nm[index]);
        let bar = limit_ratio
            .filter(|_| bar_width >= BAR_MIN)
            .map_or_else(String::new, |limit_ratio| bar(limit_ratio, bar_width));
        let figures = if wide {
            let tired = 100.0 * state.fatigue[index];
            format!(
                "{torque_nm:>5.0} ± {sigma_nm:.0} of {:.0} N m, tired {tired:.0} %",
                state.torque_limit_nm[index]
            )
        } else {
            format!("{torque_nm:>5.0} N m")
        };
        let pad = if bar_width >= BAR_MIN { bar_width } else { 0 };
        Line::from(vec![
            Span::raw(format!(" {:<name_width$} ", cut(words::joint(joint), name_width as u16))),
            Span::styled(format!("{bar:<pad$} "), Style::new().fg(colour(style))),
            badge(level, style),
            Span::raw(figures),
        ])
    };
    let title = heading("Overload, worst first");
    [title].into_iter().chain(worst_first(state).into_iter().map(row)).collect()
}

/// Fatigue per joint, which stays valid while torques are withheld; joints with zero are left out.
fn fatigue(state: &State, width: usize) -> Vec<Line<'static>> {
    let mut joints = Joint::ALL.to_vec();
    joints.sort_by(|a, b| state.fatigue[b.index()].total_cmp(&state.fatigue[a.index()]));
    let bar_width = width.saturating_sub(NAME_WIDTH + 14).min(BAR_MAX);
    let rows = joints.into_iter().filter(|joint| state.fatigue[joint.index()] > 0.0).map(|joint| {
        let fatigue = state.fatigue[joint.index()];
        Line::raw(format!(
            " {:<NAME_WIDTH$} {:<bar_width$} {:.0} % tired",
            words::joint(joint),
            bar(fatigue, bar_width),
            100.0 * fatigue
        ))
    });
    let why = words::reasons(state).first().map_or("no reason given", |reason| reason.text);
    let why = why.split_once(':').map_or(why, |(what, _)| what);
    let lead = [
        heading("Overload: withheld"),
        Line::styled(cut(&format!(" {}", why.trim_end_matches('.')), width as u16), faint()),
    ];
    lead.into_iter().chain(rows).collect()
}

/// A bar with a resolution of an eighth of a column; a share above 1 fills it.
fn bar(fraction: f64, width: usize) -> String {
    const EIGHTHS: [&str; 8] = ["", "▏", "▎", "▍", "▌", "▋", "▊", "▉"];
    let eighths = (fraction.clamp(0.0, 1.0) * 8.0 * width as f64).round() as usize;
    format!("{}{}", "█".repeat(eighths / 8), EIGHTHS[eighths % 8])
}

/// Style of a level's bar.
fn colour(style: &LevelStyle) -> Color {
    let [r, g, b] = style.rgb();
    Color::Rgb(r, g, b)
}

/// Sign and word of a level, legible on any ground.
fn badge(level: u32, style: &LevelStyle) -> Span<'static> {
    let [r, g, b] = style.ink_rgb();
    let text = format!(" {} {:<10} ", style.sign, words::level(level));
    Span::styled(text, Style::new().fg(Color::Rgb(r, g, b)).bg(colour(style)))
}
