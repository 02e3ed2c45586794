//! Fuzzes the answers and the data stream of Kistler LabAmp devices.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("labamp", bytes));
