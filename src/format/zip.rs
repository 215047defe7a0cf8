//! ZIP archives that are the same bytes each time: without dates, and packed by one thread.
//!
//! PKWARE, "APPNOTE.TXT - .ZIP File Format Specification", 6.3.10 (2022), sections 4.3 and 4.4.

use miniz_oxide::deflate::compress_to_vec;
use thiserror::Error;

/// Why files do not fit into an archive.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{bytes} bytes are more than the 4 GiB of a ZIP archive")]
pub(super) struct TooLarge {
    bytes: usize,
}

/// The first of January 1980, where dates begin.
const DATE: u16 = 1 << 5 | 1;

const DEFLATED: u16 = 8;
const STORED: u16 = 0;

/// An archive of files with these names, in this order.
pub(super) fn archive(files: &[(&str, &[u8])]) -> Result<Vec<u8>, TooLarge> {
    let (mut bytes, mut directory) = (Vec::new(), Vec::new());
    for &(name, content) in files {
        let packed = compress_to_vec(content, 6);
        let (method, data) = match packed.len() < content.len() {
            true => (DEFLATED, &packed[..]),
            false => (STORED, content),
        };
        // What both headers tell: version 2.0, no flags, the method, time and date, checksum, sizes, the length of the name and none more.
        let mut told = Vec::new();
        [20, 0, method, 0, DATE].iter().for_each(|it: &u16| told.extend(it.to_le_bytes()));
        told.extend(crc32fast::hash(content).to_le_bytes());
        told.extend(four(data.len())?);
        told.extend(four(content.len())?);
        [name.len() as u16, 0].iter().for_each(|it| told.extend(it.to_le_bytes()));
        directory.extend(b"PK\x01\x02\x14\0");
        directory.extend(&told);
        // No comment, the first disk, no attributes.
        directory.extend([0; 10]);
        directory.extend(four(bytes.len())?);
        directory.extend(name.as_bytes());
        bytes.extend(b"PK\x03\x04");
        bytes.extend(told);
        bytes.extend(name.as_bytes());
        bytes.extend(data);
    }
    let (start, count) = (bytes.len(), files.len() as u16);
    let length = directory.len();
    bytes.append(&mut directory);
    bytes.extend(b"PK\x05\x06\0\0\0\0");
    [count, count].iter().for_each(|it| bytes.extend(it.to_le_bytes()));
    bytes.extend(four(length)?);
    bytes.extend(four(start)?);
    bytes.extend([0; 2]);
    Ok(bytes)
}

fn four(count: usize) -> Result<[u8; 4], TooLarge> {
    u32::try_from(count).map(u32::to_le_bytes).map_err(|_| TooLarge { bytes: count })
}
