//! Fuzzes the reader of recordings (MCAP).
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("recording", bytes));
