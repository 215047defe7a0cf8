//! How much a node makes at most: what would need more is refused, with numbers, before the work begins.

use std::fmt::Display;

/// The most that a node makes of something: a constant beside the work that it bounds.
///
/// ```
/// use maquette::Limit;
///
/// const SPARKS: Limit =
///     Limit { most: 1_000_000, of: "sparks", help: "choose a smaller `brightness`" };
///
/// assert!(SPARKS.check("the fire", 2e5).is_ok());
/// assert_eq!(
///     SPARKS.check("the fire", 4.13e6).unwrap_err().to_string(),
///     "the fire would need about 4 100 000 sparks, at most 1 000 000 are made: choose a smaller `brightness`"
/// );
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limit {
    /// So many are made at most.
    pub most: usize,
    /// What is counted, in the plural: `triangles`.
    pub of: &'static str,
    /// What the user can do.
    pub help: &'static str,
}

/// Something would need more than a node makes.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{what} would need about {} {of}, at most {} are made: {help}", in_words(*need), in_words(*most as f64))]
pub struct TooMuch {
    what: String,
    need: f64,
    most: usize,
    of: &'static str,
    help: &'static str,
}

impl Limit {
    /// Whether `what`, which needs about so many, may be made. A need is a float, so that an estimate does not overflow; one that
    /// is NaN is too much.
    ///
    /// # Errors
    /// If it needs more.
    pub fn check(&self, what: impl Display, need: f64) -> Result<(), TooMuch> {
        if need <= self.most as f64 { Ok(()) } else { Err(self.refused(what, need)) }
    }

    /// The error of `what`, which is known to need too much.
    pub fn refused(&self, what: impl Display, need: f64) -> TooMuch {
        let Self { most, of, help } = *self;
        TooMuch { what: what.to_string(), need, most, of, help }
    }
}

/// A number with two digits that count, in groups of three: `4 100 000`.
fn in_words(number: f64) -> String {
    const LARGEST: f64 = 1e15;
    if number.is_nan() || number >= LARGEST {
        return format!("{number:.1e}");
    }
    let mut unit = 1.0;
    while number / unit >= 100.0 {
        unit *= 10.0;
    }
    let digits = format!("{:.0}", (number / unit).round() * unit);
    let groups = digits.as_bytes().rchunks(3).rev();
    let groups = Vec::from_iter(groups.map(|group| String::from_utf8_lossy(group)));
    groups.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_told_with_two_digits_in_groups() {
        let numbers = [0.0, 7.0, 99.6, 1234.0, 16_777_216.0, 4_149_999.0, 9.96e8, 3e17];
        let words = numbers.map(in_words);
        let expected =
            ["0", "7", "100", "1 200", "17 000 000", "4 100 000", "1 000 000 000", "3.0e17"];
        assert_eq!(words, expected);
        assert_eq!([f64::INFINITY, f64::NAN].map(in_words), ["inf", "NaN"]);
    }

    #[test]
    fn as_much_as_the_limit_may_be_made_and_no_more() {
        let limit = Limit { most: 10, of: "things", help: "ask for less" };
        assert_eq!(limit.check("it", 10.0), Ok(()));
        for need in [10.5, f64::INFINITY, f64::NAN] {
            assert!(limit.check("it", need).is_err(), "{need}");
        }
    }
}
