//! Report on the delays of states, published once a second.

use crate::clock::now_ns;
use bytemuck::Zeroable;
use equipoise_bus::{Bus, BusError, Publisher};
use equipoise_core::message::{ConsumerReceipt, State};
use equipoise_core::time::NS_PER_S;

const PUBLISH_EVERY_NS: u64 = NS_PER_S;
/// Retry interval for a report without a place: another consumer may have left.
const TRY_AGAIN_AFTER_NS: u64 = 10 * NS_PER_S;

/// Maintains the report of one consumer, and publishes it if enabled.
#[derive(Debug)]
pub(crate) struct Reporting {
    report: Box<ConsumerReceipt>,
    wanted: bool,
    publisher: Option<Publisher<ConsumerReceipt>>,
    refusal: Option<BusError>,
    due_ns: u64,
}

impl Reporting {
    /// An empty report. `name` is a role name, and therefore fits into the field.
    pub(crate) fn new(name: &str, wanted: bool) -> Reporting {
        let mut report = Box::new(ConsumerReceipt::zeroed());
        let bytes = name.len().min(report.consumer.len());
        report.consumer[..bytes].copy_from_slice(&name.as_bytes()[..bytes]);
        report.process_id = std::process::id();
        report.since_ns = now_ns();
        let due_ns = report.since_ns + PUBLISH_EVERY_NS;
        Reporting { report, wanted, publisher: None, refusal: None, due_ns }
    }

    pub(crate) fn report(&self) -> &ConsumerReceipt {
        &self.report
    }

    pub(crate) fn refusal(&self) -> Option<&BusError> {
        self.refusal.as_ref()
    }

    /// Counts one state; see [`ConsumerReceipt::enter`].
    pub(crate) fn enter(&mut self, now_ns: u64, state: &State, missed: u64, suit: Option<u64>) {
        self.report.enter(now_ns, state, missed, suit);
    }

    /// Opens a publisher for reports. A failure does not prevent reading.
    pub(crate) fn open(&mut self, bus: &Bus) {
        if !self.wanted {
            return;
        }
        match bus.publisher() {
            Ok(publisher) => (self.publisher, self.refusal) = (Some(publisher), None),
            Err(error) => {
                (self.publisher, self.refusal) = (None, Some(error));
                self.due_ns = now_ns() + TRY_AGAIN_AFTER_NS;
            }
        }
    }

    /// Closes the publisher; must precede closing its bus.
    pub(crate) fn close(&mut self) {
        self.publisher = None;
    }

    /// Publishes if a second has passed; retries to open the publisher if that failed.
    pub(crate) fn keep_up(&mut self, bus: &Bus, now_ns: u64) {
        if !self.wanted || now_ns < self.due_ns {
            return;
        }
        if self.publisher.is_none() {
            self.open(bus);
        }
        self.publish();
    }

    /// Publishes now, if the publisher is open.
    pub(crate) fn publish(&mut self) {
        let Some(publisher) = &self.publisher else { return };
        self.report.time_ns = now_ns();
        self.due_ns = self.report.time_ns + PUBLISH_EVERY_NS;
        if let Err(error) = publisher.send(&self.report) {
            self.refusal = Some(error);
            self.close();
            self.due_ns += TRY_AGAIN_AFTER_NS;
        }
    }
}
