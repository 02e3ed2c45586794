//! Fuzzes the assembly of suit samples from sequences of MVN datagrams.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| equipoise_fuzz::check("mvn_assembler", bytes));
