//! Fuzzes the dialogue and the data blocks of Tec Gihan plates.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("tec_gihan", bytes));
