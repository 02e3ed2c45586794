//! Fuzzes the packets and the dialogue of Qualisys Track Manager.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("qtm", bytes));
