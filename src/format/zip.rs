//! Reads and writes ZIP archives. Written archives are reproducible: they contain no dates, and one thread packs them.
//!
//! PKWARE, "APPNOTE.TXT - .ZIP File Format Specification", 6.3.10 (2022), sections 4.3 and 4.4.

use maquette_syntax::bail;
use maquette_syntax::error::Error;
use miniz_oxide::deflate::compress_to_vec;
use miniz_oxide::inflate::decompress_to_vec_with_limit;

/// The first of January 1980, the earliest date that the format can store.
const DATE: u16 = 1 << 5 | 1;

const DEFLATED: u16 = 8;
const STORED: u16 = 0;

/// Creates an archive of files with the given names and contents, in this order.
pub(super) fn archive(files: &[(&str, &[u8])]) -> Result<Vec<u8>, Error> {
    let (mut bytes, mut directory) = (Vec::new(), Vec::new());
    for &(name, content) in files {
        let packed = compress_to_vec(content, 6);
        let (method, data) = match packed.len() < content.len() {
            true => (DEFLATED, &packed[..]),
            false => (STORED, content),
        };
        // The fields that are equal in the local header and in the directory entry: version 2.0, no flags, method, time and date, checksum,
        // sizes, the length of the name, and no extra field.
        let mut shared = Vec::new();
        [20, 0, method, 0, DATE].iter().for_each(|it: &u16| shared.extend(it.to_le_bytes()));
        shared.extend(crc32fast::hash(content).to_le_bytes());
        shared.extend(le_bytes(data.len())?);
        shared.extend(le_bytes(content.len())?);
        [name.len() as u16, 0].iter().for_each(|it| shared.extend(it.to_le_bytes()));
        directory.extend(b"PK\x01\x02\x14\0");
        directory.extend(&shared);
        // The entry has no comment, is on the first disk, and has no attributes.
        directory.extend([0; 10]);
        directory.extend(le_bytes(bytes.len())?);
        directory.extend(name.as_bytes());
        bytes.extend(b"PK\x03\x04");
        bytes.extend(shared);
        bytes.extend(name.as_bytes());
        bytes.extend(data);
    }
    let (start, count) = (bytes.len(), files.len() as u16);
    let length = directory.len();
    bytes.append(&mut directory);
    bytes.extend(b"PK\x05\x06\0\0\0\0");
    [count, count].iter().for_each(|it| bytes.extend(it.to_le_bytes()));
    bytes.extend(le_bytes(length)?);
    bytes.extend(le_bytes(start)?);
    bytes.extend([0; 2]);
    Ok(bytes)
}

fn le_bytes(count: usize) -> Result<[u8; 4], Error> {
    let Ok(count) = u32::try_from(count) else {
        bail!("{count} bytes are more than the 4 GiB of a ZIP archive");
    };
    Ok(count.to_le_bytes())
}

fn not_an_archive() -> Error {
    Error::new("this file is not one, or is truncated")
}

/// An archive that is being read.
pub(crate) struct Archive<'b> {
    bytes: &'b [u8],
    entries: Vec<Entry>,
}

/// An entry of the archive's directory.
struct Entry {
    name: String,
    method: usize,
    is_encrypted: bool,
    checksum: u32,
    packed: usize,
    size: usize,
    /// The offset of the file's local header.
    start: usize,
}

/// Reads a little-endian number of `size` bytes.
fn number(bytes: &[u8], at: usize, size: usize) -> Option<usize> {
    let bytes = bytes.get(at..)?.get(..size)?;
    Some(bytes.iter().rev().fold(0, |sum, byte| sum << 8 | usize::from(*byte)))
}

impl<'b> Archive<'b> {
    /// Opens an archive and reads its directory.
    pub(crate) fn open(bytes: &'b [u8]) -> Result<Self, Error> {
        // The end record of the directory may be followed by a comment of up to 65 535 bytes.
        let from = bytes.len().saturating_sub(22 + 0xffff);
        let end = bytes[from..].windows(4).rposition(|four| four == b"PK\x05\x06");
        let end = from + end.ok_or_else(not_an_archive)?;
        let mut at = number(bytes, end + 16, 4).ok_or_else(not_an_archive)?;
        if at == LARGE {
            at = large_directory(bytes, end).ok_or_else(not_an_archive)?;
        }
        let mut entries = Vec::new();
        while bytes.get(at..).is_some_and(|rest| rest.starts_with(b"PK\x01\x02")) {
            let (entry, length) = Entry::read(&bytes[at..]).ok_or_else(not_an_archive)?;
            entries.push(entry);
            at += length;
        }
        Ok(Self { bytes, entries })
    }

    /// Returns the names of all files in the archive.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.entries.iter().map(|entry| &entry.name[..])
    }

    /// Finds a file, ignoring case and a leading slash. Returns its name as stored in the archive.
    pub(crate) fn find(&self, name: &str) -> Option<&str> {
        let name = name.trim_start_matches('/');
        self.names().find(|part| part.trim_start_matches('/').eq_ignore_ascii_case(name))
    }

    /// Reads the content of a file. Returns an error if it has more than `limit` bytes.
    pub(crate) fn read(&self, name: &str, limit: usize) -> Result<Vec<u8>, Error> {
        let damaged = || Error::new(format!("`{name}` in it is damaged"));
        let entry = self.entries.iter().find(|entry| entry.name == name).ok_or_else(damaged)?;
        let Entry { method, size, packed, start, .. } = *entry;
        if limit < size {
            bail!("`{name}` in it unpacks to {size} bytes, but the maximum is {limit}");
        }
        let lengths = number(self.bytes, start + 26, 2).zip(number(self.bytes, start + 28, 2));
        let data = lengths
            .and_then(|(name, extra)| self.bytes.get(start + 30 + name + extra..)?.get(..packed));
        let data = data.ok_or_else(damaged)?;
        let content = match method {
            0 if !entry.is_encrypted => data.to_vec(),
            8 if !entry.is_encrypted => {
                decompress_to_vec_with_limit(data, size).map_err(|_| damaged())?
            }
            _ => bail!(
                "`{name}` in it is encrypted or packed with method {method}: pack it again with Deflate"
            ),
        };
        let is_whole = content.len() == size && crc32fast::hash(&content) == entry.checksum;
        if is_whole { Ok(content) } else { Err(damaged()) }
    }
}

/// A number with this value is stored elsewhere, with 8 bytes (section 4.3.14: ZIP64).
const LARGE: usize = 0xffff_ffff;

/// Returns the offset of the directory of a ZIP64 archive. `end` is the offset of its end record.
fn large_directory(bytes: &[u8], end: usize) -> Option<usize> {
    let locator = end.checked_sub(20).filter(|&at| bytes[at..].starts_with(b"PK\x06\x07"))?;
    number(bytes, number(bytes, locator + 8, 8)?.checked_add(48)?, 8)
}

impl Entry {
    /// Reads the directory entry at the start of `bytes`. Returns the entry and its length in bytes.
    fn read(bytes: &[u8]) -> Option<(Self, usize)> {
        let [name, extra, comment] = [28, 30, 32].map(|at| number(bytes, at, 2));
        let name = name?;
        let after = bytes.get(46..)?;
        let mut large = large_numbers(after.get(name..)?.get(..extra?)?);
        let mut number_at = |at: usize| match number(bytes, at, 4)? {
            LARGE => large.next(),
            found => Some(found),
        };
        // The extra field contains the large numbers in this order.
        let (size, packed, start) = (number_at(24)?, number_at(20)?, number_at(42)?);
        let entry = Self {
            name: String::from_utf8_lossy(after.get(..name)?).into_owned(),
            method: number(bytes, 10, 2)?,
            is_encrypted: number(bytes, 8, 2)? & 1 == 1,
            checksum: number(bytes, 16, 4)? as u32,
            packed,
            size,
            start,
        };
        Some((entry, 46 + name + extra? + comment?))
    }
}

/// Returns the 8-byte numbers in the extra field of ZIP64.
fn large_numbers(mut extra: &[u8]) -> impl Iterator<Item = usize> {
    let mut found = &[][..];
    while let Some((kind, length)) = number(extra, 0, 2).zip(number(extra, 2, 2)) {
        let (part, rest) = extra[4..].split_at(length.min(extra.len() - 4));
        if kind == 1 {
            found = part;
        }
        extra = rest;
    }
    found.chunks_exact(8).filter_map(|eight| number(eight, 0, 8))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Converts an archive to ZIP64, in the form that MeshLab writes.
    fn large(archive: &[u8]) -> Vec<u8> {
        let end = archive.len() - 22;
        let directory = number(archive, end + 16, 4).unwrap();
        let mut bytes = archive[..directory].to_vec();
        let start = bytes.len() as u64;
        let mut at = directory;
        while at < end {
            let (entry, length) = Entry::read(&archive[at..]).unwrap();
            let mut part = archive[at..at + length].to_vec();
            [20, 24, 42].iter().for_each(|&k| part[k..k + 4].fill(255));
            part[30..32].copy_from_slice(&28u16.to_le_bytes());
            part.extend([1, 0, 24, 0]);
            [entry.size, entry.packed, entry.start]
                .iter()
                .for_each(|&it| part.extend((it as u64).to_le_bytes()));
            bytes.extend(part);
            at += length;
        }
        let record = bytes.len() as u64;
        bytes.extend(b"PK\x06\x06");
        bytes.extend([0; 44]);
        bytes.extend(start.to_le_bytes());
        bytes.extend(b"PK\x06\x07\0\0\0\0");
        bytes.extend(record.to_le_bytes());
        bytes.extend([1, 0, 0, 0]);
        bytes.extend(&archive[end..]);
        let end = bytes.len() - 22;
        bytes[end + 16..end + 20].fill(255);
        bytes
    }

    #[test]
    fn archives_are_read_back_also_with_large_numbers() {
        let files: [(&str, &[u8]); 2] = [("a/b.txt", &[7; 900]), ("c", b"hi")];
        let archive = archive(&files).unwrap();
        for bytes in [archive.clone(), large(&archive)] {
            let archive = Archive::open(&bytes).unwrap();
            assert_eq!(archive.find("/A/B.txt"), Some("a/b.txt"));
            for (name, content) in files {
                assert_eq!(archive.read(name, 1000).unwrap(), content);
            }
            let error = archive.read("a/b.txt", 100).unwrap_err().to_string();
            assert_eq!(error, "`a/b.txt` in it unpacks to 900 bytes, but the maximum is 100");
        }
        let mut spoiled = archive;
        spoiled[40] ^= 1;
        assert!(Archive::open(&spoiled).unwrap().read("a/b.txt", 1000).is_err());
    }
}
