//! Fuzzes the reader of MVNX files.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("mvnx", bytes));
