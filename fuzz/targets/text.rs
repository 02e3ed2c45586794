//! Fuzzes readers of text lines described in the configuration.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("text", bytes));
