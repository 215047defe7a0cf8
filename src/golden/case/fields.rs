//! The fields of a tolerance that make sense for a type of values.

use maquette_graph::catalog::Catalog;
use maquette_value::{Meaning, ValueType};

/// Which fields of a tolerance make sense for a value: one with places, one with other numbers, one of colors or flags alone.
pub(super) const OF_PLACES: [&str; 11] = [
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
const OF_NUMBERS: [&str; 6] = ["max", "normals", "attributes", "differing", "relative", "keep"];
const OF_LEVELS: [&str; 5] = ["differing", "level", "hard", "relative", "keep"];

/// The fields of a tolerance that make sense for a type, by what its numbers mean; all, where it has no values to tell by.
fn fields_of(kind: &ValueType) -> &'static [&'static str] {
    let values = kind.hostile();
    fn means(wanted: &[Meaning], values: &[maquette_node::AnyValue]) -> bool {
        values.iter().any(|value| {
            value.parts().columns.iter().any(|part| !part.aside && wanted.contains(&part.meaning))
        })
    }
    if values.is_empty() || means(&[Meaning::Position], &values) {
        &OF_PLACES
    } else if means(&[Meaning::Number, Meaning::Direction], &values) {
        &OF_NUMBERS
    } else {
        &OF_LEVELS
    }
}

/// The tolerances of a type of values by its name, or the types that are known.
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
