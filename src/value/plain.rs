//! Reads plain files alone. A pipe or device is refused, since reading it might never end.

use std::fs;
use std::io::{Error, ErrorKind, Result};
use std::path::Path;

/// The content of a plain file, or of the one that a link leads to.
pub fn read(path: &Path) -> Result<Vec<u8>> {
    is_plain(&fs::metadata(path)?)?;
    fs::read(path)
}

/// The same as text.
pub fn read_text(path: &Path) -> Result<String> {
    is_plain(&fs::metadata(path)?)?;
    fs::read_to_string(path)
}

/// The text of a file that is no link either.
pub fn read_own_text(path: &Path) -> Result<String> {
    is_plain(&fs::symlink_metadata(path)?)?;
    fs::read_to_string(path)
}

/// The content of a file that is no link either.
pub fn read_own(path: &Path) -> Result<Vec<u8>> {
    is_plain(&fs::symlink_metadata(path)?)?;
    fs::read(path)
}

/// A file that is no link either, open to be read.
pub fn open_own(path: &Path) -> Result<fs::File> {
    is_plain(&fs::symlink_metadata(path)?)?;
    fs::File::open(path)
}

/// Whether there is a plain file at this path, and no link.
pub fn is_own(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_file())
}

/// A pipe waits for its writer, and a device may never end.
fn is_plain(metadata: &fs::Metadata) -> Result<()> {
    let what = match metadata {
        it if it.is_file() => return Ok(()),
        it if it.is_dir() => return Err(ErrorKind::IsADirectory.into()),
        it if it.is_symlink() => "it is a link, which is not followed here",
        _ => "it is no plain file",
    };
    Err(Error::new(ErrorKind::InvalidInput, what))
}

/// What stands behind the last dot of a file's name, in lower case; empty if nothing does.
pub fn ending(path: &Path) -> String {
    path.extension().map_or_else(String::new, |ending| ending.to_string_lossy().to_lowercase())
}

/// Some bytes without the mark of UTF-8 at the start of a text. A binary file may begin with these bytes by chance, so that they are a mark
/// only before text: no header of a binary format has so many printable characters on end as the one of STL, 80 with a count behind.
pub fn without_mark(bytes: &[u8]) -> &[u8] {
    let is_text = |byte: &u8| byte.is_ascii_whitespace() || !byte.is_ascii_control();
    match bytes.strip_prefix(b"\xef\xbb\xbf") {
        Some(text) if text.iter().take(84).all(is_text) => text,
        _ => bytes,
    }
}
