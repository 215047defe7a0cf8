//! Compares two columns element by element.

use maquette_engine::six_digits;
use maquette_value::parallel::*;

use super::{Measure, Tolerance, in_unit, unit};
use crate::parts::{Class, GoldenColumn};

/// The default tolerance, as a fraction of the diagonal of all positions or of the range of all numbers. The same program computes the same
/// bits each time. So it only has to allow for rounding when sums are computed in another order, some 1e-13. A larger tolerance would hide
/// faults; a smaller one would fail on harmless changes of code.
const DEFAULT_FRACTION: f64 = 1e-9;

/// The default limit for the angle between two normals, in degrees, if the tolerance allows positions to differ. A smaller angle is not
/// visible.
const DEFAULT_NORMAL_ANGLE: f64 = 0.5;

/// Returns the largest allowed difference of an element in a column.
pub(crate) fn allowed_difference(part: &GoldenColumn, tolerance: &Tolerance) -> f64 {
    let fraction = tolerance.default_fraction.unwrap_or(DEFAULT_FRACTION);
    explicit_limit(part, tolerance).unwrap_or_else(|| match part.class {
        Class::Position | Class::Number => fraction * size(part),
        Class::Normal => fraction.to_degrees(),
        Class::Level | Class::Exact => 0.0,
    })
}

/// Returns the limit that the tolerance sets for a column, or `None` if the default applies.
pub(crate) fn explicit_limit(part: &GoldenColumn, tolerance: &Tolerance) -> Option<f64> {
    let limit = limit_of(part, tolerance)?;
    let explicit = tolerance.limits().find(|(name, _)| *name == limit).map(|(_, most)| most);
    explicit.or(match part.class {
        Class::Exact => Some(0.0),
        Class::Level => Some(tolerance.level),
        Class::Normal => Some(DEFAULT_NORMAL_ANGLE),
        // The tolerance limits only `rms` or `p99`, so a single number may differ by any amount.
        Class::Position | Class::Number => Some(f64::INFINITY),
    })
}

/// Returns the name of that field or attribute of a tolerance which sets the limit for a column, or `None` if the default applies.
pub(crate) fn limit_of<'t>(part: &GoldenColumn, tolerance: &'t Tolerance) -> Option<&'t str> {
    // A limit for `uv` also applies to the column `corner uv`, and a limit for `area` to `face area`.
    let short = part.name.rsplit(' ').next().unwrap_or_default();
    let attributes = &tolerance.attributes;
    if let Some((name, _)) =
        attributes.get_key_value(&part.name).or_else(|| attributes.get_key_value(short))
    {
        return Some(name);
    }
    let by_mean = tolerance.rms.is_some() || tolerance.p99.is_some();
    let known = match part.class {
        Class::Position => tolerance.max.is_some() || by_mean,
        Class::Normal => tolerance.normals.is_some() || tolerance.max.is_some() || by_mean,
        Class::Number => tolerance.max.is_some() && part.width == 1 && attributes.is_empty(),
        Class::Level => {
            tolerance.level > 0.0 || tolerance.differing > 0.0 || tolerance.hard.is_some()
        }
        Class::Exact => tolerance.differing > 0.0,
    };
    let name = match part.class {
        Class::Position | Class::Number => "max",
        Class::Normal => "normals",
        Class::Level => "level",
        Class::Exact => "differing",
    };
    known.then_some(name)
}

/// Returns the reference size of a column, of which relative limits are fractions: the diagonal of the column's bounding box.
pub(crate) fn size(part: &GoldenColumn) -> f64 {
    // For positions the diagonal does not depend on the distance from the origin. Other numbers may all be equal, so that the diagonal is
    // 0; then the size is a thousandth of the largest number.
    if part.class == Class::Position {
        return part.diagonal();
    }
    let finite = part.numbers.iter().filter(|x| x.is_finite());
    let largest = finite.fold(0.0, |m, x| f64::max(m, x.abs()));
    part.diagonal().max(largest * 1e-3)
}

/// The rounding error with which a golden stores a column.
#[derive(Clone, Copy)]
pub(crate) struct Rounding {
    /// The maximum error of a single number.
    pub(crate) max_number_error: f64,
    /// The maximum error of an element (such as a point), in the unit of differences.
    pub(crate) error: f64,
}

impl Rounding {
    /// No rounding error: the column is stored exactly.
    pub(crate) const NONE: Self = Self { max_number_error: 0.0, error: 0.0 };
}

/// Compares the entries of `old` with those of `new`, which must have the same count. `old` may contain only every n-th entry. Differences
/// that may come from rounding alone do not count.
pub(crate) fn compare_columns(
    old: &GoldenColumn,
    new: &GoldenColumn,
    row: Option<usize>,
    tolerance: &Tolerance,
    rounding: Rounding,
) -> Measure {
    let (stride, places) = (old.stride, old.numbers.len() / old.width);
    let (mut measure, differences) = measure_with_relative(
        &old.name,
        |relative: f64| {
            (0..places)
                .into_par_iter()
                .with_min_len(4096)
                .map(|place: usize| {
                    let (a, b) = (old.element(place), new.element(place * stride));
                    let half = rounding.max_number_error * (1.0 + 1e-9);
                    if half > 0.0 && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= half) {
                        return 0.0;
                    }
                    difference(old.class, a, b, relative)
                })
                .collect()
        },
        old.class,
        allowed_difference(new, tolerance),
        tolerance,
    );
    measure.error = rounding.error;
    measure.compared_fraction = places as f64 / new.count.max(1) as f64;
    if let Some(worst) = worst(&differences) {
        let (a, b) = (in_words(old.element(worst)), in_words(new.element(worst * stride)));
        measure.worst = format!("{}: {a} -> {b}", element(worst * stride, row));
        if stride > 1 {
            measure.worst += &format!(" (of every {stride}. entry)");
        }
    }
    judge(&mut measure, old.class, tolerance);
    measure
}

/// Returns the measure of a column, and all differences. `beyond` computes the differences that exceed a given relative limit. Only
/// differences beyond the relative limit of the tolerance count.
pub(super) fn measure_with_relative(
    name: &str,
    beyond: impl Fn(f64) -> Vec<f64>,
    class: Class,
    allowed: f64,
    tolerance: &Tolerance,
) -> (Measure, Vec<f64>) {
    let differences = beyond(0.0);
    let mut all = measure(name, &differences, class, allowed);
    if tolerance.relative > 0.0 && matches!(class, Class::Level | Class::Number) {
        let counted = measure(name, &beyond(tolerance.relative), class, allowed);
        (all.counted_max, all.differing) = (counted.max, counted.differing);
    }
    (all, differences)
}

/// Returns statistics of the differences in the column `name`, such as the maximum, means, and the fraction of elements that differ.
pub(crate) fn measure(name: &str, differences: &[f64], class: Class, allowed: f64) -> Measure {
    const CHUNK: usize = 1 << 14;
    let by_share = matches!(class, Class::Level | Class::Exact);
    // For colors and whole numbers, differences up to the allowed one do not count.
    let least = if by_share { allowed } else { 0.0 };
    let sums = differences.par_chunks(CHUNK).map(|chunk| {
        let sum: f64 = chunk.iter().map(|d| d * d).sum();
        let max = chunk.iter().copied().fold(0.0, f64::max);
        (sum, max, chunk.iter().filter(|&&d| d > least).count())
    });
    let sums: Vec<_> = sums.collect();
    let (sum, max, differing) = sums.iter().fold((0.0, 0.0, 0), |total, part| {
        (total.0 + part.0, f64::max(total.1, part.1), total.2 + part.2)
    });
    let count = differences.len().max(1) as f64;
    let p99 = if max > 0.0 { percentile(differences) } else { 0.0 };
    Measure {
        name: name.to_owned(),
        max,
        counted_max: max,
        rms: (sum / count).sqrt(),
        p99,
        differing: differing as f64 / count,
        unit: unit(class),
        worst: String::new(),
        allowed,
        error: 0.0,
        compared_fraction: 1.0,
        is_by_fraction: by_share,
        failure: String::new(),
    }
}

fn percentile(differences: &[f64]) -> f64 {
    let mut sorted = differences.to_vec();
    let place = (sorted.len() * 99).div_ceil(100).clamp(1, sorted.len()) - 1;
    *sorted.select_nth_unstable_by(place, f64::total_cmp).1
}

/// Records in a measure which limit is exceeded, if any. If the old value was rounded when it was stored, the measure passes only if every
/// value that is rounded to the stored one would pass.
pub(crate) fn judge(measure: &mut Measure, class: Class, tolerance: &Tolerance) {
    /// The maximum rounding error of a stored value, as a fraction of the limit.
    const MAX_ERROR_FRACTION: f64 = 0.1;
    let (name, unit, error) = (&measure.name, measure.unit, measure.error);
    let by_share = measure.is_by_fraction;
    let limits = [
        ("", measure.counted_max, Some(measure.allowed).filter(|_| !by_share)),
        (" (rms)", measure.rms, tolerance.rms.filter(|_| class == Class::Position)),
        (" (99 %)", measure.p99, tolerance.p99.filter(|_| class == Class::Position)),
    ];
    for (what, found, limit) in limits {
        let Some(limit) = limit.filter(|_| measure.failure.is_empty()) else { continue };
        // A NaN fails, because this comparison is false for it.
        if found + error <= limit {
            continue;
        }
        let allowed = in_unit(limit, unit);
        let known = in_unit(error, unit);
        measure.failure = if !found.is_finite() {
            format!("`{name}` differs by a value that is not a number, allowed is {allowed}")
        } else if found - error > limit {
            format!("`{name}` differs by {}{what}, allowed is {allowed}", in_unit(found, unit))
        } else if error <= MAX_ERROR_FRACTION * limit {
            format!(
                "`{name}` differs by {}{what}, with an uncertainty of {known}, allowed is {allowed}",
                in_unit(found, unit)
            )
        } else {
            format!(
                "`{name}` was stored with a precision of {known}, too coarse to check {allowed}{what}: bless it again if it is unchanged"
            )
        };
    }
    if let Some(hard) = tolerance.hard.filter(|_| class == Class::Level)
        && (measure.max > hard || measure.max.is_nan())
    {
        let (found, allowed) = (six_digits(measure.max), six_digits(hard));
        measure.failure =
            format!("`{name}` differs by {found} levels, allowed is {allowed} (hard)");
    } else if by_share
        && measure.counted_max > measure.allowed
        && measure.differing > tolerance.differing
    {
        measure.failure = format!(
            "`{name}`: {} % of the entries differ, allowed are {} %",
            six_digits(100.0 * measure.differing),
            six_digits(100.0 * tolerance.differing)
        );
    }
    if !measure.failure.is_empty() && !measure.worst.is_empty() {
        measure.failure = format!("{}; worst at {}", measure.failure, measure.worst);
    }
}

/// Returns the index of the largest difference, or `None` if all are 0.
pub(super) fn worst(differences: &[f64]) -> Option<usize> {
    let worst =
        (0..differences.len()).max_by(|&a, &b| differences[a].total_cmp(&differences[b]))?;
    (differences[worst] > 0.0).then_some(worst)
}

fn element(index: usize, row: Option<usize>) -> String {
    match row {
        Some(row) if row > 0 => format!("column {}, row {}", index % row, index / row),
        _ => format!("entry {index}"),
    }
}

pub(super) fn in_words(numbers: &[f64]) -> String {
    match numbers {
        [x] => six_digits(*x),
        _ => {
            format!(
                "({})",
                numbers.iter().take(4).map(|x| six_digits(*x)).collect::<Vec<_>>().join(", ")
            )
        }
    }
}

/// Returns the difference between two elements. It is 0 if each pair of numbers differs by at most `relative` times the mean of the two.
/// Two NaNs do not differ. A NaN and a number differ infinitely.
pub(super) fn difference(class: Class, a: &[f64], b: &[f64], relative: f64) -> f64 {
    let mut pairs = a.iter().zip(b);
    if relative > 0.0
        && pairs.clone().all(|(a, b)| (a - b).abs() <= relative * (a.abs() + b.abs()) / 2.0)
    {
        return 0.0;
    }
    match class {
        Class::Position | Class::Number => distance(a, b),
        Class::Level => pairs.map(component_difference).fold(0.0, f64::max),
        Class::Exact => f64::from(u8::from(pairs.any(|pair| component_difference(pair) > 0.0))),
        Class::Normal => {
            fn length(a: &[f64]) -> f64 {
                a.iter().map(|x| x * x).sum::<f64>().sqrt()
            }
            let (shorter, longer) = (length(a).min(length(b)), length(a).max(length(b)));
            if a == b {
                0.0
            } else if shorter > 0.0 {
                // Compute the angle from the chord, because the arc cosine cannot resolve angles below a millionth of a degree. Unequal
                // lengths make the chord longer.
                let half = distance(a, b) / longer / 2.0;
                (2.0 * libm::asin(half.min(1.0))).to_degrees()
            } else {
                180.0
            }
        }
    }
}

/// Returns the length of the difference vector of two elements.
fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(component_difference).map(|d| d * d).sum::<f64>().sqrt()
}

fn component_difference((a, b): (&f64, &f64)) -> f64 {
    match (a.is_nan(), b.is_nan()) {
        (true, true) => 0.0,
        (true, false) | (false, true) => f64::INFINITY,
        // Two equal infinite numbers do not differ, although their difference would be NaN.
        _ if a == b => 0.0,
        _ => (a - b).abs(),
    }
}
