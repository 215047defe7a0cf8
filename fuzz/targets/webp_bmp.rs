#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("webp_bmp"), |bytes: &[u8]| read("webp_bmp", bytes));
