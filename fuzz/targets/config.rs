//! Fuzzes the parser of the configuration file.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("config", bytes));
