#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("glb"), |bytes: &[u8]| read("glb", bytes));
