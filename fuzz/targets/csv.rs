//! Fuzzes the readers of CSV captures.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("csv", bytes));
