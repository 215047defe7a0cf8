#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| maquette_fuzz::read("ply", bytes));
