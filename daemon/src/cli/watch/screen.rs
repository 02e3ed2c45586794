//! The screen: draws ten times a second, listens to keys, and leaves the terminal as it found it however it ends.

use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context;
use equipoise_view::watch::{Watch, draw};
use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};

use super::Until;
use super::eyes::Eyes;
use crate::model::suggestion;
use crate::realtime::now_ns;

/// How often the screen is drawn; a key or another size draws it at once.
const DRAW_EVERY: Duration = Duration::from_millis(100);

/// Shows the station until a key, a signal or the time ends it.
pub(super) fn run(station: &str, until: &Until) -> anyhow::Result<()> {
    // Whoever closes the terminal, or asks for a core dump, is owed a terminal in order, too.
    for signal in [signal_hook::consts::SIGHUP, signal_hook::consts::SIGQUIT] {
        signal_hook::flag::register(signal, Arc::clone(&until.stop))?;
    }
    let mut eyes = Eyes::open(station)?;
    // It also has a panic put the terminal in order before it is told.
    let mut terminal = ratatui::try_init().context("cannot draw on this terminal")?;
    let ended = show(&mut terminal, station, &mut eyes, until);
    let restored = ratatui::try_restore().context("cannot put the terminal in order: type `reset`");
    ended.and(restored)
}

fn show(terminal: &mut DefaultTerminal, station: &str, eyes: &mut Eyes, until: &Until) -> anyhow::Result<()> {
    let mut help = false;
    while !until.is_over() {
        eyes.look();
        let state = eyes.state();
        let (pose, sensors) = (state.and_then(|state| suggestion(state, eyes.ask.as_ref())), eyes.sensors());
        let watch = Watch {
            station,
            subject: &eyes.subject,
            state,
            silent_s: eyes.silent_s(),
            pose: pose.as_deref(),
            sensors: &sensors,
            incidents: eyes.incidents.as_ref(),
            latency: eyes.latency.as_ref(),
            now_ns: now_ns(),
            help,
        };
        terminal.draw(|frame| draw(frame, &watch))?;
        let drawn = Instant::now();
        while let Some(left) = DRAW_EVERY.checked_sub(drawn.elapsed()) {
            if !event::poll(left)? {
                break;
            }
            match event::read()? {
                Event::Key(key) if ends(key) => return Ok(()),
                Event::Key(key) if key.code == KeyCode::Char('?') && is_pressed(key) => {
                    help = !help;
                    break;
                }
                Event::Resize(..) => break,
                _ => {}
            }
        }
    }
    Ok(())
}

fn is_pressed(key: KeyEvent) -> bool {
    key.kind != KeyEventKind::Release
}

/// In the terminal's raw mode Ctrl-C is a key like any other.
fn ends(key: KeyEvent) -> bool {
    let control = key.modifiers.contains(KeyModifiers::CONTROL);
    is_pressed(key)
        && match key.code {
            KeyCode::Char('c' | 'd') => control,
            KeyCode::Char('q') | KeyCode::Esc => true,
            _ => false,
        }
}
