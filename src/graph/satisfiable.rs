//! Finds expectations that no value can satisfy, because they contradict themselves or the types of the values.

use std::collections::BTreeSet;

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Body, Help, Kind, LocalDiagnostic, Tree, nearest_or_all, with_article};
use maquette_value::{Meaning, RangeImage, Region, Value as _, ValueType, value_counts};

use crate::Expectation;

/// The reason why no value can satisfy an expectation.
struct Contradiction {
    /// The field that makes the expectation impossible. Empty if the expectation as a whole is impossible.
    field: &'static str,
    code: &'static str,
    message: String,
    help: Help,
}

impl Expectation {
    /// Returns the error for an expectation that no values of the given types can satisfy. A value of unknown type may satisfy any
    /// expectation. `item` is the expectation as the file contains it.
    pub fn find_contradiction(
        &self,
        types: &[Option<&ValueType>],
        item: &Tree,
    ) -> Option<LocalDiagnostic> {
        let found = self.contradiction().or_else(|| self.type_mismatch(types))?;
        Some(LocalDiagnostic::new(
            found.code,
            field_span(item, found.field),
            found.message,
            found.help,
        ))
    }

    /// Finds contradictions within the expectation.
    fn contradiction(&self) -> Option<Contradiction> {
        match self {
            Self::Count { min: None, max: None, .. } => Some(Contradiction {
                field: "",
                code: code::MISSING_FIELD,
                message: "Count needs a field `min` or `max`".into(),
                help: "without a limit, any number is valid".into(),
            }),
            Self::Continuity { order, limit, max, curvature, .. } => {
                let message = match (order, limit, max) {
                    (Some(_), Some(_), None) if curvature.is_none() => return None,
                    (None, None, Some(_)) => return None,
                    (Some(_), Some(_), _) => {
                        "Continuity has `max` or `curvature` beside `order` and `limit`"
                    }
                    _ => "Continuity needs `order` and `limit`, or `max`",
                };
                Some(Contradiction {
                    field: "",
                    code: code::MISSING_FIELD,
                    message: message.into(),
                    help: "write `order: G1, limit: 5`, or `max: 5, curvature: 0.1`".into(),
                })
            }
            Self::Count { min: Some(min), max: Some(max), .. }
            | Self::Attribute { min: Some(min), max: Some(max), .. }
                if max < min =>
            {
                let message = format!("`min`, {min}, is above `max`, {max}");
                let help = "swap them?".into();
                Some(Contradiction { field: "min", code: code::WRONG_VALUE, message, help })
            }
            Self::Bounds { low, high, .. } => {
                let sides = [("x", low.0, high.0), ("y", low.1, high.1), ("z", low.2, high.2)];
                let (axis, low, high) = sides.into_iter().find(|(_, low, high)| high < low)?;
                let message = format!("along {axis}, `low`, {low}, is above `high`, {high}");
                let help = "swap them?".into();
                Some(Contradiction { field: "low", code: code::WRONG_VALUE, message, help })
            }
            _ => None,
        }
    }

    /// Finds quantities that are to be counted but do not exist in values of the given types.
    fn type_mismatch(&self, types: &[Option<&ValueType>]) -> Option<Contradiction> {
        let names = self.values();
        let known = |at: usize| types.get(at).copied().flatten().map(|kind| (names[at], kind));
        let is_not = |(name, kind): (&str, &ValueType), field, lack: &str| {
            let kind = with_article(kind.name);
            let message = format!("{} cannot hold: `{name}` is {kind}, {lack}", self.name());
            Some(Contradiction { field, code: code::WRONG_TYPE, message, help: Help::default() })
        };
        let flat = |at: usize| known(at).filter(|(_, kind)| has_no_faces(kind));
        match self {
            Self::Promised { .. } => None,
            Self::Count { what, .. } => {
                let (_, kind) = known(0)?;
                let names = counts_of(kind)?;
                if names.contains(what) {
                    return None;
                }
                let message = format!("{} has no count of `{what}`", with_article(kind.name));
                let names: Vec<_> = names.iter().map(String::as_str).collect();
                let help = nearest_or_all(what, "what is counted", &names);
                Some(Contradiction { field: "what", code: code::WRONG_VALUE, message, help })
            }
            Self::Bounds { .. } => {
                let given = flat(0).filter(|(_, kind)| has_no_places(kind))?;
                is_not(given, "of", "which has no positions")
            }
            _ => {
                // `Blend` measures the seam of a range image.
                let is_seam = |kind: &ValueType| {
                    matches!(self, Self::Continuity { order: Some(_), .. })
                        && kind.name == RangeImage::NAME
                };
                if let Some(given) = flat(0).filter(|(_, kind)| !is_seam(kind)) {
                    return is_not(given, "of", "which has no faces");
                }
                match self {
                    Self::Near { .. } => is_not(flat(1)?, "to", "which has no faces"),
                    Self::Whole { .. } | Self::Continuity { .. } => {
                        let given = known(1).filter(|(_, kind)| kind.name != Region::NAME)?;
                        is_not(given, "around", "not a Region")
                    }
                    _ => None,
                }
            }
        }
    }
}

/// Returns true if no sample value of the type has faces. Returns false for a type that has no sample values.
fn has_no_faces(kind: &ValueType) -> bool {
    let values = kind.edge_cases();
    !values.is_empty() && values.iter().all(|value| value.as_mesh().is_none())
}

/// Returns true if no sample value of the type has positions.
fn has_no_places(kind: &ValueType) -> bool {
    kind.edge_cases()
        .iter()
        .all(|value| value.parts().columns.iter().all(|part| part.meaning != Meaning::Position))
}

/// Returns the names of the quantities that can be counted in values of a type. `None` if the type has no sample values.
fn counts_of(kind: &ValueType) -> Option<BTreeSet<String>> {
    let values = kind.edge_cases();
    let names = values.iter().flat_map(value_counts).map(|(name, _)| name.into_owned());
    (!values.is_empty()).then(|| names.collect())
}

/// Returns the position of a field of an expectation. The field `of` may be the only value in parentheses.
pub(crate) fn field_span(item: &Tree, name: &str) -> Span {
    let value = match &item.kind {
        Kind::Call { body: Body::Items(items), .. } if name == "of" => items.first(),
        Kind::Call { body: Body::Fields(fields), .. } => {
            let field = fields.iter().find(|field| field.name.text == name);
            field.map(|field| &field.value)
        }
        _ => None,
    };
    value.unwrap_or(item).span
}
