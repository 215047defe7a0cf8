#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("abs"), |bytes: &[u8]| read("abs", bytes));
