//! How much a node makes at most: what would need more is refused, with numbers, before the work begins.

use std::fmt::Display;

/// The most that a node makes of something: a constant beside the work that it bounds.
///
/// ```
/// use maquette_node::Limit;
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

/// How much memory a node needs at most, told before it runs: see [`Node::estimate`](crate::Node::estimate).
///
/// The evaluator refuses a node that needs more than may be held, or has it wait for others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Bytes that it holds at most at a time: its results and what it works on, without its inputs. A float, so that it does not
    /// overflow; one that is NaN is too much.
    pub bytes: f64,
    /// What the user can do: `choose fewer \`levels\``.
    pub help: &'static str,
}

impl Estimate {
    /// The bytes as a whole number.
    #[doc(hidden)]
    pub fn whole(self) -> u64 {
        if self.bytes.is_nan() { u64::MAX } else { self.bytes as u64 }
    }
}

/// A node would need more memory than is left of what may be held.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("it would need {}, {} are held already and {} are allowed in all: {help}, or allow more (--max-memory)", in_bytes(*need), in_bytes(*held as f64), in_bytes(*most as f64))]
#[doc(hidden)]
pub struct NoRoom {
    /// Bytes, as its [`Estimate`] says.
    #[doc(hidden)]
    pub need: f64,
    /// What other results and nodes hold.
    #[doc(hidden)]
    pub held: u64,
    /// What may be held in all.
    #[doc(hidden)]
    pub most: u64,
    #[doc(hidden)]
    pub help: &'static str,
}

/// `4.2 GB`; what is below a kilobyte is told exactly.
fn in_bytes(bytes: f64) -> String {
    const UNITS: [&str; 6] = ["kB", "MB", "GB", "TB", "PB", "EB"];
    let mut unit = 1e3;
    for name in UNITS {
        if bytes < 999.5 * unit {
            return match bytes / unit {
                less if less < 1.0 => format!("{bytes:.0} B"),
                few if few < 9.95 => format!("{few:.1} {name}"),
                many => format!("{many:.0} {name}"),
            };
        }
        unit *= 1e3;
    }
    format!("{bytes:.1e} B")
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
    let groups: Vec<_> = groups.map(|group| String::from_utf8_lossy(group)).collect();
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
    fn bytes_are_told_with_two_or_three_digits_in_the_unit_that_fits() {
        let bytes = [0.0, 999.0, 1000.0, 4.24e9, 9.97e6, 3.5e15, 2e30];
        let words = ["0 B", "999 B", "1.0 kB", "4.2 GB", "10 MB", "3.5 PB", "2.0e30 B"];
        assert_eq!(bytes.map(in_bytes), words);
        assert_eq!([f64::INFINITY, f64::NAN].map(in_bytes), ["inf B", "NaN B"]);
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
