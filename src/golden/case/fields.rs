//! The fields that a tolerance can have for each value type.

use maquette_graph::catalog::Catalog;
use maquette_value::{Meaning, ValueType};

/// The fields that a tolerance can have: for values with positions, for values with other numbers, and for values with only colors or
/// flags.
pub(super) const POSITION_FIELDS: [&str; 11] = [
    "max",
    "rms",
    "p99",
    "normals",
    "attributes",
    "differing",
    "level",
    "hard",
    "relative",
    "remeshed",
    "keep",
];
const NUMBER_FIELDS: [&str; 6] = ["max", "normals", "attributes", "differing", "relative", "keep"];
const LEVEL_FIELDS: [&str; 5] = ["differing", "level", "hard", "relative", "keep"];

/// Returns the fields that a tolerance can have for a value type. They depend on the meaning of the type's numbers. If the type has no
/// sample values, all fields are possible.
fn fields_of(kind: &ValueType) -> &'static [&'static str] {
    let values = kind.edge_cases();
    fn means(wanted: &[Meaning], values: &[maquette_node::AnyValue]) -> bool {
        values.iter().any(|value| {
            value
                .parts()
                .columns
                .iter()
                .any(|part| !part.is_hidden && wanted.contains(&part.meaning))
        })
    }
    if values.is_empty() || means(&[Meaning::Position], &values) {
        &POSITION_FIELDS
    } else if means(&[Meaning::Number, Meaning::Direction], &values) {
        &NUMBER_FIELDS
    } else {
        &LEVEL_FIELDS
    }
}

/// A function that returns the fields that a tolerance can have, given the name of a value type. For an unknown name it returns the known
/// names as an error.
pub(super) type Fields<'a> =
    dyn Fn(&str) -> Result<&'static [&'static str], Vec<&'static str>> + 'a;

pub(super) fn known_fields(
    catalog: &Catalog,
) -> impl Fn(&str) -> Result<&'static [&'static str], Vec<&'static str>> + '_ {
    |name| {
        catalog.value_types().get(name).map(|kind| fields_of(kind)).ok_or_else(|| {
            let mut known: Vec<_> = catalog.value_types().into_keys().collect();
            known.sort_unstable();
            known
        })
    }
}
