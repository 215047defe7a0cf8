#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("obj"), |bytes: &[u8]| read("obj", bytes));
