//! Fuzzes the parser of single MVN datagrams.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("mvn_datagram", bytes));
