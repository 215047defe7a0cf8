#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("tiff"), |bytes: &[u8]| read("tiff", bytes));
