//! Limits on the size of a node's results and on its memory. They are checked before the node computes anything.

use std::fmt::Display;

/// Maximum number of items that a node creates, with the texts of the error message.
///
/// ```
/// use maquette_node::Limit;
///
/// const SPARKS: Limit =
///     Limit { max: 1_000_000, items: "sparks", help: "choose a smaller `brightness`" };
///
/// assert!(SPARKS.check("the fire", 2e5).is_ok());
/// assert_eq!(
///     SPARKS.check("the fire", 4.13e6).unwrap_err().to_string(),
///     "the fire would need about 4 100 000 sparks, at most 1 000 000 are made: choose a smaller `brightness`"
/// );
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limit {
    /// The maximum number of items that the node creates.
    pub max: usize,
    /// The name of the items in the plural: `triangles`.
    pub items: &'static str,
    /// The help text of the error, such as `choose a smaller \`brightness\``.
    pub help: &'static str,
}

/// Error returned by [`Limit::check`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{what} would need about {} {items}, at most {} are made: {help}", format_count(*need), format_count(*max as f64))]
pub struct LimitError {
    what: String,
    need: f64,
    max: usize,
    items: &'static str,
    help: &'static str,
}

impl Limit {
    /// Checks that a result that needs about `need` items is within the limit. `what` is the name of the result in the message. `need` is a
    /// floating-point number, so that estimates do not overflow; NaN exceeds every limit.
    ///
    /// # Errors
    /// If `need` exceeds the limit.
    pub fn check(&self, what: impl Display, need: f64) -> Result<(), LimitError> {
        if need <= self.max as f64 { Ok(()) } else { Err(self.error(what, need)) }
    }

    /// Returns the error that the result `what` needs `need` items, which is more than the limit.
    pub fn error(&self, what: impl Display, need: f64) -> LimitError {
        let Self { max, items, help } = *self;
        LimitError { what: what.to_string(), need, max, items, help }
    }
}

/// An upper bound of the memory that a node needs, which [`Node::estimate`](crate::Node::estimate) returns before the node runs.
///
/// If a node needs more than the memory budget, the evaluator rejects it. If it needs more than is currently free, the evaluator delays it
/// until other nodes have finished.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Peak memory in bytes of results and temporary data, not including the inputs. A floating-point number, so that estimates do not
    /// overflow; NaN exceeds every budget.
    pub bytes: f64,
    /// The help text of the error, such as `choose fewer \`levels\``.
    pub help: &'static str,
}

impl Estimate {
    /// Returns the memory in bytes as an integer. For NaN, returns `u64::MAX`.
    #[doc(hidden)]
    pub fn whole_bytes(self) -> u64 {
        if self.bytes.is_nan() { u64::MAX } else { self.bytes as u64 }
    }
}

/// Error of a node that needs more memory than is left in the budget.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("it would need {}, {} are held already and {} are allowed in all: {help}{}, or allow more (--max-memory)", format_bytes(*need), format_bytes(*held as f64), format_bytes(*most as f64), fits.as_ref().map_or_else(String::new, |fits| format!(", {fits}")))]
#[doc(hidden)]
pub struct MemoryError {
    /// Memory in bytes that the node's [`Estimate`] states.
    #[doc(hidden)]
    pub need: f64,
    /// Memory in bytes that other nodes and the results in memory occupy.
    #[doc(hidden)]
    pub held: u64,
    /// The memory budget for all results and nodes together, in bytes.
    #[doc(hidden)]
    pub most: u64,
    #[doc(hidden)]
    pub help: &'static str,
    /// The size of the inputs that would fit, as a part of the help text.
    #[doc(hidden)]
    pub fits: Option<String>,
}

/// Formats a number of bytes with a decimal unit, such as `4.2 GB`. Numbers below 1 kB are exact.
fn format_bytes(bytes: f64) -> String {
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

/// Formats a number with two significant digits and with spaces between groups of three digits, such as `4 100 000`.
fn format_count(number: f64) -> String {
    const MAX_GROUPED: f64 = 1e15;
    if number.is_nan() || number >= MAX_GROUPED {
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
    fn numbers_have_two_digits_and_groups() {
        let numbers = [0.0, 7.0, 99.6, 1234.0, 16_777_216.0, 4_149_999.0, 9.96e8, 3e17];
        let words = numbers.map(format_count);
        let expected =
            ["0", "7", "100", "1 200", "17 000 000", "4 100 000", "1 000 000 000", "3.0e17"];
        assert_eq!(words, expected);
        assert_eq!([f64::INFINITY, f64::NAN].map(format_count), ["inf", "NaN"]);
    }

    #[test]
    fn bytes_are_formatted_in_a_fitting_unit() {
        let bytes = [0.0, 999.0, 1000.0, 4.24e9, 9.97e6, 3.5e15, 2e30];
        let words = ["0 B", "999 B", "1.0 kB", "4.2 GB", "10 MB", "3.5 PB", "2.0e30 B"];
        assert_eq!(bytes.map(format_bytes), words);
        assert_eq!([f64::INFINITY, f64::NAN].map(format_bytes), ["inf B", "NaN B"]);
    }

    #[test]
    fn only_needs_up_to_the_limit_are_accepted() {
        let limit = Limit { max: 10, items: "things", help: "ask for less" };
        assert_eq!(limit.check("it", 10.0), Ok(()));
        for need in [10.5, f64::INFINITY, f64::NAN] {
            assert!(limit.check("it", need).is_err(), "{need}");
        }
    }
}
