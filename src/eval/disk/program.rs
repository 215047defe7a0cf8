//! Which program this is: results of another build are never believed.

use std::fs::{self, File};
use std::io;
use std::path::Path;

use super::super::files::Stamp;
use crate::value::Hash;

/// The hash of the running program's file, remembered in the cache by what the system says of the file, because hashing it takes
/// longer than most graphs.
pub(super) fn fingerprint(folder: &Path) -> io::Result<String> {
    let program = std::env::current_exe()?;
    let stamp = Stamp::of(&program).ok_or_else(|| io::Error::other("no such program"))?;
    let name = Hash::of(format!("{} {stamp:?}", program.display()).as_bytes()).to_string();
    let memo = folder.join("programs").join(name);
    if let Some(known) = fs::read_to_string(&memo).ok().filter(|text| is_fingerprint(text)) {
        return Ok(known);
    }
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(File::open(&program)?)?;
    let fingerprint = hasher.finalize().to_hex()[..32].to_owned();
    // Only time is lost if it cannot be remembered.
    let _ = fs::create_dir_all(folder.join("programs")).and_then(|()| {
        let file = tempfile::NamedTempFile::new_in(folder.join("programs"))?;
        fs::write(file.path(), &fingerprint)?;
        file.persist(&memo).map_err(|error| error.error)
    });
    Ok(fingerprint)
}

/// Whether a text is a fingerprint: 32 hexadecimal digits.
pub(super) fn is_fingerprint(text: &str) -> bool {
    text.len() == 32 && text.bytes().all(|byte| byte.is_ascii_hexdigit())
}
