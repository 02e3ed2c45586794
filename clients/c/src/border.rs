//! Where C calls in. All unsafe code of the clients is here: pointers are looked at, and turned into references.
//!
//! What cannot be checked is the caller's promise, made in `equipoise.h`: a pointer that is not null points to what its
//! type says, for as long as the call runs, and nobody else uses it meanwhile.
#![expect(unsafe_code, reason = "C hands over pointers; everything behind them is safe code")]

use crate::handle::{Handle, Opened, Options, check_owner, reason_name};
use crate::outcome::{Outcome, Refusal, guard, last_error};
use crate::reading::Reading;
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

/// What a pointer points to, to be changed.
///
/// # Safety
/// If it is not null: nobody else uses it during `'a`, and it was initialised (which `MaybeUninit` always is).
unsafe fn target<'a, T>(pointer: *mut T, what: &str) -> Result<&'a mut T, Refusal> {
    check(pointer, what)?;
    // SAFETY: not null and aligned, just checked; initialised and not shared, by the caller's promise.
    Ok(unsafe { &mut *pointer })
}

/// What a pointer points to, to be read.
///
/// # Safety
/// If it is not null: nobody changes it during `'a`, and it was initialised.
unsafe fn source<'a, T>(pointer: *const T, what: &str) -> Result<&'a T, Refusal> {
    check(pointer, what)?;
    // SAFETY: not null and aligned, just checked; initialised and not changed, by the caller's promise.
    Ok(unsafe { &*pointer })
}

/// What the calling thread may touch of a consumer, if it opened it.
///
/// Its owner may be inside a call at this moment, with a reference to [`Opened`]: so there is none, not even a shared one,
/// before it is known whose it is.
///
/// # Safety
/// If it is not null: it came from [`equipoise_open`] and was not closed.
unsafe fn owned<'a>(consumer: *mut Handle) -> Result<&'a mut Opened, Refusal> {
    check(consumer, "consumer")?;
    // SAFETY: not null and aligned, just checked, and whole by the caller's promise. Nobody writes the owner while the
    // handle lives, and no reference covers it.
    check_owner(unsafe { (&raw const (*consumer).owner).read() })?;
    // SAFETY: as above; and this is the one thread that makes references to it, one call after the other.
    Ok(unsafe { &mut (*consumer).opened })
}

/// A text of C.
///
/// # Safety
/// If it is not null: it ends with a zero byte, and nobody changes it during `'a`.
unsafe fn text<'a>(pointer: *const c_char, what: &str) -> Result<&'a CStr, Refusal> {
    if pointer.is_null() {
        return Err(Refusal::wrong_use(&format!("{what} is null")));
    }
    // SAFETY: not null, just checked; the rest is the caller's promise.
    Ok(unsafe { CStr::from_ptr(pointer) })
}

/// Joins a station; see `equipoise.h`.
///
/// # Safety
/// Each pointer is null or as its type says, and is used by nobody else during the call; texts end with a zero byte.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn equipoise_open(
    station: *const c_char,
    name: *const c_char,
    options: *const Options,
    consumer: *mut *mut Handle,
) -> c_int {
    guard(|| {
        // SAFETY: by this function's own contract, and a pointer that is about to be written needs no value.
        let place = unsafe { target(consumer.cast::<MaybeUninit<*mut Handle>>(), "consumer") }?;
        place.write(ptr::null_mut());
        // SAFETY: by this function's own contract.
        let (station, name, options) =
            unsafe { (text(station, "station")?, text(name, "name")?, source(options, "options")?) };
        place.write(Box::into_raw(Box::new(Handle::open(station, name, options)?)));
        Ok(())
    })
}

/// The next state; see `equipoise.h`.
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

/// The newest state; see `equipoise.h`.
///
/// # Safety
/// As [`equipoise_next`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn equipoise_latest(consumer: *mut Handle, reading: *mut Reading) -> c_int {
    // SAFETY: the same contract.
    unsafe { read(consumer, reading, Consumer::latest) }
}

/// # Safety
/// As [`equipoise_next`].
unsafe fn read(
    consumer: *mut Handle,
    reading: *mut Reading,
    how: impl FnOnce(&mut Consumer) -> Result<equipoise_client::Reading, NoReading>,
) -> c_int {
    guard(|| {
        // SAFETY: by this function's own contract, and a reading that is about to be written needs no value.
        let place = unsafe { target(reading.cast::<MaybeUninit<Reading>>(), "reading") }?;
        // Whatever happens from here on, nothing of an earlier reading is left in it.
        place.write(Reading::nothing());
        // SAFETY: by this function's own contract.
        let opened = unsafe { owned(consumer) }?;
        place.write(opened.read(how)?);
        Ok(())
    })
}

/// Leaves the station; see `equipoise.h`.
///
/// # Safety
/// `consumer` is null or came from [`equipoise_open`], and is not used again after it was closed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn equipoise_close(consumer: *mut Handle) -> c_int {
    if consumer.is_null() {
        return Outcome::Ok as c_int;
    }
    guard(|| {
        // SAFETY: by this function's own contract.
        unsafe { owned(consumer) }?;
        // SAFETY: it came out of `Box::into_raw` in `equipoise_open`, and is never used again.
        drop(unsafe { Box::from_raw(consumer) });
        Ok(())
    })
}

/// Why a consumer's report is not published; see `equipoise.h`.
///
/// # Safety
/// As [`equipoise_next`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn equipoise_report_refusal(consumer: *mut Handle) -> *const c_char {
    let mut told = ptr::null();
    guard(|| {
        // SAFETY: by this function's own contract.
        told = unsafe { owned(consumer) }?.report_refusal().as_ptr();
        Ok(())
    });
    // Nothing is known of that report then; "" would say that it is published.
    if told.is_null() { equipoise_error() } else { told }
}

/// The sentence of this thread's last call that was refused; see `equipoise.h`.
#[unsafe(no_mangle)]
pub extern "C" fn equipoise_error() -> *const c_char {
    last_error(CStr::as_ptr)
}

/// The name of a reason; see `equipoise.h`.
#[unsafe(no_mangle)]
pub extern "C" fn equipoise_reason_name(bit: u32) -> *const c_char {
    reason_name(bit).map_or(ptr::null(), CStr::as_ptr)
}
