#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("e57"), |bytes: &[u8]| read("e57", bytes));
