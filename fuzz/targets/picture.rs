#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("picture"), |bytes: &[u8]| read("picture", bytes));
