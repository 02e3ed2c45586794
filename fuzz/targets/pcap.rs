//! Fuzzes the reader of network captures (pcap, pcapng).
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("pcap", bytes));
