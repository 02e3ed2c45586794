//! Requests a stream, and repeats the request while the device is silent; common to all devices that stream on request.

use super::Action;

/// Retry interval of a lost request, …
const RETRY_NS: u64 = 100_000_000;
/// … for this many retries, …
const QUICK_RETRIES: u32 = 10;
/// … and then, as the device is probably off, this interval.
const SLOW_RETRY_NS: u64 = 1_000_000_000;
/// A stream that is silent for this long has ended: the device was restarted, or another client took over the stream.
const SILENCE_NS: u64 = 500_000_000;

/// A request and its timing.
#[derive(Debug, Clone)]
pub(super) struct Asking {
    request: Vec<u8>,
    last_data_ns: Option<u64>,
    last_request_ns: u64,
    requests: u32,
    /// Set if a request was sent since the last data: the sequence may restart from zero.
    asked: bool,
}

impl Asking {
    pub(super) fn new(request: Vec<u8>) -> Asking {
        Asking { request, last_data_ns: None, last_request_ns: 0, requests: 0, asked: false }
    }

    /// The connection was opened (again).
    pub(super) fn opened(&mut self) {
        self.last_data_ns = None;
        self.requests = 0;
    }

    /// Whether the present data answer a request; `true` once for each request.
    pub(super) fn is_answer(&mut self) -> bool {
        core::mem::take(&mut self.asked)
    }

    /// Whether the device streamed until now; resets that state, so that later data count as unsolicited.
    pub(super) fn take_streaming(&mut self) -> bool {
        self.last_data_ns.take().is_some()
    }

    /// Data arrived: the device streams.
    pub(super) fn register_arrival(&mut self, arrival_ns: u64) {
        self.last_data_ns = Some(arrival_ns);
        self.requests = 0;
    }

    pub(super) fn next_action(&mut self, now_ns: u64) -> Action {
        let pause_ns = if self.requests < QUICK_RETRIES { RETRY_NS } else { SLOW_RETRY_NS };
        let streams = self.last_data_ns.is_some_and(|last_ns| now_ns.saturating_sub(last_ns) < SILENCE_NS);
        if streams || (self.requests > 0 && now_ns.saturating_sub(self.last_request_ns) < pause_ns) {
            return Action::Nothing;
        }
        self.last_request_ns = now_ns;
        self.requests = self.requests.saturating_add(1);
        self.asked = true;
        Action::Send(self.request.clone())
    }
}
