#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("jpeg"), |bytes: &[u8]| read("jpeg", bytes));
