//! Result of a call: a number for the program, a text for people. Panics do not cross the C interface.

use equipoise_bus::BusError;
use equipoise_client::NoReading;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_int};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// The numbers of `enum equipoise_outcome`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(i32)]
pub enum Outcome {
    /// Done.
    Ok = 0,
    /// No new state arrived in time: the daemon is not running, or hangs.
    Silent = 1,
    /// States arrived, but all were too old to be returned.
    Stale = 2,
    /// The daemon has another CLOCK_MONOTONIC: both must run in one time namespace.
    OtherClock = 3,
    /// The bus cannot be joined or read. An open consumer rejoins by itself.
    Bus = 4,
    /// The call is invalid: a null pointer, another thread's consumer, another header.
    WrongUse = 5,
    /// A defect of this library.
    Defect = 6,
}

impl Outcome {
    /// All outcomes with their names in the header.
    pub const ALL: [(Outcome, &'static str); 7] = [
        (Outcome::Ok, "EQUIPOISE_OK"),
        (Outcome::Silent, "EQUIPOISE_SILENT"),
        (Outcome::Stale, "EQUIPOISE_STALE"),
        (Outcome::OtherClock, "EQUIPOISE_OTHER_CLOCK"),
        (Outcome::Bus, "EQUIPOISE_BUS"),
        (Outcome::WrongUse, "EQUIPOISE_WRONG_USE"),
        (Outcome::Defect, "EQUIPOISE_DEFECT"),
    ];
}

/// Why a call failed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// The result number.
    pub outcome: Outcome,
    /// The error text.
    pub text: String,
}

impl Refusal {
    /// A refusal of an invalid call.
    pub fn wrong_use(text: &str) -> Refusal {
        Refusal { outcome: Outcome::WrongUse, text: text.to_owned() }
    }
}

impl From<BusError> for Refusal {
    fn from(error: BusError) -> Refusal {
        Refusal { outcome: Outcome::Bus, text: error.to_string() }
    }
}

impl From<NoReading> for Refusal {
    fn from(reason: NoReading) -> Refusal {
        let outcome = match &reason {
            NoReading::Silent { .. } => Outcome::Silent,
            NoReading::Stale { .. } => Outcome::Stale,
            NoReading::OtherClock { .. } => Outcome::OtherClock,
            NoReading::Bus(_) => Outcome::Bus,
        };
        Refusal { outcome, text: reason.to_string() }
    }
}

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::default();
}

/// Runs one C call, stores its error text for [`last_error`], and converts a panic to [`Outcome::Defect`].
pub fn guard(call: impl FnOnce() -> Result<(), Refusal>) -> c_int {
    let ended = catch_unwind(AssertUnwindSafe(call));
    let (outcome, text) = match ended {
        Ok(Ok(())) => return Outcome::Ok as c_int,
        Ok(Err(Refusal { outcome, text })) => (outcome, text),
        Err(_) => {
            let text = "a defect of the library; standard error has its place".to_owned();
            (Outcome::Defect, text)
        }
    };
    LAST_ERROR.with_borrow_mut(|last| *last = c_text(&text));
    outcome as c_int
}

/// Calls `look` with the error text of this thread's last refused call; empty if there was none.
pub fn last_error<R>(look: impl FnOnce(&CStr) -> R) -> R {
    LAST_ERROR.with_borrow(|last| look(last))
}

/// Converts a text to a C string; it is cut at the first zero byte.
pub(crate) fn c_text(text: &str) -> CString {
    let bytes: Vec<u8> = text.bytes().take_while(|byte| *byte != 0).collect();
    CString::new(bytes).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error_text() -> String {
        last_error(|text| text.to_string_lossy().into_owned())
    }

    #[test]
    fn a_panic_is_caught_and_reported() {
        assert_eq!(guard(|| panic!("meant")), Outcome::Defect as c_int);
        assert!(error_text().contains("defect"), "{}", error_text());
    }

    #[test]
    fn a_refusal_is_reported_until_the_next_one() {
        assert_eq!(guard(|| Err(Refusal::wrong_use("so not"))), Outcome::WrongUse as c_int);
        assert_eq!(guard(|| Ok(())), Outcome::Ok as c_int);
        assert_eq!(error_text(), "so not");
        assert_eq!(guard(|| Err(Refusal::wrong_use("cut\0off"))), Outcome::WrongUse as c_int);
        assert_eq!(error_text(), "cut");
    }
}
