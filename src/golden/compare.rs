//! Compares two values by their content. Determines how large the differences are, where the largest one is, and if all are within the
//! tolerance.

use std::collections::BTreeMap;

use maquette_engine::six_digits;
use maquette_value::{AnyValue, Mesh};
use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::json;

use super::parts::{Class, GoldenColumn, GoldenParts};

mod columns;
mod mesh;
mod order;

pub(crate) use columns::{
    Rounding, allowed_difference, compare_columns, explicit_limit, limit_of, measure, size,
};
pub(crate) use mesh::compare_meshes;
pub(crate) use order::unordered_hash;

/// The verdict of a comparison, ordered from equal to different.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// Both values are equal to the last bit.
    Identical,
    /// Equal except for the order of vertices, faces or points.
    Reordered,
    /// All differences are within the tolerance.
    Within,
    /// Some difference exceeds the tolerance.
    Different,
}

impl Verdict {
    /// Returns the word for the verdict in reports.
    pub fn word(self) -> &'static str {
        match self {
            Self::Identical => "identical",
            Self::Reordered => "same but reordered",
            Self::Within => "within tolerance",
            Self::Different => "different",
        }
    }
}

/// Limits of the differences between two values. Defaults: for positions a billionth of the diagonal of their bounding box, for numbers a
/// billionth of their range, for everything else no difference. Such small limits suffice, because the same program computes the same bits.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Tolerance {
    /// Largest allowed distance of a position from the golden position, in mm, or largest allowed difference of another number.
    #[schemars(range(min = 0.0))]
    pub max: Option<f64>,
    /// Largest allowed root mean square of all distances, in mm.
    #[schemars(range(min = 0.0))]
    pub rms: Option<f64>,
    /// Largest allowed 99th percentile of all distances, in mm.
    #[schemars(range(min = 0.0))]
    pub p99: Option<f64>,
    /// Largest allowed angle between a normal and the golden normal, in degrees.
    #[schemars(range(min = 0.0, max = 180.0))]
    pub normals: Option<f64>,
    /// Largest allowed difference of each attribute, by name.
    pub attributes: BTreeMap<String, f64>,
    /// Fraction of pixels, or of other entries that are equal or not, that may differ.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub differing: f64,
    /// Differences of a color channel up to this value are ignored: 0 to 255.
    #[schemars(range(min = 0.0, max = 255.0))]
    pub level: f64,
    /// Largest allowed difference of any color channel, 0 to 255, however few pixels differ.
    #[schemars(range(min = 0.0, max = 255.0))]
    pub hard: Option<f64>,
    /// Differences of two colors or numbers are ignored up to this fraction of the mean of both.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub relative: f64,
    /// Accepts a mesh with other faces if its surface is near the golden surface.
    pub remeshed: bool,
    /// Part of the value that a golden stores.
    pub keep: Keep,
    /// The default limit, as a fraction of the diagonal of all positions or of the range of all numbers. Files whose numbers are `float`
    /// need a millionth. If `None`, the limit is a billionth.
    #[serde(skip)]
    pub default_fraction: Option<f64>,
}

/// Part of a value that a golden stores.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub enum Keep {
    /// Every entry, so that every entry is compared.
    #[default]
    Whole,
    /// Some entries of a value that is too large to be stored whole. All other entries are compared only by sums over the whole value.
    /// Where a tolerance is given, they are not compared at all.
    Sampled {
        /// Every n-th entry of a list; of a picture every n-th pixel in every n-th row.
        #[schemars(range(min = 2))]
        every: usize,
    },
}

impl Keep {
    /// Returns the step between two stored entries. It is 1 if every entry is stored.
    pub(crate) fn stride(self) -> usize {
        match self {
            Self::Whole => 1,
            Self::Sampled { every } => every.max(1),
        }
    }
}

impl Tolerance {
    /// Returns an error message and a help text if two limits of the tolerance contradict each other.
    pub fn contradiction(&self) -> Option<(String, &'static str)> {
        let hard = self.hard.filter(|hard| *hard < self.level)?;
        let (hard, level) = (six_digits(hard), six_digits(self.level));
        let message = format!("expected `hard` to be at least `level`, {level}, found {hard}");
        Some((message, "raise `hard`, or lower `level`"))
    }

    /// Returns the limits that are set in the tolerance, each with its name.
    pub(crate) fn limits(&self) -> impl Iterator<Item = (&str, f64)> {
        let fields = [("max", self.max), ("normals", self.normals)].into_iter();
        let fields = fields.filter_map(|(name, limit)| Some((name, limit?)));
        fields.chain(self.attributes.iter().map(|(name, limit)| (&name[..], *limit)))
    }
}

/// The measured differences between the old and the new version of a column or surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Measure {
    /// The name of the compared column or surface.
    pub name: String,
    /// The largest measured difference, in the unit `unit`.
    pub max: f64,
    /// The root mean square of all measured differences, in the unit `unit`.
    pub rms: f64,
    /// The 99th percentile of all measured differences, in the unit `unit`.
    pub p99: f64,
    /// The largest measured difference that counts. Differences that the relative limit of the tolerance allows do not count.
    pub counted_max: f64,
    /// The measured fraction of elements that differ, from 0 to 1.
    pub differing: f64,
    /// The unit of the differences: `mm`, `degrees`, or empty.
    pub unit: &'static str,
    /// The position of the largest difference, in words. Empty if there is no difference.
    pub worst: String,
    /// The largest allowed difference, in the unit `unit`.
    pub allowed: f64,
    /// The uncertainty of each difference, in the unit `unit`. It is 0 unless the old value was rounded when it was stored.
    pub error: f64,
    /// The fraction of elements that were compared, from 0 to 1.
    pub compared_fraction: f64,
    /// True if elements are only equal or different, so the fraction of different elements is compared with the limit.
    pub is_by_fraction: bool,
    /// A description of the limit that is exceeded; empty if none is.
    pub failure: String,
}

impl Measure {
    /// Returns the rank of the measure in reports: first distances, then angles, then numbers, then fractions of different elements.
    fn rank(&self) -> usize {
        match self.unit {
            "mm" => 0,
            "degrees" => 1,
            "" if self.is_by_fraction => 3,
            _ => 2,
        }
    }

    /// Describes the measured difference in words: the largest difference or, for columns that are compared by fraction, the fraction that
    /// differs.
    pub fn in_words(&self) -> String {
        match self.is_by_fraction {
            true => format!("{} % of `{}` differ", six_digits(100.0 * self.differing), self.name),
            false => format!("`{}` differs by {}", self.name, in_unit(self.max, self.unit)),
        }
    }
}

/// The result of comparing two values.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// The result: the values are equal, close enough, or different.
    pub verdict: Verdict,
    /// The reasons for the verdict `Different`: counts or kinds that differ, and limits that are exceeded.
    pub reasons: Vec<String>,
    /// The measured differences.
    pub measures: Vec<Measure>,
}

impl Comparison {
    pub(crate) fn from_verdict(verdict: Verdict) -> Self {
        Self { verdict, reasons: Vec::new(), measures: Vec::new() }
    }

    /// Creates a comparison from descriptions of facts that differ and from the measured differences. The reasons are sorted: first
    /// distances, the largest first; then other differences; then facts.
    pub(crate) fn new(facts: Vec<String>, measures: Vec<Measure>) -> Self {
        let mut broken: Vec<&Measure> = measures.iter().filter(|m| !m.failure.is_empty()).collect();
        broken.sort_by(|a, b| a.rank().cmp(&b.rank()).then(b.max.total_cmp(&a.max)));
        let mut reasons: Vec<String> = Vec::new();
        for reason in broken.iter().map(|m| &m.failure).chain(&facts) {
            if !reasons.contains(reason) {
                reasons.push(reason.clone());
            }
        }
        let verdict = if reasons.is_empty() { Verdict::Within } else { Verdict::Different };
        Self { verdict, reasons, measures }
    }

    /// Returns the measure with the largest distance. If no distances were measured, returns the measure with the largest difference.
    /// Returns `None` if nothing differs.
    pub fn worst(&self) -> Option<&Measure> {
        let differing = self.measures.iter().filter(|m| m.max > 0.0);
        differing.min_by(|a, b| a.rank().cmp(&b.rank()).then(b.max.total_cmp(&a.max)))
    }

    /// Returns the smallest fraction of elements that was compared in any column.
    pub fn compared_fraction(&self) -> f64 {
        self.measures.iter().map(|m| m.compared_fraction).fold(1.0, f64::min)
    }

    /// Returns the comparison as JSON, in the form that the option `--json` prints.
    pub fn to_json(&self) -> serde_json::Value {
        let measures = self.measures.iter().map(|m| {
            json!({
                "name": m.name, "max": m.max, "rms": m.rms, "p99": m.p99, "differing": m.differing,
                "unit": m.unit, "worst": m.worst, "allowed": m.allowed, "error": m.error, "seen": m.compared_fraction,
                "passed": m.failure.is_empty(),
            })
        });
        json!({
            "verdict": self.verdict.word(),
            "reasons": self.reasons,
            "measures": measures.collect::<Vec<_>>(),
        })
    }
}

/// Compares two values of any type. Topology and counts are compared first. Differences are also measured, even if counts differ, where
/// that is possible.
pub fn compare(old: &AnyValue, new: &AnyValue, tolerance: &Tolerance) -> Comparison {
    if old.kind() != new.kind() {
        let reason = format!("a {} became a {}", old.kind().name, new.kind().name);
        return Comparison::new(vec![reason], Vec::new());
    }
    if old.hash() == new.hash() {
        return Comparison::from_verdict(Verdict::Identical);
    }
    if let (Some(old), Some(new)) = (old.get::<Mesh>(), new.get::<Mesh>()) {
        return compare_meshes(old, new, tolerance, &|_| 0.0);
    }
    fn order(value: &AnyValue) -> Option<u128> {
        unordered_hash(value)
    }
    if let (Some(a), Some(b)) = (order(old), order(new))
        && a == b
    {
        return Comparison::from_verdict(Verdict::Reordered);
    }
    match (GoldenParts::from_value(old), GoldenParts::from_value(new)) {
        (Some(old), Some(new)) => compare_parts(&old, &new, tolerance),
        _ => compare_summaries(old, new),
    }
}

/// Compares the facts and the columns of two values.
pub(crate) fn compare_parts(
    old: &GoldenParts,
    new: &GoldenParts,
    tolerance: &Tolerance,
) -> Comparison {
    let mut reasons = different_facts(&old.facts, &new.facts);
    let missing = old.columns.iter().filter(|part| new.column(&part.name).is_none());
    reasons.extend(missing.map(|part| format!("`{}` is gone", part.name)));
    let added = new.columns.iter().filter(|part| old.column(&part.name).is_none());
    reasons.extend(added.map(|part| format!("`{}` is new", part.name)));
    let mut measures = Vec::new();
    for part in &old.columns {
        let Some(other) = new.column(&part.name) else { continue };
        if part.count != other.count || part.width != other.width {
            fn length(part: &GoldenColumn) -> String {
                format!("{} x {}", part.count, part.width)
            }
            reasons.push(format!(
                "`{}`: {} entries became {}",
                part.name,
                length(part),
                length(other)
            ));
            continue;
        }
        measures.push(compare_columns(part, other, new.row, tolerance, Rounding::NONE));
    }
    Comparison::new(reasons, measures)
}

/// Describes the facts that differ between an old and a new list. Each fact is a label and a text.
pub(crate) fn different_facts(old: &[(String, String)], new: &[(String, String)]) -> Vec<String> {
    let mut reasons = Vec::new();
    for (name, before) in old {
        match new.iter().find(|(other, _)| other == name) {
            Some((_, now)) if now == before => {}
            Some((_, now)) => reasons.push(format!("{name}: {before} -> {now}")),
            None => reasons.push(format!("{name}: {before} is gone")),
        }
    }
    reasons.extend(
        new.iter()
            .filter(|(name, _)| !old.iter().any(|(other, _)| other == name))
            .map(|(name, now)| format!("{name}: {now} is new")),
    );
    reasons
}

/// Compares two values by their summaries. For value types that cannot be split into columns.
fn compare_summaries(old: &AnyValue, new: &AnyValue) -> Comparison {
    fn facts(value: &AnyValue) -> Vec<(String, String)> {
        value
            .describe()
            .0
            .into_iter()
            .map(|(name, fact)| (name, fact.to_string()))
            .collect::<Vec<_>>()
    }
    let mut reasons = different_facts(&facts(old), &facts(new));
    if reasons.is_empty() {
        reasons.push("the content changed, but not its summary".into());
    }
    Comparison::new(reasons, Vec::new())
}

/// Returns the unit of differences in a column of this class.
pub(crate) fn unit(class: Class) -> &'static str {
    match class {
        Class::Position => "mm",
        Class::Normal => "degrees",
        Class::Number | Class::Level | Class::Exact => "",
    }
}

/// Formats a measured number with its unit.
pub fn in_unit(x: f64, unit: &str) -> String {
    if unit.is_empty() { six_digits(x) } else { format!("{} {unit}", six_digits(x)) }
}

#[cfg(test)]
mod tests;
