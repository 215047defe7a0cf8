//! The cosines and sines of `2 pi j / n`.

use std::borrow::Cow;
use std::f64::consts::PI;
use std::sync::LazyLock;

/// The maximum `n` for which values are precomputed.
const TABLE: usize = 32;

/// The precomputed values: `[n][j]` has the cosine and sine of `2 pi j / n`.
static ROOTS: LazyLock<Vec<Vec<[f64; 2]>>> =
    LazyLock::new(|| (0..=TABLE).map(|n| (0..n).map(|j| compute(j, n)).collect()).collect());

/// The cosine and sine of `2 pi j / n`.
pub(crate) fn root_of_unity(j: usize, n: usize) -> [f64; 2] {
    let known = ROOTS.get(n).and_then(|turns| turns.get(j));
    known.copied().unwrap_or_else(|| compute(j, n))
}

/// The cosines and sines of `2 pi j / n` for all `j < n`.
pub(crate) fn roots_of_unity(n: usize) -> Cow<'static, [[f64; 2]]> {
    ROOTS.get(n).map_or_else(
        || Cow::Owned((0..n).map(|j| compute(j, n)).collect()),
        |turns| Cow::Borrowed(&turns[..]),
    )
}

fn compute(j: usize, n: usize) -> [f64; 2] {
    let angle = 2.0 * PI * j as f64 / n as f64;
    [libm::cos(angle), libm::sin(angle)]
}
