#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("ptx_points"), |bytes: &[u8]| read("ptx_points", bytes));
