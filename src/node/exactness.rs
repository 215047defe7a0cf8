//! The exactness of a node: how closely its results agree between machines and builds.

use serde_json::{Value as Json, json};

/// How closely the results of a node agree between machines and builds of the program.
///
/// Readers of results, and tests, may rely on the exactness. It is not part of the cache key.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Exactness {
    /// The results have the same bytes on all machines.
    #[default]
    Exact,
    /// The numbers are equal within this fraction of the size of the value. For positions, the size is the diagonal of the bounding box;
    /// for other numbers, it is their range. Use this for nodes whose rounding depends on the machine, such as nodes that use a graphics
    /// card or a library with fused multiply-add.
    Tolerant(f64),
}

impl Exactness {
    /// Returns the exactness of a result that is computed from two others, whose exactness is `self` and `other`: the less exact of the
    /// two.
    #[must_use]
    pub fn combine(self, other: Self) -> Self {
        match (self, other) {
            (Self::Exact, it) | (it, Self::Exact) => it,
            (Self::Tolerant(a), Self::Tolerant(b)) => Self::Tolerant(a.max(b)),
        }
    }

    /// Returns true if the tolerance is valid: between 0 and 1, both exclusive.
    #[doc(hidden)]
    pub fn is_sound(self) -> bool {
        match self {
            Self::Exact => true,
            Self::Tolerant(fraction) => fraction > 0.0 && fraction < 1.0,
        }
    }

    /// Describes the exactness in words, for the manual.
    #[doc(hidden)]
    pub fn describe(self) -> String {
        match self {
            Self::Exact => "exact: the same bytes on every machine and build".into(),
            Self::Tolerant(fraction) => format!(
                "tolerant: on every machine and build equal within {fraction:e} of the size of the value"
            ),
        }
    }

    /// Returns the exactness in the form that `maquette nodes --json` prints: `"exact"`, or `{"tolerant": 1e-6}`.
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
    fn combined_exactness_is_the_worst_one() {
        assert_eq!(Exact.combine(Exact), Exact);
        assert_eq!(Exact.combine(Tolerant(1e-6)), Tolerant(1e-6));
        assert_eq!(Tolerant(1e-3).combine(Tolerant(1e-6)), Tolerant(1e-3));
    }

    #[test]
    fn a_tolerance_is_a_fraction() {
        assert!(Exact.is_sound() && Tolerant(1e-6).is_sound());
        for wrong in [0.0, -1.0, 1.0, f64::INFINITY, f64::NAN] {
            assert!(!Tolerant(wrong).is_sound(), "{wrong}");
        }
    }
}
