//! The cosines and sines of the parts of a full turn.

use std::borrow::Cow;
use std::f64::consts::PI;
use std::sync::LazyLock;

/// Up to this many parts they come from a table.
const TABLE: usize = 32;

/// The cosine and sine of each part of a full turn, by the number of parts.
static TURNS: LazyLock<Vec<Vec<[f64; 2]>>> =
    LazyLock::new(|| (0..=TABLE).map(|n| (0..n).map(|j| compute(j, n)).collect()).collect());

/// The cosine and sine of `j` of `n` parts.
pub(crate) fn turn(j: usize, n: usize) -> [f64; 2] {
    let known = TURNS.get(n).and_then(|turns| turns.get(j));
    known.copied().unwrap_or_else(|| compute(j, n))
}

/// The cosines and sines of all of `n` parts.
pub(crate) fn turns(n: usize) -> Cow<'static, [[f64; 2]]> {
    TURNS.get(n).map_or_else(
        || Cow::Owned((0..n).map(|j| compute(j, n)).collect()),
        |turns| Cow::Borrowed(&turns[..]),
    )
}

fn compute(j: usize, n: usize) -> [f64; 2] {
    let angle = 2.0 * PI * j as f64 / n as f64;
    [libm::cos(angle), libm::sin(angle)]
}
