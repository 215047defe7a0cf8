#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("xyz"), |bytes: &[u8]| read("xyz", bytes));
