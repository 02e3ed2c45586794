//! Fuzzes descriptions and data streams of the Lab Streaming Layer.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("lsl", bytes));
