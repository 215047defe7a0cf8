#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("obj_curve"), |bytes: &[u8]| read("obj_curve", bytes));
