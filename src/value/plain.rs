//! Reads plain files alone. A pipe or device is refused, since reading it might never end.

use std::fs;
use std::io::{Error, ErrorKind, Result};
use std::path::Path;

/// The content of a plain file, or of the one that a link leads to.
pub fn read(path: &Path) -> Result<Vec<u8>> {
    is_plain(&fs::metadata(path)?)?;
    fs::read(path)
}

/// The content as text.
///
/// # Errors
/// [`NoText`] for what is no UTF-8.
pub fn read_text(path: &Path) -> Result<String> {
    text_of(read(path)?)
}

/// The text of a file that is no link either.
pub fn read_own_text(path: &Path) -> Result<String> {
    text_of(read_own(path)?)
}

/// The text that some bytes are.
///
/// # Errors
/// [`NoText`] for what is no UTF-8.
pub fn text_of(bytes: Vec<u8>) -> Result<String> {
    let wide = [&b"\xff\xfe"[..], b"\xfe\xff"].iter().any(|mark| bytes.starts_with(mark));
    // Without a mark, every other byte of Latin letters is 0.
    let is_wide = wide || matches!(bytes[..], [0, other, ..] | [other, 0, ..] if other != 0);
    fn found(bytes: &[u8], at: usize, is_wide: bool) -> String {
        match bytes[at] {
            _ if is_wide => "UTF-16".to_owned(),
            0 => "the byte 0".to_owned(),
            byte => format!("the byte 0x{byte:02X}"),
        }
    }
    fn no_text(bytes: &[u8], at: usize, is_wide: bool) -> Error {
        let at = if is_wide { 0 } else { at };
        let line_start =
            bytes[..at].iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
        let line = bytes[..at].iter().filter(|&&byte| byte == b'\n').count() + 1;
        let column = String::from_utf8_lossy(&bytes[line_start..at]).chars().count() + 1;
        Error::new(
            ErrorKind::InvalidData,
            NoText { line, column, found: found(bytes, at, is_wide) },
        )
    }
    if let Some(at) = bytes.iter().position(|&byte| byte == 0) {
        let at = std::str::from_utf8(&bytes[..at]).map_or_else(|error| error.valid_up_to(), |_| at);
        return Err(no_text(&bytes, at, is_wide));
    }
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        no_text(error.as_bytes(), at, is_wide)
    })
}

/// A place in a file where there is no UTF-8 text.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}, column {column}: expected text in UTF-8, found {found}; {}", self.help())]
pub struct NoText {
    line: usize,
    column: usize,
    found: String,
}

impl NoText {
    /// What to do about it.
    pub fn help(&self) -> &'static str {
        match &self.found[..] {
            "the byte 0" => "restore the file: it is damaged",
            _ => "save the file as UTF-8",
        }
    }
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
    match bytes.strip_prefix(b"\xef\xbb\xbf") {
        Some(text)
            if text
                .iter()
                .take(84)
                .all(|byte| byte.is_ascii_whitespace() || !byte.is_ascii_control()) =>
        {
            text
        }
        _ => bytes,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_text_is_told_with_its_place() {
        fn check(bytes: &[u8], expected: &str) {
            let found = text_of(bytes.to_vec()).map_err(|error| error.to_string());
            assert_eq!(found.unwrap_or_else(|error| error), expected);
        }
        let wide = "line 1, column 1: expected text in UTF-8, found UTF-16; save the file as UTF-8";
        check(b"a\xc3\xa4b\n", "a\u{e4}b\n");
        check(b"\xef\xbb\xbfa", "\u{feff}a");
        check(b"", "");
        check(
            b"a\n\xc3\xa4\xe4b",
            "line 2, column 2: expected text in UTF-8, found the byte 0xE4; save the file as UTF-8",
        );
        check(b"\xff\xfeG\0", wide);
        check(b"\xfe\xff\0G", wide);
        check(b"G\0r\0", wide);
        check(
            b"a\n\nb\0",
            "line 3, column 2: expected text in UTF-8, found the byte 0; restore the file: it is damaged",
        );
    }
}
