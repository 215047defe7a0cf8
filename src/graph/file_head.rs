//! The start of a file, from which the size of the value in it follows.

use std::cell::RefCell;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use maquette_node::importers::Readers;
use maquette_node::{FileHead, ValueSize};
use maquette_value::ValueType;
use maquette_value::fs::extension;

/// Returns the size of the value of type `kind` in a file, as the file's header states it. `None` if the header does not state it, or the
/// file cannot be read. Only the header is read.
pub fn size_in_file(path: &Path, kind: &ValueType, readers: &Readers) -> Option<ValueSize> {
    // Look before opening: opening a pipe would wait for a writer.
    let metadata = std::fs::metadata(path).ok().filter(std::fs::Metadata::is_file)?;
    let file = RefCell::new(File::open(path).ok()?);
    let read_at = |offset: u64, count: usize| {
        let mut bytes = Vec::new();
        let file = &mut *file.borrow_mut();
        file.seek(SeekFrom::Start(offset)).ok()?;
        file.take(count as u64).read_to_end(&mut bytes).ok()?;
        Some(bytes)
    };
    let start = read_at(0, FileHead::START)?;
    let extension = extension(path);
    let head = FileHead {
        extension: &extension,
        length: metadata.len(),
        start: &start,
        read_at: &read_at,
    };
    // A panic of a reader is reported when the file is read.
    catch_unwind(AssertUnwindSafe(|| readers.size(kind, &head))).ok().flatten()
}
