//! Reading of regular files. Pipes and devices are refused, because reading from them might never end.

use std::fs;
use std::io::{Error, ErrorKind, Result};
use std::path::Path;

/// Reads a regular file. Follows symbolic links.
pub fn read(path: &Path) -> Result<Vec<u8>> {
    check_regular_file(&fs::metadata(path)?)?;
    fs::read(path)
}

/// Reads a regular file as text. Follows symbolic links.
///
/// # Errors
/// [`NotUtf8`] if the bytes are not UTF-8.
pub fn read_text(path: &Path) -> Result<String> {
    decode_utf8(read(path)?)
}

/// Reads a regular file as text. Does not follow a symbolic link.
pub fn read_text_no_follow(path: &Path) -> Result<String> {
    decode_utf8(read_no_follow(path)?)
}

/// Decodes bytes as UTF-8.
///
/// # Errors
/// [`NotUtf8`] if the bytes are not UTF-8.
pub fn decode_utf8(bytes: Vec<u8>) -> Result<String> {
    let wide = [&b"\xff\xfe"[..], b"\xfe\xff"].iter().any(|mark| bytes.starts_with(mark));
    // In UTF-16 without a byte order mark, every other byte of Latin text is 0.
    let is_wide = wide || matches!(bytes[..], [0, other, ..] | [other, 0, ..] if other != 0);
    if let Some(at) = bytes.iter().position(|&byte| byte == 0) {
        let at = std::str::from_utf8(&bytes[..at]).map_or_else(|error| error.valid_up_to(), |_| at);
        return Err(not_utf8_error(&bytes, at, is_wide));
    }
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        not_utf8_error(error.as_bytes(), at, is_wide)
    })
}

/// Returns the error for the byte at the offset `at`. If `is_wide` is true, the entire file is UTF-16, and the error is for the file.
fn not_utf8_error(bytes: &[u8], at: usize, is_wide: bool) -> Error {
    let at = if is_wide { 0 } else { at };
    let line_start = bytes[..at].iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
    let line = bytes[..at].iter().filter(|&&byte| byte == b'\n').count() + 1;
    let column = String::from_utf8_lossy(&bytes[line_start..at]).chars().count() + 1;
    let found = match bytes[at] {
        _ if is_wide => "UTF-16".to_owned(),
        0 => "the byte 0".to_owned(),
        byte => format!("the byte 0x{byte:02X}"),
    };
    Error::new(ErrorKind::InvalidData, NotUtf8 { line, column, found })
}

/// The position in a file at which its bytes are not UTF-8 text.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}, column {column}: expected text in UTF-8, found {found}; {}", self.help())]
pub struct NotUtf8 {
    line: usize,
    column: usize,
    found: String,
}

impl NotUtf8 {
    /// Returns the help text, which says how to repair the file.
    pub fn help(&self) -> &'static str {
        match &self.found[..] {
            "the byte 0" => "restore the file: it is damaged",
            _ => "save the file as UTF-8",
        }
    }
}

/// Reads a regular file. Does not follow a symbolic link.
pub fn read_no_follow(path: &Path) -> Result<Vec<u8>> {
    check_regular_file(&fs::symlink_metadata(path)?)?;
    fs::read(path)
}

/// Opens a regular file for reading. Follows symbolic links.
pub fn open(path: &Path) -> Result<fs::File> {
    check_regular_file(&fs::metadata(path)?)?;
    fs::File::open(path)
}

/// Opens a regular file for reading. Does not follow a symbolic link.
pub fn open_no_follow(path: &Path) -> Result<fs::File> {
    check_regular_file(&fs::symlink_metadata(path)?)?;
    fs::File::open(path)
}

/// Returns true if the path is a regular file, not a link.
pub fn is_regular_file(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_file())
}

/// Returns an error for directories, links, pipes and devices. Reading a pipe waits for its writer, and a device may never end.
fn check_regular_file(metadata: &fs::Metadata) -> Result<()> {
    let what = match metadata {
        it if it.is_file() => return Ok(()),
        it if it.is_dir() => return Err(ErrorKind::IsADirectory.into()),
        it if it.is_symlink() => "it is a link, which is not followed here",
        _ => "it is not a regular file",
    };
    Err(Error::new(ErrorKind::InvalidInput, what))
}

/// The extension of the file's name, in lower case; empty if there is none.
pub fn extension(path: &Path) -> String {
    path.extension()
        .map_or_else(String::new, |extension| extension.to_string_lossy().to_lowercase())
}

/// Removes the byte order mark from the start of a UTF-8 text. A binary file may begin with the same bytes by chance, so the bytes count as
/// a mark only if 84 printable bytes follow. The longest printable header of a binary format is that of STL: 80 bytes before a count.
pub fn strip_bom(bytes: &[u8]) -> &[u8] {
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
    fn bytes_that_are_not_utf8_are_reported_with_their_position() {
        fn check(bytes: &[u8], expected: &str) {
            let found = decode_utf8(bytes.to_vec()).map_err(|error| error.to_string());
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
