#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("three_mf"), |bytes: &[u8]| read("three_mf", bytes));
