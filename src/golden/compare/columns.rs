//! Two columns, element by element.

use rayon::prelude::*;

use super::{Measure, Tolerance, six, unit};
use crate::golden::parts::{Class, Part};

/// What is allowed where nothing is said, as a share of the diagonal of all places or numbers: ten times what is lost when a
/// golden is kept, and far below what can be seen.
const DEFAULT_SHARE: f64 = 2e-5;

/// The angle between normals that is allowed where nothing is said, in degrees.
const DEFAULT_ANGLE: f64 = 0.5;

/// The largest difference that is allowed in a column.
pub(crate) fn allowed(part: &Part, tolerance: &Tolerance) -> f64 {
    // `corner uv` and `face area` are meant by `uv` and `area`, too.
    let short = part.name.rsplit(' ').next().unwrap_or_default();
    let named = tolerance.attributes.get(&part.name).or_else(|| tolerance.attributes.get(short));
    match (part.class, named) {
        (_, Some(&named)) => named,
        (Class::Place, None) => tolerance.max.unwrap_or_else(|| DEFAULT_SHARE * part.diagonal()),
        (Class::Normal, None) => tolerance.normals.unwrap_or(DEFAULT_ANGLE),
        (Class::Number, None) => {
            let known =
                tolerance.max.filter(|_| part.width == 1 && tolerance.attributes.is_empty());
            // A column of equal numbers has no range: then they themselves say what is small.
            let size = part
                .numbers
                .iter()
                .filter(|x| x.is_finite())
                .fold(0.0, |m, x| f64::max(m, x.abs()));
            known.unwrap_or_else(|| DEFAULT_SHARE * part.diagonal().max(size * 1e-3))
        }
        (Class::Level, None) => tolerance.level,
        (Class::Exact, None) => 0.0,
    }
}

/// Compares the entries of `old` with those of `new`, of which there are as many; either may hold every n-th only.
pub(crate) fn compare_columns(
    old: &Part,
    new: &Part,
    row: Option<usize>,
    tolerance: &Tolerance,
) -> Measure {
    let stride = old.stride.max(new.stride);
    let places = old.count.div_ceil(stride);
    let pair = |k: usize| {
        let index = k * stride;
        (old.element(index / old.stride), new.element(index / new.stride))
    };
    let of = |k: usize| {
        let (a, b) = pair(k);
        difference(old.class, a, b)
    };
    let differences: Vec<f64> = (0..places).into_par_iter().with_min_len(4096).map(of).collect();
    let allowed = allowed(old, tolerance);
    let mut measure = measure(&old.name, &differences, unit(old.class), allowed);
    if let Some(worst) = worst(&differences) {
        let (a, b) = pair(worst);
        measure.worst =
            format!("{}: {} -> {}", element(worst * stride, row), in_words(a), in_words(b));
    }
    judge(&mut measure, old.class, tolerance);
    measure
}

/// Statistics of some differences.
pub(super) fn measure(
    name: &str,
    differences: &[f64],
    unit: &'static str,
    allowed: f64,
) -> Measure {
    const CHUNK: usize = 1 << 14;
    let sums = differences.par_chunks(CHUNK).map(|chunk| {
        let sum: f64 = chunk.iter().map(|d| d * d).sum();
        let max = chunk.iter().copied().fold(0.0, f64::max);
        (
            sum,
            max,
            chunk.iter().filter(|&&d| d > allowed).count(),
            chunk.iter().filter(|&&d| d > 0.0).count(),
        )
    });
    let sums: Vec<_> = sums.collect();
    let (sum, max, _, differing) = sums.iter().fold((0.0, 0.0, 0, 0), |total, part| {
        (total.0 + part.0, f64::max(total.1, part.1), total.2 + part.2, total.3 + part.3)
    });
    let count = differences.len().max(1) as f64;
    let p99 = if max > 0.0 { percentile(differences) } else { 0.0 };
    Measure {
        name: name.to_owned(),
        max,
        rms: (sum / count).sqrt(),
        p99,
        differing: differing as f64 / count,
        unit,
        worst: String::new(),
        allowed,
        broken: String::new(),
    }
}

fn percentile(differences: &[f64]) -> f64 {
    let mut sorted = differences.to_vec();
    let place = (sorted.len() * 99).div_ceil(100).clamp(1, sorted.len()) - 1;
    *sorted.select_nth_unstable_by(place, f64::total_cmp).1
}

/// Says what of a measure is not allowed.
pub(super) fn judge(measure: &mut Measure, class: Class, tolerance: &Tolerance) {
    let (name, unit) = (&measure.name, if measure.unit.is_empty() { "" } else { " " });
    let unit = format!("{unit}{}", measure.unit);
    let by_share = matches!(class, Class::Level | Class::Exact);
    let limits = [
        ("", measure.max, Some(measure.allowed).filter(|_| !by_share)),
        (" (rms)", measure.rms, tolerance.rms.filter(|_| class == Class::Place)),
        (" (99 %)", measure.p99, tolerance.p99.filter(|_| class == Class::Place)),
    ];
    for (what, found, limit) in limits {
        // What is not a number is not allowed either.
        if limit.is_some_and(|limit| limit < found || found.is_nan()) && measure.broken.is_empty() {
            let limit = six(limit.unwrap_or_default());
            let found = if found.is_finite() {
                six(found)
            } else {
                "something that is not a number".into()
            };
            measure.broken =
                format!("`{name}` differs by {found}{unit}{what}, allowed is {limit}{unit}");
        }
    }
    if by_share && measure.max > measure.allowed && measure.differing > tolerance.differing {
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
        _ => format!("({})", Vec::from_iter(numbers.iter().take(4).map(|x| six(*x))).join(", ")),
    }
}

/// How far two elements are apart. Two numbers that are both unknown do not differ; one that is makes them infinitely different.
pub(super) fn difference(class: Class, a: &[f64], b: &[f64]) -> f64 {
    let apart = |(a, b): (&f64, &f64)| match (a.is_nan(), b.is_nan()) {
        (true, true) => 0.0,
        (true, false) | (false, true) => f64::INFINITY,
        // Infinite numbers that are equal do not differ.
        _ if a == b => 0.0,
        _ => (a - b).abs(),
    };
    let pairs = || a.iter().zip(b);
    match class {
        Class::Place | Class::Number => pairs().map(apart).map(|d| d * d).sum::<f64>().sqrt(),
        Class::Level | Class::Exact => pairs().map(apart).fold(0.0, f64::max),
        Class::Normal => {
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let lengths = (dot(a, a) * dot(b, b)).sqrt();
            if a == b {
                0.0
            } else if lengths > 0.0 {
                libm::acos((dot(a, b) / lengths).clamp(-1.0, 1.0)).to_degrees()
            } else {
                180.0
            }
        }
    }
}
