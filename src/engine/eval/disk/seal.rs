//! The checksum at the end of each cache file. It also covers the file's name. So an intact file under a wrong name is rejected like a
//! damaged one.

use std::path::Path;

const LENGTH: usize = 32;

/// Returns the checksum of `content` for the file at this path.
pub(super) fn seal(path: &Path, content: &[u8]) -> [u8; LENGTH] {
    let mut hasher = blake3::Hasher::new();
    // Cover the names of the file and its folder. The folder determines the kind of file.
    let names = [path.parent().and_then(Path::file_name), path.file_name()];
    for name in names {
        let name = name.unwrap_or_default().as_encoded_bytes();
        hasher.update(&(name.len() as u64).to_le_bytes()).update(name);
    }
    *hasher.update(content).finalize().as_bytes()
}

/// Checks and removes the checksum at the end of the bytes of a file. Returns `None` if the checksum does not match.
pub(super) fn unseal(path: &Path, mut bytes: Vec<u8>) -> Option<Vec<u8>> {
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
    fn a_renamed_or_modified_file_is_rejected() {
        let path = Path::new("cache/entries/one");
        let bytes = [&b"text"[..], &seal(path, b"text")].concat();
        assert_eq!(unseal(path, bytes.clone()).as_deref(), Some(&b"text"[..]));
        for other in ["cache/entries/two", "cache/graphs/one"] {
            assert_eq!(unseal(Path::new(other), bytes.clone()), None);
        }
        for place in 0..bytes.len() {
            let mut flipped = bytes.clone();
            flipped[place] ^= 1;
            assert_eq!(unseal(path, flipped), None);
            assert_eq!(unseal(path, bytes[..place].to_vec()), None);
        }
    }
}
