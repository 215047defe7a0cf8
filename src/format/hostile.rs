//! Files that lie: valid ones, cut and bent.

use maquette_value::random::{STEP, mix};

/// Calls `read` with `file` cut at every length, and with some thousand versions of it in which a few bytes are others:
/// by any result but a panic the reader passes.
pub(crate) fn survive<T>(file: &[u8], read: impl Fn(&[u8]) -> T) {
    (0..file.len()).for_each(|length| drop(read(&file[..length])));
    for case in 0..3000 {
        let mut bent = file.to_vec();
        for change in 0..1 + case % 4 {
            let random = scramble(case * 8 + change);
            let at = random as usize % bent.len();
            let byte = (random >> 40) as u8;
            // Digits make other numbers of numbers, other bytes break them.
            bent[at] = if random >> 63 == 0 { byte } else { b'0' + byte % 10 };
        }
        drop(read(&bent));
    }
}

fn scramble(counter: u64) -> u64 {
    mix(counter.wrapping_add(1).wrapping_mul(STEP))
}
