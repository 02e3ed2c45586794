//! Fuzzes the reader of BioWare text exports.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("bioware", bytes));
