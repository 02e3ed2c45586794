//! Fuzzes the records and requests of ATI's RDT protocol.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("rdt", bytes));
