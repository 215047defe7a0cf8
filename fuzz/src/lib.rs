//! The readers and their valid files, by name, for the fuzz targets.

use std::path::Path;

#[path = "../../tests/engine/hostile_files/readers.rs"]
#[expect(dead_code, reason = "libFuzzer spoils files in its own way")]
mod readers;

use readers::{READERS, Reader};

/// Reads `bytes` with the reader of this name.
pub fn read(name: &str, bytes: &[u8]) {
    (reader(name).read)(bytes);
}

/// Writes the valid files of a reader to `corpus/NAME`, where `cargo fuzz run` and `.ci/fuzz` start. Also installs a panic hook that does
/// not abort: a panic that the reader catches (because its decoder is known to panic) does not count, and any other panic ends the program.
pub fn plant(name: &str) {
    std::panic::set_hook(Box::new(|panic| eprintln!("{panic}")));
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(name);
    std::fs::create_dir_all(&folder).expect("a folder for files");
    for (number, seed) in reader(name).seeds.iter().enumerate() {
        std::fs::write(folder.join(format!("seed-{number}")), seed).expect("a file");
    }
}

fn reader(name: &str) -> &'static Reader {
    READERS.iter().find(|reader| reader.name == name).expect("a target has a reader")
}
