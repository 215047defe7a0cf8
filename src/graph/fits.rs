//! Whether an expectation can hold at all: what is known of it when a graph is checked.

use std::collections::BTreeSet;

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Body, Finding, Help, Kind, Tree, nearest_or_all, with_article};
use maquette_value::{Meaning, Region, Value as _, ValueType, counted};

use crate::Expectation;

/// What is wrong with an expectation: the field, the code, what, and what to do.
type Fault = (&'static str, &'static str, String, Help);

impl Expectation {
    /// Why it holds of no values of these types, which are those that it speaks of; what is not known of a type is right. `item` is
    /// where it stands.
    pub fn fault(&self, types: &[Option<&ValueType>], item: &Tree) -> Option<Finding> {
        let (field, code, message, help) = self.contradiction().or_else(|| self.misfit(types))?;
        Some(Finding { code, span: place(item, field), message, help, note: None })
    }

    /// What it says against itself.
    fn contradiction(&self) -> Option<Fault> {
        match self {
            Self::Count { min: None, max: None, .. } => Some((
                "",
                code::MISSING_FIELD,
                "Count needs a field `min` or `max`".into(),
                "any number is expected without".into(),
            )),
            Self::Count { min: Some(min), max: Some(max), .. }
            | Self::Attribute { min: Some(min), max: Some(max), .. }
                if max < min =>
            {
                let message = format!("`min`, {min}, is above `max`, {max}");
                Some(("min", code::WRONG_VALUE, message, "swap them?".into()))
            }
            Self::Bounds { low, high, .. } => {
                let sides = [("x", low.0, high.0), ("y", low.1, high.1), ("z", low.2, high.2)];
                let (axis, low, high) = sides.into_iter().find(|(_, low, high)| high < low)?;
                let message = format!("along {axis}, `low`, {low}, is above `high`, {high}");
                Some(("low", code::WRONG_VALUE, message, "swap them?".into()))
            }
            _ => None,
        }
    }

    /// What it wants of a value whose type does not have it.
    fn misfit(&self, types: &[Option<&ValueType>]) -> Option<Fault> {
        let names = self.values();
        let known = |at: usize| types.get(at).copied().flatten().map(|kind| (names[at], kind));
        let is_not = |(name, kind): (&str, &ValueType), field, lack: &str| -> Option<Fault> {
            let kind = with_article(kind.name);
            let message = format!("{} cannot hold: `{name}` is {kind}, {lack}", self.name());
            Some((field, code::WRONG_TYPE, message, Help::default()))
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
                let message = format!("of {} no `{what}` are counted", with_article(kind.name));
                let names: Vec<_> = names.iter().map(String::as_str).collect();
                let help = nearest_or_all(what, "what is counted", &names);
                Some(("what", code::WRONG_VALUE, message, help))
            }
            Self::Bounds { .. } => {
                let given = flat(0).filter(|(_, kind)| has_no_places(kind))?;
                is_not(given, "of", "which has no places")
            }
            _ => {
                if let Some(given) = flat(0) {
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

/// Whether none of a type's values shows faces, as far as it has any to tell by.
fn has_no_faces(kind: &ValueType) -> bool {
    let values = kind.hostile();
    !values.is_empty() && values.iter().all(|value| value.as_mesh().is_none())
}

/// The same of places.
fn has_no_places(kind: &ValueType) -> bool {
    kind.hostile()
        .iter()
        .all(|value| value.parts().columns.iter().all(|part| part.meaning != Meaning::Position))
}

/// What can be counted of the values of a type; none if it has no values to tell by.
fn counts_of(kind: &ValueType) -> Option<BTreeSet<String>> {
    let values = kind.hostile();
    let names = values.iter().flat_map(counted).map(|(name, _)| name.into_owned());
    (!values.is_empty()).then(|| names.collect())
}

/// Where a field of an expectation stands; the only value of one in parentheses is `of`.
pub(crate) fn place(item: &Tree, name: &str) -> Span {
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
