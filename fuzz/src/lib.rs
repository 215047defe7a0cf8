//! Readers by name, for the fuzz targets.

#[path = "../../tests/hostile_files/readers.rs"]
#[expect(dead_code, reason = "libFuzzer spoils files in its own way")]
mod readers;

use readers::READERS;

/// Calls the reader of that name.
pub fn read(name: &str, bytes: &[u8]) {
    let reader = READERS.iter().find(|reader| reader.name == name).expect("a target has a reader");
    (reader.read)(bytes);
}
