#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("png"), |bytes: &[u8]| read("png", bytes));
