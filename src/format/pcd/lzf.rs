//! LZF, the compression of `binary_compressed` PCD files.
//!
//! A stream of literal runs (a byte n < 32, then n + 1 bytes) and of copies from what was written before (a byte with the length
//! in its upper 3 bits, 7 of them meaning that a byte of more length follows, and the distance in the rest and the next byte).
//! The format is that of Marc Lehmann's LibLZF.

/// Where a stream is broken: the byte, and how.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Broken {
    pub(super) byte: usize,
    pub(super) what: &'static str,
}

/// No stream unpacks to more than this many times its length: a copy of 264 bytes takes 3.
const MOST_EXPANSION: usize = 88;

/// The `expected` bytes that `packed` stands for. Memory is reserved only if the stream can be long enough.
pub(super) fn unpack(packed: &[u8], expected: usize) -> Result<Vec<u8>, Broken> {
    if expected > packed.len().saturating_mul(MOST_EXPANSION) {
        return Err(Broken { byte: 0, what: "too few compressed bytes for the size promised" });
    }
    let mut unpacked = Vec::with_capacity(expected);
    let mut next = 0;
    while let Some(&control) = packed.get(next) {
        let byte = next;
        fn broken(what: &'static str, byte: usize) -> Broken {
            Broken { byte, what }
        }
        let cut_off = || broken("the compressed data are cut off", byte);
        let read = |at: usize| packed.get(at).map(|&byte| usize::from(byte)).ok_or_else(cut_off);
        next += 1;
        if control < 32 {
            let end = next + usize::from(control) + 1;
            unpacked.extend_from_slice(packed.get(next..end).ok_or_else(cut_off)?);
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
            let start = start.ok_or_else(|| broken("a copy from before the beginning", byte))?;
            repeat(&mut unpacked, start, length + 2);
        }
        if unpacked.len() > expected {
            return Err(broken("more data than promised", byte));
        }
    }
    if unpacked.len() < expected {
        return Err(Broken { byte: packed.len(), what: "less data than promised" });
    }
    Ok(unpacked)
}

/// Appends `length` bytes from `start` on, which may reach into what is being appended.
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
    fn a_run_and_a_copy_that_reaches_into_itself_unpack() {
        // "ab", then 6 bytes from 2 bytes back.
        assert_eq!(unpack(&[1, b'a', b'b', 4 << 5, 1], 8).unwrap(), b"abababab");
        // A copy with a byte of more length: 7 + 1 + 2 bytes from 1 byte back.
        assert_eq!(unpack(&[0, b'x', 7 << 5, 1, 0], 11).unwrap(), b"xxxxxxxxxxx");
    }

    #[test]
    fn broken_streams_are_refused() {
        fn what(packed: &[u8], expected: usize) -> &str {
            unpack(packed, expected).unwrap_err().what
        }
        assert_eq!(what(&[5, b'a'], 6), "the compressed data are cut off");
        assert_eq!(what(&[7 << 5], 9), "the compressed data are cut off");
        assert_eq!(what(&[0, b'a', 1 << 5, 1], 4), "a copy from before the beginning");
        assert_eq!(what(&[1, b'a', b'b'], 1), "more data than promised");
        assert_eq!(what(&[1, b'a', b'b'], 3), "less data than promised");
        assert_eq!(what(&[0], usize::MAX), "too few compressed bytes for the size promised");
    }
}
