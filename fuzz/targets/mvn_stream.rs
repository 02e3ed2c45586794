//! Fuzzes the division of an MVN TCP stream into datagrams.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("mvn_stream", bytes));
