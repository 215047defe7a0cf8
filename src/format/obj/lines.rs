//! Reads lines of OBJ files, and the numbers in them.

use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::parallel::StopFlag;
use memchr::{memchr, memchr_iter};

use crate::{not_a_number, parse_real};

/// Calls `read` with each line and its number. A line that ends with `\` is joined with the next one. Comments are not removed.
pub(super) fn for_lines(
    bytes: &[u8],
    mut read: impl FnMut(&[u8], usize) -> Result<(), Error>,
) -> Result<(), Error> {
    // Very old programs end lines with CR alone.
    let end = if memchr(b'\n', bytes).is_some() { b'\n' } else { b'\r' };
    let mut start = 0;
    let ends = memchr_iter(end, bytes).chain([bytes.len()]);
    let lines = ends.map(|end| &bytes[std::mem::replace(&mut start, end + 1)..end]);
    let mut lines = lines.enumerate();
    let stop = StopFlag::current();
    while let Some((index, text)) = lines.next() {
        stop.check();
        let text = text.trim_ascii_end();
        let Some(start) = text.strip_suffix(b"\\") else {
            read(text, index + 1)?;
            continue;
        };
        // Only lines with a continuation are copied.
        let mut joined = start.to_vec();
        for (_, next) in lines.by_ref() {
            let next = next.trim_ascii_end();
            let part = next.strip_suffix(b"\\");
            joined.push(b' ');
            joined.extend_from_slice(part.unwrap_or(next));
            if part.is_none() {
                break;
            }
        }
        read(&joined, index + 1)?;
    }
    Ok(())
}

/// Returns the line without its comment. The `#` of `1.#QNAN` does not begin a comment.
pub(super) fn without_comment(text: &[u8]) -> &[u8] {
    let end = memchr_iter(b'#', text).find(|hash| !text[..*hash].ends_with(b"."));
    &text[..end.unwrap_or(text.len())]
}

/// Converts an index of a file to an index from 0. In the file, 1 is the first element and -1 the last element so far.
pub(super) fn resolve(index: i64, what: &str, count: usize, line: usize) -> Result<usize, Error> {
    let resolved = if index < 0 { index + count as i64 } else { index - 1 };
    match usize::try_from(resolved) {
        Ok(resolved) if resolved < count => Ok(resolved),
        _ => bail!("line {line}: there is no {what} {index} among the {count} so far"),
    }
}

/// Reads the first numbers of a line: at least `min` and at most N. Returns them with their count.
pub(super) fn numbers<'a, const N: usize>(
    words: impl Iterator<Item = &'a [u8]>,
    min: usize,
    line: usize,
) -> Result<([f64; N], usize), Error> {
    let mut numbers = [0.0; N];
    let mut found = 0;
    for (number, word) in numbers.iter_mut().zip(words) {
        *number = parse_real(word).ok_or_else(|| not_a_number(line, word))?;
        found += 1;
    }
    if found < min {
        bail!("line {line}: expected at least {min} numbers, found {found}");
    }
    Ok((numbers, found))
}
