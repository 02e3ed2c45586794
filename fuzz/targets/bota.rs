//! Fuzzes the parser and the set-up of Bota sensors on a serial line.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("bota", bytes));
