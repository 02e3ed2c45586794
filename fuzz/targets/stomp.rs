//! Fuzzes the estimate of the time offset from stomps.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("stomp", bytes));
