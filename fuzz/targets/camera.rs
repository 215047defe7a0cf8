#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("camera"), |bytes: &[u8]| read("camera", bytes));
