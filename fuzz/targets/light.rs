#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("light"), |bytes: &[u8]| read("light", bytes));
