#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("ply_range"), |bytes: &[u8]| read("ply_range", bytes));
