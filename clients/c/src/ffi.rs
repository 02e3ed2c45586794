//! Entry points for C. All unsafe code of the clients is in this file: it checks pointers and converts them to
//! references.
//!
//! Conditions that cannot be checked are part of the contract in `equipoise.h`: a non-null pointer points to a value of
//! its type for the duration of the call, and no other code uses that value meanwhile.
#![expect(unsafe_code, reason = "C hands over pointers; everything behind them is safe code")]

use crate::handle::{Handle, Opened, Options, check_owner, reason_name};
use crate::outcome::{Outcome, Refusal, guard, last_error};
use crate::reading::{EarlyReading, Reading};
use equipoise_client::{Consumer, NoReading};
use std::ffi::{CStr, c_char, c_int};
use std::mem::MaybeUninit;
use std::ptr;
use std::time::Duration;

fn check<T>(pointer: *const T, what: &str) -> Result<(), Refusal> {
    if pointer.is_null() || !pointer.is_aligned() {
        return Err(Refusal::wrong_use(&format!("{what} is null, or not aligned as its type asks")));
    }
    Ok(())
}

/// Converts a pointer to a mutable reference.
///
/// # Safety
/// If not null: the target is not accessed otherwise during `'a`, and is initialised (which `MaybeUninit` always is).
unsafe fn target<'a, T>(pointer: *mut T, what: &str) -> Result<&'a mut T, Refusal> {
    check(pointer, what)?;
    // SAFETY: not null and aligned, checked above; initialised and not shared, by the caller's contract.
    Ok(unsafe { &mut *pointer })
}

/// Converts a pointer to a shared reference.
///
/// # Safety
/// If not null: the target does not change during `'a`, and is initialised.
unsafe fn source<'a, T>(pointer: *const T, what: &str) -> Result<&'a T, Refusal> {
    check(pointer, what)?;
    // SAFETY: not null and aligned, checked above; initialised and not changed, by the caller's contract.
    Ok(unsafe { &*pointer })
}

/// The part of a consumer that its owning thread may use; fails on other threads.
///
/// The owning thread may be inside a call now and hold a reference to [`Opened`]. Therefore no reference, not even a
/// shared one, is created before the owner is checked.
///
/// # Safety
/// If not null: the pointer came from [`equipoise_open`] and was not closed.
unsafe fn owned<'a>(consumer: *mut Handle) -> Result<&'a mut Opened, Refusal> {
    check(consumer, "consumer")?;
    // SAFETY: not null and aligned, checked above, and valid by the caller's contract. The owner is never written while
    // the handle exists, and no reference covers it.
    check_owner(unsafe { (&raw const (*consumer).owner).read() })?;
    // SAFETY: as above; and only this thread creates references to it, one call after the other.
    Ok(unsafe { &mut (*consumer).opened })
}

/// Converts a C string.
///
/// # Safety
/// If not null: it ends with a zero byte, and does not change during `'a`.
unsafe fn text<'a>(pointer: *const c_char, what: &str) -> Result<&'a CStr, Refusal> {
    if pointer.is_null() {
        return Err(Refusal::wrong_use(&format!("{what} is null")));
    }
    // SAFETY: not null, checked above; the rest by the caller's contract.
    Ok(unsafe { CStr::from_ptr(pointer) })
}

/// Joins a station; see `equipoise.h`.
///
/// # Safety
/// Each pointer is null or valid for its type, and its target is not accessed otherwise during the call; strings end
/// with a zero byte.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn equipoise_open(
    station: *const c_char,
    name: *const c_char,
    options: *const Options,
    consumer: *mut *mut Handle,
) -> c_int {
    guard(|| {
        // SAFETY: by this function's contract; a pointer that is only written need not be initialised.
        let place = unsafe { target(consumer.cast::<MaybeUninit<*mut Handle>>(), "consumer") }?;
        place.write(ptr::null_mut());
        // SAFETY: by this function's contract.
        let (station, name, options) =
            unsafe { (text(station, "station")?, text(name, "name")?, source(options, "options")?) };
        place.write(Box::into_raw(Box::new(Handle::open(station, name, options)?)));
        Ok(())
    })
}

/// Reads the next state; see `equipoise.h`.
///
/// # Safety
/// `consumer` is null or came from [`equipoise_open`] and was not closed; `reading` is null or has room for one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn equipoise_next(
    consumer: *mut Handle,
    timeout_ns: u64,
    reading: *mut Reading,
) -> c_int {
    // SAFETY: the same contract.
    unsafe { read(consumer, reading, |consumer| consumer.next(Duration::from_nanos(timeout_ns))) }
}

/// Reads the newest state; see `equipoise.h`.
///
/// # Safety
/// As [`equipoise_next`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn equipoise_latest(consumer: *mut Handle, reading: *mut Reading) -> c_int {
    // SAFETY: the same contract.
    unsafe { read(consumer, reading, Consumer::latest) }
}

/// Reads the newest early state; see `equipoise.h`.
///
/// # Safety
/// As [`equipoise_next`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn equipoise_early(consumer: *mut Handle, reading: *mut EarlyReading) -> c_int {
    guard(|| {
        // SAFETY: by this function's contract; a reading that is only written need not be initialised.
        let place = unsafe { target(reading.cast::<MaybeUninit<EarlyReading>>(), "reading") }?;
        // On any later failure, no earlier reading remains in the target.
        place.write(EarlyReading::nothing());
        // SAFETY: by this function's contract.
        let opened = unsafe { owned(consumer) }?;
        place.write(opened.early()?);
        Ok(())
    })
}

/// # Safety
/// As [`equipoise_next`].
unsafe fn read(
    consumer: *mut Handle,
    reading: *mut Reading,
    how: impl FnOnce(&mut Consumer) -> Result<equipoise_client::Reading, NoReading>,
) -> c_int {
    guard(|| {
        // SAFETY: by this function's contract; a reading that is only written need not be initialised.
        let place = unsafe { target(reading.cast::<MaybeUninit<Reading>>(), "reading") }?;
        // On any later failure, no earlier reading remains in the target.
        place.write(Reading::nothing());
        // SAFETY: by this function's contract.
        let opened = unsafe { owned(consumer) }?;
        place.write(opened.read(how)?);
        Ok(())
    })
}

/// Leaves the station; see `equipoise.h`.
///
/// # Safety
/// `consumer` is null or came from [`equipoise_open`], and is not used after this call.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn equipoise_close(consumer: *mut Handle) -> c_int {
    if consumer.is_null() {
        return Outcome::Ok as c_int;
    }
    guard(|| {
        // SAFETY: by this function's contract.
        unsafe { owned(consumer) }?;
        // SAFETY: it came from `Box::into_raw` in `equipoise_open`, and is not used after this call.
        drop(unsafe { Box::from_raw(consumer) });
        Ok(())
    })
}

/// Returns why a consumer's report is not published; see `equipoise.h`.
///
/// # Safety
/// As [`equipoise_next`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn equipoise_report_refusal(consumer: *mut Handle) -> *const c_char {
    let mut refusal = ptr::null();
    guard(|| {
        // SAFETY: by this function's contract.
        refusal = unsafe { owned(consumer) }?.report_refusal().as_ptr();
        Ok(())
    });
    // The call failed, so the report's status is unavailable; "" would mean that it is published.
    if refusal.is_null() { equipoise_error() } else { refusal }
}

/// Error text of this thread's last refused call; see `equipoise.h`.
#[unsafe(no_mangle)]
pub extern "C" fn equipoise_error() -> *const c_char {
    last_error(CStr::as_ptr)
}

/// Name of a validity flag; see `equipoise.h`.
#[unsafe(no_mangle)]
pub extern "C" fn equipoise_reason_name(bit: u32) -> *const c_char {
    reason_name(bit).map_or(ptr::null(), CStr::as_ptr)
}
