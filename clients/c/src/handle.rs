//! `equipoise_consumer`: a consumer bound to the thread that opened it.

use crate::layout::layout;
use crate::outcome::{Refusal, c_text};
use crate::reading::{EarlyReading, Reading};
use equipoise_client::{Consumer, ConsumerSettings, NoReading};
use equipoise_core::message::Validity;
use std::ffi::{CStr, CString};
use std::sync::OnceLock;
use std::thread::{self, ThreadId};
use std::time::Duration;

/// `equipoise_options` of the header.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Layout that the program was compiled with: see [`layout`].
    pub layout: u64,
    /// Maximum age of a returned state; 0 for the default of 25 ms.
    pub stale_after_ns: u64,
    /// Queue length while the program is busy; 0 for the default of 8 states.
    pub depth: u32,
    /// 1: do not publish the consumer report (delays of states).
    pub no_report: u32,
}

impl Options {
    fn settings(&self, station: &str, name: &str) -> Result<ConsumerSettings, Refusal> {
        if self.layout != layout() {
            return Err(Refusal::wrong_use(&format!(
                "this program was compiled with another equipoise.h (layout 0x{:016x}, the library's is 0x{:016x}): \
                 compile it again with the header of this library",
                self.layout,
                layout()
            )));
        }
        let mut settings = ConsumerSettings::new(station, name);
        if self.stale_after_ns > 0 {
            settings.stale_after = Duration::from_nanos(self.stale_after_ns);
        }
        if self.depth > 0 {
            settings.depth = self.depth as usize;
        }
        settings.report = self.no_report == 0;
        Ok(settings)
    }
}

/// A consumer, and the thread that owns it.
#[derive(Debug)]
pub struct Handle {
    /// Never written after creation, and never covered by a reference to other fields, so any thread may read it at any
    /// time.
    pub(crate) owner: ThreadId,
    /// Accessed by the owning thread only.
    pub(crate) opened: Opened,
}

/// Data that only the owning thread may access.
#[derive(Debug)]
pub struct Opened {
    consumer: Consumer,
    report_refusal: CString,
}

impl Handle {
    /// Joins the station.
    ///
    /// # Errors
    /// Text that is not UTF-8, a different header, or a station that cannot be joined.
    pub fn open(station: &CStr, name: &CStr, options: &Options) -> Result<Handle, Refusal> {
        let utf8 = |text: &'_ CStr| text.to_str().map(str::to_owned);
        let (Ok(station), Ok(name)) = (utf8(station), utf8(name)) else {
            return Err(Refusal::wrong_use("station and name must be UTF-8"));
        };
        let consumer = Consumer::join_with(options.settings(&station, &name)?)?;
        let opened = Opened { consumer, report_refusal: CString::default() };
        Ok(Handle { owner: thread::current().id(), opened })
    }
}

/// Checks that the calling thread opened the consumer.
///
/// # Errors
/// It is a different thread.
pub fn check_owner(owner: ThreadId) -> Result<(), Refusal> {
    if thread::current().id() == owner {
        return Ok(());
    }
    Err(Refusal::wrong_use("a consumer belongs to the thread that opened it: open one in each thread"))
}

impl Opened {
    /// Converts the result of `read`.
    ///
    /// # Errors
    /// The reason why there is no current state.
    pub fn read(
        &mut self,
        read: impl FnOnce(&mut Consumer) -> Result<equipoise_client::Reading, NoReading>,
    ) -> Result<Reading, Refusal> {
        Ok(read(&mut self.consumer)?.into())
    }

    /// The newest early state.
    ///
    /// # Errors
    /// The reason why there is no current one.
    pub fn early(&mut self) -> Result<EarlyReading, Refusal> {
        Ok(self.consumer.early()?.into())
    }

    /// Why the consumer report is not published; empty if it is, or if it was disabled.
    pub fn report_refusal(&mut self) -> &CStr {
        let text = self.consumer.report_refusal().map(ToString::to_string);
        self.report_refusal = c_text(text.as_deref().unwrap_or_default());
        &self.report_refusal
    }
}

/// Name of a bit of `State::valid`; `None` for an unused bit.
pub fn reason_name(bit: u32) -> Option<&'static CStr> {
    static NAMES: OnceLock<Vec<CString>> = OnceLock::new();
    let names = NAMES.get_or_init(|| Validity::NAMES.iter().map(|(_, name)| c_text(name)).collect());
    let at = Validity::NAMES.iter().position(|(reason, _)| reason.0.trailing_zeros() == bit)?;
    names.get(at).map(CString::as_c_str)
}
