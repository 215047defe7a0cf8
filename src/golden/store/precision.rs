//! How exactly the numbers of a column are kept: exactly enough to decide whether a new value is within the tolerance.
//!
//! A number is rounded to a step that is a small part of the tolerance, so that rounding does not decide. With a small tolerance these
//! would be many digits, which cannot be compressed. Then two things are kept instead: the number on a coarse step, which tells where
//! something is and about how far it moved; and the last digits of the number on the fine step. From these the old number follows if it has
//! hardly changed: it is the one with the same last digits that is nearest to the new one. A checksum of all numbers of the column (its
//! mark) confirms this; if any number has changed more, the mark is another one.

use crate::compare::{Tolerance, allowed, given, size};
use crate::parts::{Class, GoldenColumn};

/// Columns of no more numbers than this are kept to the last bit.
pub(super) const FEW: usize = 256;

/// The roughest step, as a share of the diagonal of all places or of the range of all numbers: a report is to tell where and how
/// far to three digits. Ten times rougher, small moves would read as none; ten times finer, a number takes three bits more.
const SHOWN: f64 = 1e-5;

/// The same for normals, in degrees.
const SHOWN_ANGLE: f64 = 0.01;

/// So many steps are in what a test file allows. An element's three numbers are then off by a seventieth of it together.
const STEPS_GIVEN: f64 = 64.0;

/// So many steps are in the default tolerance, which is a guess at what a harmless change of code does.
const STEPS: f64 = 24.0;

/// Last digits for these: some more than what is allowed must fit into them in both directions.
const BITS_GIVEN: u32 = 8;
const BITS: u32 = 6;

/// Last digits of directions are kept if none is this many times longer than another: else equal angles are unequal steps.
const ALIKE: f64 = 1.02;

/// Whole numbers beyond this are not kept as such.
const MOST: f64 = (1u64 << 52) as f64;

/// How exactly a column is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Precision {
    /// Numbers are rounded to multiples of it; 0 if they are kept to the last bit.
    pub(super) step: f64,
    /// How far an element may be off, in the unit of its differences.
    pub(super) error: f64,
    pub(super) last: Option<Last>,
    /// Directions shorter than this are kept to the last bit: of them, any step would be a large angle.
    pub(super) shortest: f64,
}

/// How the last digits are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Last {
    pub(super) step: f64,
    pub(super) bits: u32,
    pub(super) error: f64,
}

impl Last {
    /// How far some element moved at least where the mark is another one.
    pub(super) fn reach(&self, width: usize) -> f64 {
        let step = 2.0 * self.error / (width as f64).sqrt();
        f64::from((1 << (self.bits - 1)) - 2) * step / ALIKE
    }
}

impl Precision {
    const EXACT: Self = Self { step: 0.0, error: 0.0, last: None, shortest: 0.0 };

    pub(super) fn finest(&self) -> f64 {
        self.last.map_or(self.step, |last| last.step)
    }

    /// Whether an element is kept to the last bit, because it is no multiple of the finest step.
    pub(super) fn is_odd(&self, element: &[f64], finest: f64) -> bool {
        let most = MOST * finest;
        fn is_short(element: &[f64], shortest: f64) -> bool {
            let length_sq: f64 = element.iter().map(|x| x * x).sum();
            shortest > 0.0 && 0.0 < length_sq && length_sq < shortest * shortest
        }
        !element.iter().all(|x| x.abs() < most) || is_short(element, self.shortest)
    }

    /// The same with one part instead of two: of numbers that are foretold well, that takes fewer bytes.
    pub(super) fn whole(&self) -> Option<Self> {
        let last = self.last?;
        Some(Self { step: last.step, error: last.error, last: None, ..*self })
    }
}

/// How exactly a column is to be kept, if so much is allowed.
pub(super) fn precision(part: &GoldenColumn, tolerance: &Tolerance) -> Precision {
    if matches!(part.class, Class::Exact | Class::Level) {
        return Precision { step: 1.0, ..Precision::EXACT };
    }
    if part.numbers.len() <= FEW {
        return Precision::EXACT;
    }
    let is_normal = part.class == Class::Normal;
    let (shortest, longest) = if is_normal { lengths(part) } else { (0.0, 0.0) };
    // A difference of 1 as one of numbers.
    let scale = if is_normal { 1f64.to_radians() * shortest } else { 1.0 };
    let shown = if is_normal { SHOWN_ANGLE } else { SHOWN * size(part) };
    let by_mean = [tolerance.rms, tolerance.p99].into_iter().flatten();
    let by_mean = by_mean.filter(|most| part.class == Class::Place && *most > 0.0);
    let step = by_mean.fold(shown, |step, most| f64::min(step, most / STEPS_GIVEN));
    let (steps, bits) = match given(part, tolerance) {
        Some(_) => (STEPS_GIVEN, BITS_GIVEN),
        None => (STEPS, BITS),
    };
    let fine = allowed(part, tolerance) / steps;
    fn off(step: f64, part_width: usize) -> f64 {
        step * (part_width as f64).sqrt() / 2.0
    }
    let last = (0.0 < fine && fine < step).then(|| Last {
        step: fine * scale,
        bits,
        error: off(fine, part.width),
    });
    let step_of_numbers = step * scale;
    if !(step_of_numbers.is_normal() && last.is_none_or(|last| last.step.is_normal())) {
        return Precision::EXACT;
    }
    let precision =
        Precision { step: step_of_numbers, error: off(step, part.width), last, shortest };
    if longest > ALIKE * shortest { precision.whole().unwrap_or(precision) } else { precision }
}

/// The lengths of the shortest and the longest direction, without those that are hardly one.
fn lengths(part: &GoldenColumn) -> (f64, f64) {
    let lengths = || {
        part.numbers
            .chunks(part.width)
            .map(|element| element.iter().map(|x| x * x).sum::<f64>().sqrt())
            .filter(|length| *length > 0.0)
    };
    let longest = lengths().filter(|length| length.is_finite()).fold(0.0, f64::max);
    (lengths().filter(|length| *length > 1e-3 * longest).fold(longest, f64::min), longest)
}
