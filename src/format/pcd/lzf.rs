//! LZF, the compression of `binary_compressed` PCD files.
//!
//! A stream consists of literal runs and copies of earlier output. A literal run is a byte n < 32, followed by n + 1 bytes. A copy begins
//! with a byte whose upper 3 bits are the length, where 7 means that another length byte follows; the lower bits and the next byte are the
//! distance. The format is that of Marc Lehmann's LibLZF.

/// An error in a stream, with the position of the invalid byte.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct LzfError {
    pub(super) byte: usize,
    pub(super) what: &'static str,
}

/// The maximum ratio of unpacked to packed size: a copy of 264 bytes takes 3 bytes.
const MAX_EXPANSION: usize = 88;

/// Unpacks `expected` bytes. Memory is reserved only if the stream is long enough to unpack to this size.
pub(super) fn unpack(packed: &[u8], expected: usize) -> Result<Vec<u8>, LzfError> {
    if expected > packed.len().saturating_mul(MAX_EXPANSION) {
        return Err(LzfError {
            byte: 0,
            what: "the compressed data are too short for the stated size",
        });
    }
    let mut unpacked = Vec::with_capacity(expected);
    let mut next = 0;
    while let Some(&control) = packed.get(next) {
        let byte = next;
        fn stream_error(what: &'static str, byte: usize) -> LzfError {
            LzfError { byte, what }
        }
        let truncated = || stream_error("the compressed data are truncated", byte);
        let read = |at: usize| packed.get(at).map(|&byte| usize::from(byte)).ok_or_else(truncated);
        next += 1;
        if control < 32 {
            let end = next + usize::from(control) + 1;
            unpacked.extend_from_slice(packed.get(next..end).ok_or_else(truncated)?);
            next = end;
        } else {
            let mut length = usize::from(control >> 5);
            if length == 7 {
                length += read(next)?;
                next += 1;
            }
            let distance = (usize::from(control & 31) << 8 | read(next)?) + 1;
            next += 1;
            let start = unpacked.len().checked_sub(distance);
            let start = start
                .ok_or_else(|| stream_error("a copy begins before the start of the data", byte))?;
            repeat(&mut unpacked, start, length + 2);
        }
        if unpacked.len() > expected {
            return Err(stream_error("the data are longer than stated", byte));
        }
    }
    if unpacked.len() < expected {
        return Err(LzfError { byte: packed.len(), what: "the data are shorter than stated" });
    }
    Ok(unpacked)
}

/// Appends a copy of the `length` bytes from `start` on. The range may overlap the bytes that are being appended.
fn repeat(bytes: &mut Vec<u8>, start: usize, length: usize) {
    let distance = bytes.len() - start;
    if length <= distance {
        bytes.extend_from_within(start..start + length);
    } else {
        (start..start + length).for_each(|at| bytes.push(bytes[at]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_and_an_overlapping_copy_are_unpacked() {
        // The stream is "ab", followed by a copy of 6 bytes from 2 bytes back.
        assert_eq!(unpack(&[1, b'a', b'b', 4 << 5, 1], 8).unwrap(), b"abababab");
        // The copy has an additional length byte: 7 + 1 + 2 bytes from 1 byte back.
        assert_eq!(unpack(&[0, b'x', 7 << 5, 1, 0], 11).unwrap(), b"xxxxxxxxxxx");
    }

    #[test]
    fn invalid_streams_are_rejected() {
        fn error_text(packed: &[u8], expected: usize) -> &str {
            unpack(packed, expected).unwrap_err().what
        }
        assert_eq!(error_text(&[5, b'a'], 6), "the compressed data are truncated");
        assert_eq!(error_text(&[7 << 5], 9), "the compressed data are truncated");
        assert_eq!(
            error_text(&[0, b'a', 1 << 5, 1], 4),
            "a copy begins before the start of the data"
        );
        assert_eq!(error_text(&[1, b'a', b'b'], 1), "the data are longer than stated");
        assert_eq!(error_text(&[1, b'a', b'b'], 3), "the data are shorter than stated");
        assert_eq!(
            error_text(&[0], usize::MAX),
            "the compressed data are too short for the stated size"
        );
    }
}
