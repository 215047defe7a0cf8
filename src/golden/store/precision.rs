//! The precision with which a golden stores the numbers of a column. It is high enough to decide if a new value is within the tolerance.
//!
//! A number is rounded to a step that is a small fraction of the tolerance, so rounding does not affect the verdict. For a small tolerance
//! the rounded number has many digits, which cannot be compressed. Then two parts of it are stored instead. The first is the number rounded
//! to a coarse step; it shows where a difference is, and about how large it is. The second are the last digits of the number rounded to the
//! fine step. If a number has hardly changed, the old one can be restored from them: it is the number with these last digits that is
//! nearest to the new number. A hash of all numbers of the column (its mark) shows if that is right.

use crate::compare::{Tolerance, allowed_difference, explicit_limit, size};
use crate::parts::{Class, GoldenColumn};

/// The maximum count of numbers for which a column is stored to the last bit.
pub(super) const MAX_EXACT_NUMBERS: usize = 256;

/// The coarsest step, as a fraction of the diagonal of all positions or of the range of all numbers. With this step a report can state
/// positions and distances to three digits. A step ten times larger would hide small moves. A step ten times smaller would take three more
/// bits for each number.
const COARSEST_STEP: f64 = 1e-5;

/// The coarsest step for normals, in degrees.
const COARSEST_ANGLE_STEP: f64 = 0.01;

/// The number of steps in a limit that the test file sets. With this value, the rounding error of an element of three numbers is a
/// seventieth of the limit.
const STEPS_GIVEN: f64 = 64.0;

/// The number of steps in a default tolerance. It may be smaller, because the default is only an estimate of the effect of harmless changes
/// of code.
const STEPS: f64 = 24.0;

/// The number of bits in the last digits, if the test file sets the limit (`BITS_GIVEN`) or not (`BITS`). The digits must cover more than
/// the tolerance in both directions.
const BITS_GIVEN: u32 = 8;
const BITS: u32 = 6;

/// The maximum ratio of the longest to the shortest direction vector for which last digits are stored. With a larger ratio, equal angles
/// would mean very different changes of the numbers.
const MAX_LENGTH_RATIO: f64 = 1.02;

/// The largest number that is stored as a whole number of steps. Larger ones are stored to the last bit.
const MAX_WHOLE_NUMBER: f64 = (1u64 << 52) as f64;

/// The precision with which a column is stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Precision {
    /// The step to which numbers are rounded; 0 if they are stored to the last bit.
    pub(super) step: f64,
    /// The maximum rounding error of an element, in the unit of its differences.
    pub(super) error: f64,
    pub(super) last: Option<LastDigits>,
    /// The length below which a direction vector is stored to the last bit. For such a short vector any step would be a large angle.
    pub(super) shortest: f64,
}

/// The precision with which the last digits are stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LastDigits {
    pub(super) step: f64,
    pub(super) bits: u32,
    pub(super) error: f64,
}

impl LastDigits {
    /// Returns a lower bound for how far some element has moved if the mark (the hash of all numbers of the column) has changed.
    pub(super) fn reach(&self, width: usize) -> f64 {
        let step = 2.0 * self.error / (width as f64).sqrt();
        f64::from((1 << (self.bits - 1)) - 2) * step / MAX_LENGTH_RATIO
    }
}

impl Precision {
    const EXACT: Self = Self { step: 0.0, error: 0.0, last: None, shortest: 0.0 };

    pub(super) fn finest(&self) -> f64 {
        self.last.map_or(self.step, |last| last.step)
    }

    /// Returns true if an element is odd: too large, too short or not finite, so that it is stored to the last bit.
    pub(super) fn is_odd(&self, element: &[f64], finest: f64) -> bool {
        let most = MAX_WHOLE_NUMBER * finest;
        fn is_short(element: &[f64], shortest: f64) -> bool {
            let length_sq: f64 = element.iter().map(|x| x * x).sum();
            shortest > 0.0 && 0.0 < length_sq && length_sq < shortest * shortest
        }
        !element.iter().all(|x| x.abs() < most) || is_short(element, self.shortest)
    }

    /// Returns a precision that stores each number in one part, without separate last digits. That takes fewer bytes if the predictions are
    /// good.
    pub(super) fn in_one_part(&self) -> Option<Self> {
        let last = self.last?;
        Some(Self { step: last.step, error: last.error, last: None, ..*self })
    }
}

/// Returns the precision with which a column must be stored for a tolerance.
pub(super) fn precision(part: &GoldenColumn, tolerance: &Tolerance) -> Precision {
    if matches!(part.class, Class::Exact | Class::Level) {
        return Precision { step: 1.0, ..Precision::EXACT };
    }
    if part.numbers.len() <= MAX_EXACT_NUMBERS {
        return Precision::EXACT;
    }
    let is_normal = part.class == Class::Normal;
    let (shortest, longest) = if is_normal { lengths(part) } else { (0.0, 0.0) };
    // For directions: the change of the numbers for an angle of 1 degree.
    let scale = if is_normal { 1f64.to_radians() * shortest } else { 1.0 };
    let shown = if is_normal { COARSEST_ANGLE_STEP } else { COARSEST_STEP * size(part) };
    let by_mean = [tolerance.rms, tolerance.p99].into_iter().flatten();
    let by_mean = by_mean.filter(|most| part.class == Class::Position && *most > 0.0);
    let step = by_mean.fold(shown, |step, most| f64::min(step, most / STEPS_GIVEN));
    let (steps, bits) = match explicit_limit(part, tolerance) {
        Some(_) => (STEPS_GIVEN, BITS_GIVEN),
        None => (STEPS, BITS),
    };
    let fine = allowed_difference(part, tolerance) / steps;
    /// Returns the maximum rounding error of an element of `width` numbers that are each rounded to a multiple of `step`.
    fn rounding_error(step: f64, width: usize) -> f64 {
        step * (width as f64).sqrt() / 2.0
    }
    let last = (0.0 < fine && fine < step).then(|| LastDigits {
        step: fine * scale,
        bits,
        error: rounding_error(fine, part.width),
    });
    let step_of_numbers = step * scale;
    if !(step_of_numbers.is_normal() && last.is_none_or(|last| last.step.is_normal())) {
        return Precision::EXACT;
    }
    let precision = Precision {
        step: step_of_numbers,
        error: rounding_error(step, part.width),
        last,
        shortest,
    };
    if longest > MAX_LENGTH_RATIO * shortest {
        precision.in_one_part().unwrap_or(precision)
    } else {
        precision
    }
}

/// Returns the lengths of the shortest and the longest direction vector. Vectors of nearly zero length are ignored.
fn lengths(part: &GoldenColumn) -> (f64, f64) {
    let elements = part.numbers.chunks(part.width);
    let lengths = elements.map(|element| element.iter().map(|x| x * x).sum::<f64>().sqrt());
    let lengths: Vec<f64> = lengths.filter(|length| *length > 0.0).collect();
    let finite = lengths.iter().copied().filter(|length| length.is_finite());
    let longest = finite.fold(0.0, f64::max);
    let long = lengths.iter().copied().filter(|length| *length > 1e-3 * longest);
    (long.fold(longest, f64::min), longest)
}
