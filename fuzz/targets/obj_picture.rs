#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("obj_picture"), |bytes: &[u8]| read("obj_picture", bytes));
