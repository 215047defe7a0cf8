//! Counts of a value's elements.

use std::borrow::Cow;

use super::topology::{Topology, border_loops};
use super::{AnyValue, ElementKind, FactValue, Items, Meaning, Part, Parts};

/// Returns all counts of a value with their names. For a mesh these are its topology and its faces
/// without area; for any other value, its facts that are counts.
pub fn value_counts(value: &AnyValue) -> Vec<(Cow<'static, str>, i64)> {
    match value.as_mesh() {
        Some(mesh) => {
            let others = [
                ("border loops", border_loops(&mesh) as i64),
                ("faces without area", mesh.flat_faces().len() as i64),
            ];
            let facts = Topology::from_mesh(&mesh).facts().into_iter().chain(others);
            facts.map(|(name, count)| (name.into(), count)).collect()
        }
        None => counts(&value.parts()),
    }
}

/// Returns the counts of a value that is not shown as faces: its facts that are counts, without the prefix `valid `, and for a mask the
/// number of pixels inside.
fn counts(parts: &Parts<'_>) -> Vec<(Cow<'static, str>, i64)> {
    let mut counts: Vec<_> = parts
        .facts
        .iter()
        .filter_map(|fact| match (&fact.name, &fact.value) {
            (name, FactValue::Count(count)) => {
                let name = name
                    .strip_prefix("valid ")
                    .map_or_else(|| name.clone(), |name| name.to_owned().into());
                Some((name, *count as i64))
            }
            _ => None,
        })
        .collect();
    if let [
        Part {
            element_kind: ElementKind::Pixel,
            meaning: Meaning::Exact,
            items: Items::U8(flags),
            ..
        },
    ] = &parts.columns[..]
    {
        let inside = flags.iter().filter(|&&flag| flag == 1).count();
        counts.push(("pixels".into(), inside as i64));
    }
    counts
}
