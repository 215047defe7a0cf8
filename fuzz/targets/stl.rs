#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("stl"), |bytes: &[u8]| read("stl", bytes));
