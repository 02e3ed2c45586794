//! From the feed to whoever watches: only the newest frame is kept, so nobody can fall behind.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{Instant, MissedTickBehavior, interval};

use super::{FRAME_RATE_HZ, PageFrame};
use crate::banner::{Banner, Headline};

/// After this long without a new cycle, the service is called silent, again and again at this pace.
const SILENT_AFTER: Duration = Duration::from_secs(1);

/// What there is to tell: the newest texts, made once for all watchers.
#[derive(Debug, Clone)]
pub(super) enum Newest {
    /// The feed gives nothing, or nothing new.
    Silent,
    /// A state of within the last second.
    State {
        /// For the page's script.
        frame: Arc<str>,
        /// For `/api/state`.
        state: Arc<str>,
    },
}

/// Asks `feed` at the page's rate and tells `newest`, for ever.
pub(super) async fn follow<F>(mut feed: F, newest: watch::Sender<Newest>)
where
    F: FnMut() -> Option<PageFrame>,
{
    let mut ticks = interval(Duration::from_secs(1) / FRAME_RATE_HZ);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let mut shown = None;
    let mut banner = Banner::default();
    let mut told = Instant::now();
    loop {
        ticks.tick().await;
        // Both numbers: a daemon that starts anew counts its cycles anew.
        let news = feed().filter(|frame| shown != Some((frame.state.cycle, frame.state.time_ns)));
        if let Some(frame) = news {
            shown = Some((frame.state.cycle, frame.state.time_ns));
            let headline = banner.update(&frame.state, frame.pose());
            if let Ok(texts) = texts(&frame, headline) {
                told = Instant::now();
                newest.send_replace(texts);
            }
        } else if told.elapsed() >= SILENT_AFTER {
            told = Instant::now();
            newest.send_replace(Newest::Silent);
        }
    }
}

fn texts(frame: &PageFrame, headline: &Headline) -> serde_json::Result<Newest> {
    Ok(Newest::State { frame: frame.to_text(headline)?.into(), state: frame.state_json().to_text()?.into() })
}
