#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("depth"), |bytes: &[u8]| read("depth", bytes));
