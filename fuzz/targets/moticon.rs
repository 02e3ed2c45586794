//! Fuzzes the datagrams of Moticon insoles.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("moticon", bytes));
