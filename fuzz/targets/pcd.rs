#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("pcd"), |bytes: &[u8]| read("pcd", bytes));
