//! Fuzzes the parser and the dialogue of AMTI plates on a serial line.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("amti", bytes));
