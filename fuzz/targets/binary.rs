//! Fuzzes readers of binary frames described in the configuration.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("binary", bytes));
