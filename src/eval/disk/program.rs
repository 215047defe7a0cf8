//! Which program this is: results of another build are never believed.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use super::folder::{PROGRAMS, is_fingerprint};
use super::seal::{seal, unsealed};
use crate::plain;
use crate::stamp::Stamp;
use crate::value::Hash;
use crate::writing::write_parts;

/// The hash of the running program's file, remembered in the cache by what the system says of the file, because hashing it takes
/// longer than most graphs.
pub(super) fn fingerprint(folder: &Path) -> io::Result<String> {
    let (memo, is_settled) = memo(folder)?;
    if let Some(known) = plain::read_own(&memo).ok().and_then(|bytes| remembered(&memo, bytes)) {
        return Ok(known);
    }
    let fingerprint = computed()?;
    if is_settled {
        // Only time is lost if it cannot be remembered.
        let text = fingerprint.as_bytes();
        let _ = write_parts(&memo, &[text, &seal(&memo, text)]);
    }
    Ok(fingerprint)
}

/// Where the running program is remembered, and whether a later build would be remembered elsewhere.
pub(super) fn memo(folder: &Path) -> io::Result<(PathBuf, bool)> {
    let program = std::env::current_exe()?;
    let stamp = Stamp::of(&program).ok_or_else(|| io::Error::other("no such program"))?;
    let name = Hash::of(format!("{} {stamp:?}", program.display()).as_bytes()).to_string();
    Ok((folder.join(PROGRAMS).join(name), stamp.is_settled()))
}

/// The hash of the running program's file.
pub(super) fn computed() -> io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(File::open(std::env::current_exe()?)?)?;
    Ok(hasher.finalize().to_hex()[..32].to_owned())
}

/// The fingerprint in a file that remembers one.
pub(super) fn remembered(memo: &Path, bytes: Vec<u8>) -> Option<String> {
    let text = String::from_utf8(unsealed(memo, bytes)?).ok()?;
    Some(text).filter(|text| is_fingerprint(text))
}
