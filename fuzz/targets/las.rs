#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("las"), |bytes: &[u8]| read("las", bytes));
