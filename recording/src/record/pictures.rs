//! Scene and state for viewers, in addition to the data for replays.

use equipoise_adapters::recording::{ExtraChannel, Recorder};
use equipoise_core::message::State;
use equipoise_core::time::NS_PER_S;
use equipoise_view::foxglove::{Channel, MESSAGE_ENCODING, SCHEMA_ENCODING, scene, state_text};

/// Periodically writes the picture of a state.
pub(super) struct Pictures {
    /// `None`: no pictures.
    period_ns: Option<u64>,
    due_ns: u64,
}

impl Pictures {
    /// Creates the channels for `rate_hz` pictures per second; 0 disables them.
    pub(super) fn announce(recorder: &mut Recorder, rate_hz: f64) -> anyhow::Result<Pictures> {
        let period_ns = (rate_hz > 0.0).then(|| ((NS_PER_S as f64 / rate_hz) as u64).max(1));
        for channel in Channel::ALL.iter().filter(|_| period_ns.is_some()) {
            recorder.announce(&ExtraChannel {
                topic: channel.topic,
                schema_name: channel.schema_name,
                schema_encoding: SCHEMA_ENCODING,
                schema_text: channel.schema_text(),
                message_encoding: MESSAGE_ENCODING,
            })?;
        }
        Ok(Pictures { period_ns, due_ns: 0 })
    }

    /// Writes the picture of a state if one is due: at the first state at or after each multiple of the period.
    pub(super) fn add(&mut self, recorder: &mut Recorder, state: &State) -> anyhow::Result<()> {
        let (Some(period_ns), time_ns) = (self.period_ns, state.time_ns) else { return Ok(()) };
        if time_ns < self.due_ns {
            return Ok(());
        }
        self.due_ns = (time_ns / period_ns + 1) * period_ns;
        let scene = scene::of(state, time_ns).to_text()?;
        recorder.write_extra(Channel::SCENE.topic, time_ns, scene.as_bytes())?;
        recorder.write_extra(Channel::STATE.topic, time_ns, state_text(state)?.as_bytes())?;
        Ok(())
    }
}
