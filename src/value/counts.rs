//! What is counted of a value.

use std::borrow::Cow;

use super::topology::{Topology, border_loops};
use super::{AnyValue, FactValue, Items, Meaning, On, Part, Parts};

/// What is counted of a value, and how many there are.
pub fn counted(value: &AnyValue) -> Vec<(Cow<'static, str>, i64)> {
    match value.as_mesh() {
        Some(mesh) => {
            let loops = [("border loops", border_loops(&mesh) as i64)];
            let facts = Topology::of(&mesh).facts().into_iter().chain(loops);
            facts.map(|(name, count)| (name.into(), count)).collect()
        }
        None => counts(&value.parts()),
    }
}

/// What can be counted of a value that shows no faces: its facts that are counts, without `valid` before them, and the pixels of a mask.
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
    if let [Part { on: On::Pixel, meaning: Meaning::Exact, items: Items::U8(flags), .. }] =
        &parts.columns[..]
    {
        let inside = flags.iter().filter(|&&flag| flag == 1).count();
        counts.push(("pixels".into(), inside as i64));
    }
    counts
}
