//! Fuzzes the parser of the settings page of Net F/T devices.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("netft_xml", bytes));
