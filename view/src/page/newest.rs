//! Distributes frames from the feed to viewers: only the newest frame is kept, so that no viewer falls behind.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{Instant, MissedTickBehavior, interval};

use super::{FRAME_RATE_HZ, PageFrame};
use crate::banner::{Banner, Headline};

/// Time without a new cycle after which the service is reported silent, repeatedly at this interval.
const SILENT_AFTER: Duration = Duration::from_secs(1);

/// The newest texts, generated once for all viewers.
#[derive(Debug, Clone)]
pub(super) enum Newest {
    /// The feed returned no new frame.
    Silent,
    /// A state of the last second.
    State {
        /// JSON for the page's script.
        frame: Arc<str>,
        /// JSON for `/api/state`.
        state: Arc<str>,
    },
    /// The demonstration has ended, with these results as JSON.
    Ended(Arc<str>),
}

/// Polls `feed` at the page's rate and updates `newest`; does not return.
pub(super) async fn run_frame_feed<F>(mut feed: F, newest: watch::Sender<Newest>)
where
    F: FnMut() -> Option<PageFrame>,
{
    let mut ticks = interval(Duration::from_secs(1) / FRAME_RATE_HZ);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let mut last_frame_id = None;
    let mut banner = Banner::default();
    let mut sent_at = Instant::now();
    loop {
        ticks.tick().await;
        // Compares both numbers, because cycle numbers start again when the daemon restarts.
        let new_frame =
            feed().filter(|frame| last_frame_id != Some((frame.state.cycle, frame.state.time_ns)));
        if let Some(frame) = new_frame {
            last_frame_id = Some((frame.state.cycle, frame.state.time_ns));
            let headline = banner.update(&frame.state, frame.pose());
            if let Ok(texts) = texts(&frame, headline) {
                sent_at = Instant::now();
                newest.send_replace(texts);
            }
        } else if sent_at.elapsed() >= SILENT_AFTER {
            sent_at = Instant::now();
            newest.send_replace(Newest::Silent);
        }
    }
}

fn texts(frame: &PageFrame, headline: &Headline) -> serde_json::Result<Newest> {
    Ok(Newest::State { frame: frame.to_text(headline)?.into(), state: frame.state_json().to_text()?.into() })
}
