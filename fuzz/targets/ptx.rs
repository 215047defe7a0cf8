#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("ptx"), |bytes: &[u8]| read("ptx", bytes));
