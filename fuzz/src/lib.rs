//! Readers by name, and their files, for the fuzz targets.

use std::path::Path;

#[path = "../../tests/engine/hostile_files/readers.rs"]
#[expect(dead_code, reason = "libFuzzer spoils files in its own way")]
mod readers;

use readers::{READERS, Reader};

/// Calls the reader of that name.
pub fn read(name: &str, bytes: &[u8]) {
    (reader(name).read)(bytes);
}

/// Puts the reader's files where `cargo fuzz run` and `.ci/fuzz` start from: `corpus/` and its name. A panic that a reader catches,
/// because its decoder is known for it, is none from here on; any other still ends the program.
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
