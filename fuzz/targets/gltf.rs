#![no_main]

use maquette_fuzz::{plant, read};

libfuzzer_sys::fuzz_target!(init: plant("gltf"), |bytes: &[u8]| read("gltf", bytes));
