//! Damaged files for tests: valid files that are truncated or changed in a few bytes.

use maquette_value::rng::{STEP, mix};

/// Calls `read` with `file` truncated at every length, and with 3000 copies of `file` in which a few bytes are changed. The test passes if
/// no call panics.
pub(crate) fn check_no_panic<T>(file: &[u8], read: impl Fn(&[u8]) -> T) {
    (0..file.len()).for_each(|length| drop(read(&file[..length])));
    for case in 0..3000 {
        let mut damaged = file.to_vec();
        for change in 0..1 + case % 4 {
            let random = scramble(case * 8 + change);
            let at = random as usize % damaged.len();
            let byte = (random >> 40) as u8;
            // Text often stays valid if a byte becomes a digit, whereas most other bytes make it invalid.
            damaged[at] = if random >> 63 == 0 { byte } else { b'0' + byte % 10 };
        }
        drop(read(&damaged));
    }
}

fn scramble(counter: u64) -> u64 {
    mix(counter.wrapping_add(1).wrapping_mul(STEP))
}
