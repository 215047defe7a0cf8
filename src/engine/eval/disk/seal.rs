//! The checksum at the end of a file of the cache. It is one of the file's name, too: a whole file under the name of another one is
//! believed as little as a torn one.

use std::path::Path;

const LENGTH: usize = 32;

/// What follows this content in the file at this path.
pub(super) fn seal(path: &Path, content: &[u8]) -> [u8; LENGTH] {
    let mut hasher = blake3::Hasher::new();
    // The name, and the folder that says what it is a name of.
    let names = [path.parent().and_then(Path::file_name), path.file_name()];
    for name in names {
        let name = name.unwrap_or_default().as_encoded_bytes();
        hasher.update(&(name.len() as u64).to_le_bytes()).update(name);
    }
    *hasher.update(content).finalize().as_bytes()
}

/// The content of the file at this path, which holds these bytes; none if the checksum does not fit.
pub(super) fn unsealed(path: &Path, mut bytes: Vec<u8>) -> Option<Vec<u8>> {
    let length = bytes.len().checked_sub(LENGTH)?;
    if seal(path, &bytes[..length])[..] != bytes[length..] {
        return None;
    }
    bytes.truncate(length);
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_under_another_name_or_with_another_byte_is_not_believed() {
        let path = Path::new("cache/entries/one");
        let bytes = [&b"text"[..], &seal(path, b"text")].concat();
        assert_eq!(unsealed(path, bytes.clone()).as_deref(), Some(&b"text"[..]));
        for other in ["cache/entries/two", "cache/graphs/one"] {
            assert_eq!(unsealed(Path::new(other), bytes.clone()), None);
        }
        for place in 0..bytes.len() {
            let mut flipped = bytes.clone();
            flipped[place] ^= 1;
            assert_eq!(unsealed(path, flipped), None);
            assert_eq!(unsealed(path, bytes[..place].to_vec()), None);
        }
    }
}
