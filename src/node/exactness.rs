//! How equal the results of a node are wherever it runs.

use serde_json::{Value as Json, json};

/// How equal a node's results are on all machines and for all builds of a program.
///
/// It says what readers and tests may rely on. It is no part of a key.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Exactness {
    /// They are the same bytes.
    #[default]
    Exact,
    /// Their numbers are equal within this fraction of the size of the value: of the diagonal of the box around places, of the range
    /// of other numbers. For nodes that call what rounds otherwise elsewhere, such as a graphics card or a library that fuses products
    /// and sums where the processor can.
    Tolerant(f64),
}

impl Exactness {
    /// The exactness of what is computed of both.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        match (self, other) {
            (Self::Exact, it) | (it, Self::Exact) => it,
            (Self::Tolerant(a), Self::Tolerant(b)) => Self::Tolerant(a.max(b)),
        }
    }

    /// Returns true unless it is a tolerance that no two results can keep, or that all do.
    #[doc(hidden)]
    pub fn is_sound(self) -> bool {
        match self {
            Self::Exact => true,
            Self::Tolerant(fraction) => fraction > 0.0 && fraction < 1.0,
        }
    }

    /// It in words, for the manual.
    #[doc(hidden)]
    pub fn in_words(self) -> String {
        match self {
            Self::Exact => "exact: the same bytes on every machine and build".into(),
            Self::Tolerant(fraction) => format!(
                "tolerant: on every machine and build equal within {fraction:e} of the size of the value"
            ),
        }
    }

    /// It as `maquette nodes --json` prints it: `"exact"`, or `{"tolerant": 1e-6}`.
    #[doc(hidden)]
    pub fn to_json(self) -> Json {
        match self {
            Self::Exact => "exact".into(),
            Self::Tolerant(fraction) => json!({ "tolerant": fraction }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Exactness::{Exact, Tolerant};

    #[test]
    fn what_is_computed_of_several_is_as_exact_as_the_worst_of_them() {
        assert_eq!(Exact.and(Exact), Exact);
        assert_eq!(Exact.and(Tolerant(1e-6)), Tolerant(1e-6));
        assert_eq!(Tolerant(1e-3).and(Tolerant(1e-6)), Tolerant(1e-3));
    }

    #[test]
    fn a_tolerance_is_a_fraction() {
        assert!(Exact.is_sound() && Tolerant(1e-6).is_sound());
        for wrong in [0.0, -1.0, 1.0, f64::INFINITY, f64::NAN] {
            assert!(!Tolerant(wrong).is_sound(), "{wrong}");
        }
    }
}
