//! Two values compared by what they mean: how different they are, how much of it is allowed, and where it is worst.

use std::collections::BTreeMap;

use maquette_engine::six;
use maquette_value::{AnyValue, Mesh};
use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::json;

use super::parts::{Class, GoldenColumn, GoldenParts};

mod columns;
mod mesh;
mod order;

pub(crate) use columns::{Rounding, allowed, compare_columns, given, limit_of, measure, size};
pub(crate) use mesh::compare_meshes;
pub(crate) use order::without_order;

/// How alike two values are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// The same to the last bit.
    Identical,
    /// The same but for the order of vertices, faces or points.
    Reordered,
    /// All differences are within the tolerance.
    Within,
    /// Something is not.
    Different,
}

impl Verdict {
    /// The word in reports.
    pub fn word(self) -> &'static str {
        match self {
            Self::Identical => "identical",
            Self::Reordered => "same but reordered",
            Self::Within => "within tolerance",
            Self::Different => "different",
        }
    }
}

/// How much two values may differ. What is left out has a default: places a billionth of the diagonal of the box around them,
/// numbers likewise of their range, everything else nothing. The same program gives the same bits.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Tolerance {
    /// The largest distance of any place (mm), the largest difference of any number.
    #[schemars(range(min = 0.0))]
    pub max: Option<f64>,
    /// The root of the mean square of all distances.
    #[schemars(range(min = 0.0))]
    pub rms: Option<f64>,
    /// What 99 % of all distances stay below.
    #[schemars(range(min = 0.0))]
    pub p99: Option<f64>,
    /// The largest angle between normals, in degrees.
    #[schemars(range(min = 0.0, max = 180.0))]
    pub normals: Option<f64>,
    /// The largest difference of attributes, by name.
    pub attributes: BTreeMap<String, f64>,
    /// The share of pixels, or of other entries that are equal or not, that may differ.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub differing: f64,
    /// By how much a channel of a color may differ without counting: 0 to 255.
    #[schemars(range(min = 0.0, max = 255.0))]
    pub level: f64,
    /// The largest difference of any channel of a color, 0 to 255, however few pixels differ.
    #[schemars(range(min = 0.0, max = 255.0))]
    pub hard: Option<f64>,
    /// Differences of colors and numbers up to this fraction of the mean of both do not count.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub relative: f64,
    /// Lets a mesh be of other faces, as long as its surface is near.
    pub remeshed: bool,
    /// How much of the value a golden keeps.
    pub keep: Keep,
    /// The share of the diagonal, or of the range, that is allowed where nothing is said. Files whose numbers are `float` need
    /// a millionth.
    #[serde(skip)]
    pub share: Option<f64>,
}

/// How much of a value a golden keeps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub enum Keep {
    /// Every entry, so that every entry is judged.
    #[default]
    Whole,
    /// Some entries of what is too large to be kept whole: the others are judged by sums over all of them alone, and not at all
    /// where a tolerance is given.
    Sampled {
        /// One of so many entries of a list; of a picture one pixel of so many, in one row of so many.
        #[schemars(range(min = 2))]
        every: usize,
    },
}

impl Keep {
    /// One of so many entries is kept.
    pub(crate) fn stride(self) -> usize {
        match self {
            Self::Whole => 1,
            Self::Sampled { every } => every.max(1),
        }
    }
}

impl Tolerance {
    /// Why these bounds cannot work together, and what helps.
    pub fn contradiction(&self) -> Option<(String, &'static str)> {
        let hard = self.hard.filter(|hard| *hard < self.level)?;
        let (hard, level) = (six(hard), six(self.level));
        let message = format!("expected `hard` to be at least `level`, {level}, found {hard}");
        Some((message, "raise `hard`, or lower `level`"))
    }

    /// The largest differences that are said, by the name of what they are of.
    pub(crate) fn limits(&self) -> impl Iterator<Item = (&str, f64)> {
        let fields = [("max", self.max), ("normals", self.normals)].into_iter();
        let fields = fields.filter_map(|(name, most)| Some((name, most?)));
        fields.chain(self.attributes.iter().map(|(name, most)| (&name[..], *most)))
    }
}

/// How a column, or a surface, differs.
#[derive(Clone, Debug, PartialEq)]
pub struct Measure {
    /// What was compared.
    pub name: String,
    /// The largest difference.
    pub max: f64,
    /// The root of the mean square.
    pub rms: f64,
    /// What 99 % stay below.
    pub p99: f64,
    /// The largest difference that counts: all but those that `relative` allows.
    pub counted: f64,
    /// The share of elements that differ.
    pub differing: f64,
    /// `mm`, `degrees` or nothing.
    pub unit: &'static str,
    /// Where the largest difference is; empty if there is none.
    pub worst: String,
    /// What was allowed: the largest difference, if one was.
    pub allowed: f64,
    /// How much more or less each difference may be, because the old one was kept rounded.
    pub error: f64,
    /// The share of the elements that were compared.
    pub seen: f64,
    /// Whether its elements are equal or not, and their share is what counts.
    pub by_share: bool,
    /// What is not allowed, in words; empty if all is well.
    pub broken: String,
}

impl Measure {
    /// Which measures tell most: distances, then angles, then numbers, then how many entries are others.
    fn rank(&self) -> usize {
        match self.unit {
            "mm" => 0,
            "degrees" => 1,
            "" if self.by_share => 3,
            _ => 2,
        }
    }

    /// How much it differs, in words.
    pub fn in_words(&self) -> String {
        match self.by_share {
            true => format!("{} % of `{}` differ", six(100.0 * self.differing), self.name),
            false => format!("`{}` differs by {}", self.name, in_unit(self.max, self.unit)),
        }
    }
}

/// What a comparison found.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// How alike the values are.
    pub verdict: Verdict,
    /// Why they are different: counts and kinds that are not equal, and whatever exceeds its tolerance.
    pub reasons: Vec<String>,
    /// What was measured.
    pub measures: Vec<Measure>,
}

impl Comparison {
    pub(crate) fn alike(verdict: Verdict) -> Self {
        Self { verdict, reasons: Vec::new(), measures: Vec::new() }
    }

    /// The comparison of these facts and measures. Distances come first, the longest before all, then other differences, then
    /// the facts.
    pub(crate) fn new(facts: Vec<String>, measures: Vec<Measure>) -> Self {
        let mut broken: Vec<&Measure> = measures.iter().filter(|m| !m.broken.is_empty()).collect();
        broken.sort_by(|a, b| a.rank().cmp(&b.rank()).then(b.max.total_cmp(&a.max)));
        let mut reasons: Vec<String> = Vec::new();
        for reason in broken.iter().map(|m| &m.broken).chain(&facts) {
            if !reasons.contains(reason) {
                reasons.push(reason.clone());
            }
        }
        let verdict = if reasons.is_empty() { Verdict::Within } else { Verdict::Different };
        Self { verdict, reasons, measures }
    }

    /// The largest distance, or what differs most if nothing is one; none if nothing was measured to differ.
    pub fn worst(&self) -> Option<&Measure> {
        let differing = self.measures.iter().filter(|m| m.max > 0.0);
        differing.min_by(|a, b| a.rank().cmp(&b.rank()).then(b.max.total_cmp(&a.max)))
    }

    /// The share of the elements that were compared.
    pub fn seen(&self) -> f64 {
        self.measures.iter().map(|m| m.seen).fold(1.0, f64::min)
    }

    /// The comparison as `--json` prints it.
    pub fn to_json(&self) -> serde_json::Value {
        let measures = self.measures.iter().map(|m| {
            json!({
                "name": m.name, "max": m.max, "rms": m.rms, "p99": m.p99, "differing": m.differing,
                "unit": m.unit, "worst": m.worst, "allowed": m.allowed, "error": m.error, "seen": m.seen,
                "passed": m.broken.is_empty(),
            })
        });
        json!({
            "verdict": self.verdict.word(),
            "reasons": self.reasons,
            "measures": measures.collect::<Vec<_>>(),
        })
    }
}

/// Compares two values of any types. Topology and counts come first; what is not the same there is still measured, if it can be.
pub fn compare(old: &AnyValue, new: &AnyValue, tolerance: &Tolerance) -> Comparison {
    if old.kind() != new.kind() {
        let reason = format!("a {} became a {}", old.kind().name, new.kind().name);
        return Comparison::new(vec![reason], Vec::new());
    }
    if old.hash() == new.hash() {
        return Comparison::alike(Verdict::Identical);
    }
    if let (Some(old), Some(new)) = (old.get::<Mesh>(), new.get::<Mesh>()) {
        return compare_meshes(old, new, tolerance, &|_| 0.0);
    }
    fn order(value: &AnyValue) -> Option<u128> {
        without_order(value)
    }
    if let (Some(a), Some(b)) = (order(old), order(new))
        && a == b
    {
        return Comparison::alike(Verdict::Reordered);
    }
    match (GoldenParts::of(old), GoldenParts::of(new)) {
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
    let names = |parts: &GoldenParts| {
        parts.columns.iter().map(|part| part.name.clone()).collect::<Vec<_>>()
    };
    let (before, now) = (names(old), names(new));
    reasons.extend(before.iter().filter(|n| !now.contains(n)).map(|n| format!("`{n}` is gone")));
    reasons.extend(now.iter().filter(|n| !before.contains(n)).map(|n| format!("`{n}` is new")));
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

/// Facts that are not the same, in words.
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

/// Values of a type that only its pack knows: by what they tell of themselves.
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
        reasons.push("the content changed, but nothing that its summary tells".into());
    }
    Comparison::new(reasons, Vec::new())
}

/// The class's word for what a difference is measured in.
pub(crate) fn unit(class: Class) -> &'static str {
    match class {
        Class::Place => "mm",
        Class::Normal => "degrees",
        Class::Number | Class::Level | Class::Exact => "",
    }
}

/// A measured number with its unit.
pub fn in_unit(x: f64, unit: &str) -> String {
    if unit.is_empty() { six(x) } else { format!("{} {unit}", six(x)) }
}

#[cfg(test)]
mod tests;
