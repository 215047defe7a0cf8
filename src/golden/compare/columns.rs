//! Two columns, element by element.

use maquette_engine::six;
use maquette_value::parallel::*;

use super::{Measure, Tolerance, in_unit, unit};
use crate::parts::{Class, GoldenColumn};

/// The default tolerance, as a share of the diagonal of all places or numbers: a billionth. The same program
/// gives the same bits, so only the last digits of sums that are taken in another order are forgiven, some 1e-13; above that
/// a fault hides, below a harmless change of code fails.
const DEFAULT_SHARE: f64 = 1e-9;

/// The angle between normals that is allowed where places may move but nothing is said of normals, in degrees: no eye sees less.
const ANGLE_OF_MOVED: f64 = 0.5;

/// The largest difference that is allowed in a column.
pub(crate) fn allowed(part: &GoldenColumn, tolerance: &Tolerance) -> f64 {
    let share = tolerance.share.unwrap_or(DEFAULT_SHARE);
    given(part, tolerance).unwrap_or_else(|| match part.class {
        Class::Place | Class::Number => share * size(part),
        Class::Normal => share.to_degrees(),
        Class::Level | Class::Exact => 0.0,
    })
}

/// What a tolerance says of a column, if it does.
pub(crate) fn given(part: &GoldenColumn, tolerance: &Tolerance) -> Option<f64> {
    let limit = limit_of(part, tolerance)?;
    let said = tolerance.limits().find(|(name, _)| *name == limit).map(|(_, most)| most);
    said.or(match part.class {
        Class::Exact => Some(0.0),
        Class::Level => Some(tolerance.level),
        Class::Normal => Some(ANGLE_OF_MOVED),
        // A mean alone is said: then any single place may be anywhere.
        Class::Place | Class::Number => Some(f64::INFINITY),
    })
}

/// The name of what a tolerance says of a column, if it does: that of an attribute, or of a field.
pub(crate) fn limit_of<'t>(part: &GoldenColumn, tolerance: &'t Tolerance) -> Option<&'t str> {
    // `corner uv` and `face area` are meant by `uv` and `area`, too.
    let short = part.name.rsplit(' ').next().unwrap_or_default();
    let attributes = &tolerance.attributes;
    if let Some((name, _)) =
        attributes.get_key_value(&part.name).or_else(|| attributes.get_key_value(short))
    {
        return Some(name);
    }
    let by_mean = tolerance.rms.is_some() || tolerance.p99.is_some();
    let known = match part.class {
        Class::Place => tolerance.max.is_some() || by_mean,
        Class::Normal => tolerance.normals.is_some() || tolerance.max.is_some() || by_mean,
        Class::Number => tolerance.max.is_some() && part.width == 1 && attributes.is_empty(),
        Class::Level => {
            tolerance.level > 0.0 || tolerance.differing > 0.0 || tolerance.hard.is_some()
        }
        Class::Exact => tolerance.differing > 0.0,
    };
    let name = match part.class {
        Class::Place | Class::Number => "max",
        Class::Normal => "normals",
        Class::Level => "level",
        Class::Exact => "differing",
    };
    known.then_some(name)
}

/// What the shares of a column are of: the diagonal of the box around all of it.
pub(crate) fn size(part: &GoldenColumn) -> f64 {
    // Places are as far apart as the thing is large, whatever their distance to the origin. A column of equal numbers has no
    // range: then they themselves say what is small.
    let largest =
        || part.numbers.iter().filter(|x| x.is_finite()).fold(0.0, |m, x| f64::max(m, x.abs()));
    match part.class {
        Class::Place => part.diagonal(),
        _ => part.diagonal().max(largest() * 1e-3),
    }
}

/// How far the numbers of an old column may be from what they were.
#[derive(Clone, Copy)]
pub(crate) struct Rounding {
    /// A single number, at most.
    pub(crate) half: f64,
    /// An element, in the unit of differences.
    pub(crate) error: f64,
}

impl Rounding {
    /// They are what they were.
    pub(crate) const NONE: Self = Self { half: 0.0, error: 0.0 };
}

/// Compares the entries of `old` with those of `new`, of which there are as many; the old one may hold every n-th only.
/// Differences that rounding alone may make are none.
pub(crate) fn compare_columns(
    old: &GoldenColumn,
    new: &GoldenColumn,
    row: Option<usize>,
    tolerance: &Tolerance,
    rounding: Rounding,
) -> Measure {
    let (stride, places) = (old.stride, old.numbers.len() / old.width);
    let (mut measure, differences) = measure_beyond(
        &old.name,
        |relative: f64| {
            (0..places)
                .into_par_iter()
                .with_min_len(4096)
                .map(|place: usize| {
                    let (a, b) = (old.element(place), new.element(place * stride));
                    let half = rounding.half * (1.0 + 1e-9);
                    if half > 0.0 && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= half) {
                        return 0.0;
                    }
                    difference(old.class, a, b, relative)
                })
                .collect()
        },
        old.class,
        allowed(new, tolerance),
        tolerance,
    );
    measure.error = rounding.error;
    measure.seen = places as f64 / new.count.max(1) as f64;
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

/// Statistics of the differences that `beyond` gives for a relative bound, and those for the bound 0.
pub(super) fn measure_beyond(
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
        (all.counted, all.differing) = (counted.max, counted.differing);
    }
    (all, differences)
}

/// Statistics of some differences.
pub(crate) fn measure(name: &str, differences: &[f64], class: Class, allowed: f64) -> Measure {
    const CHUNK: usize = 1 << 14;
    let by_share = matches!(class, Class::Level | Class::Exact);
    // What is allowed of a color does not count.
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
        counted: max,
        rms: (sum / count).sqrt(),
        p99,
        differing: differing as f64 / count,
        unit: unit(class),
        worst: String::new(),
        allowed,
        error: 0.0,
        seen: 1.0,
        by_share,
        broken: String::new(),
    }
}

fn percentile(differences: &[f64]) -> f64 {
    let mut sorted = differences.to_vec();
    let place = (sorted.len() * 99).div_ceil(100).clamp(1, sorted.len()) - 1;
    *sorted.select_nth_unstable_by(place, f64::total_cmp).1
}

/// Says what of a measure is not allowed. What was kept rounded passes only if it would, however it was rounded.
pub(crate) fn judge(measure: &mut Measure, class: Class, tolerance: &Tolerance) {
    /// Rounding that decides more than this share of what is allowed is too rough.
    const ROUGH: f64 = 0.1;
    let (name, unit, error) = (&measure.name, measure.unit, measure.error);
    let by_share = measure.by_share;
    let limits = [
        ("", measure.counted, Some(measure.allowed).filter(|_| !by_share)),
        (" (rms)", measure.rms, tolerance.rms.filter(|_| class == Class::Place)),
        (" (99 %)", measure.p99, tolerance.p99.filter(|_| class == Class::Place)),
    ];
    for (what, found, limit) in limits {
        let Some(limit) = limit.filter(|_| measure.broken.is_empty()) else { continue };
        // What is not a number is not allowed either.
        if found + error <= limit {
            continue;
        }
        let allowed = in_unit(limit, unit);
        let known = in_unit(error, unit);
        measure.broken = if !found.is_finite() {
            format!("`{name}` differs by something that is not a number, allowed is {allowed}")
        } else if found - error > limit {
            format!("`{name}` differs by {}{what}, allowed is {allowed}", in_unit(found, unit))
        } else if error <= ROUGH * limit {
            format!(
                "`{name}` differs by {}{what}, known to {known}, allowed is {allowed}",
                in_unit(found, unit)
            )
        } else {
            format!(
                "`{name}` was kept to {known}, too roughly to judge {allowed}{what}: accept it anew where it is as it was"
            )
        };
    }
    if let Some(hard) = tolerance.hard.filter(|_| class == Class::Level)
        && (measure.max > hard || measure.max.is_nan())
    {
        let (found, allowed) = (six(measure.max), six(hard));
        measure.broken = format!("`{name}` differs by {found} levels, allowed is {allowed} (hard)");
    } else if by_share
        && measure.counted > measure.allowed
        && measure.differing > tolerance.differing
    {
        measure.broken = format!(
            "`{name}`: {} % of the entries differ, allowed are {} %",
            six(100.0 * measure.differing),
            six(100.0 * tolerance.differing)
        );
    }
    if !measure.broken.is_empty() && !measure.worst.is_empty() {
        measure.broken = format!("{}; worst at {}", measure.broken, measure.worst);
    }
}

/// The place of the largest difference.
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
        [x] => six(*x),
        _ => {
            format!("({})", numbers.iter().take(4).map(|x| six(*x)).collect::<Vec<_>>().join(", "))
        }
    }
}

/// How far two elements are apart, or 0 if no number of them is farther from the other than `relative` times the mean of both. Two numbers that are both unknown do not differ; one that is makes them infinitely different.
pub(super) fn difference(class: Class, a: &[f64], b: &[f64], relative: f64) -> f64 {
    fn apart((a, b): (&f64, &f64)) -> f64 {
        match (a.is_nan(), b.is_nan()) {
            (true, true) => 0.0,
            (true, false) | (false, true) => f64::INFINITY,
            // Infinite numbers that are equal do not differ.
            _ if a == b => 0.0,
            _ => (a - b).abs(),
        }
    }
    let pairs = || a.iter().zip(b);
    if relative > 0.0
        && pairs().all(|(a, b): (&f64, &f64)| (a - b).abs() <= relative * (a.abs() + b.abs()) / 2.0)
    {
        return 0.0;
    }
    match class {
        Class::Place | Class::Number => pairs().map(apart).map(|d| d * d).sum::<f64>().sqrt(),
        Class::Level => pairs().map(apart).fold(0.0, f64::max),
        Class::Exact => f64::from(u8::from(pairs().map(apart).any(|d| d > 0.0))),
        Class::Normal => {
            fn length(a: &[f64]) -> f64 {
                a.iter().map(|x| x * x).sum::<f64>().sqrt()
            }
            let (shorter, longer) = (length(a).min(length(b)), length(a).max(length(b)));
            if a == b {
                0.0
            } else if shorter > 0.0 {
                // By the chord: the arc cosine knows no angle below a millionth of a degree. Where the lengths are others, it
                // is longer.
                let half = pairs().map(apart).map(|d| d * d).sum::<f64>().sqrt() / longer / 2.0;
                (2.0 * libm::asin(half.min(1.0))).to_degrees()
            } else {
                180.0
            }
        }
    }
}
