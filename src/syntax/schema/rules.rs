//! What a schema says of several numbers or fields together, in words of its own beside those of JSON schemas.
//!
//! - `"direction": true` of a vector: it is not zero.
//! - `"nonzero": true` of a number, and `"multipleOf"`.
//! - `"most": "max"` of a field: none of its numbers is above that of the field `max` beside it. With `"wraps": {"space": "Hsv"}` the first
//!   numbers of both are free where the field `space` is `Hsv`.
//! - `"least": 1` of a port that takes many: an empty list is refused.

use serde_json::Value as Json;

use super::Walk;
use crate::Help;
use crate::error::code;
use crate::tree::{Body, Field, Kind, Tree};

impl Walk<'_> {
    /// Checks the rules of a vector.
    pub(super) fn vector(&mut self, tree: &Tree, items: &[Tree], schema: &Json, field: &str) {
        if schema.get("direction").is_some()
            && items.iter().all(|item| matches!(item.kind, Kind::Number { value: 0.0, .. }))
        {
            let zeros = items.iter().map(|_| "0").collect::<Vec<_>>().join(", ");
            let message =
                format!("field `{field}` of {} is ({zeros}), which is no direction", self.node);
            self.find(code::OUT_OF_RANGE, tree, message, "write one such as (0, 1, 0)");
        }
    }

    /// What is wrong with a number that is in its range.
    pub(super) fn odd_number(value: f64, schema: &Json) -> Option<String> {
        let factor = schema.get("multipleOf").and_then(Json::as_f64);
        match factor.filter(|factor| value % factor != 0.0) {
            Some(factor) => Some(format!("a multiple of {factor}")),
            None if value == 0.0 && schema.get("nonzero").is_some() => {
                Some("another number".into())
            }
            None => None,
        }
    }

    /// Checks that no lower bound is above its upper bound.
    pub(super) fn ascending(&mut self, fields: &[Field], schema: &Json, owner: &str) {
        let value =
            |name: &str| fields.iter().find(|field| field.name.text == name).map(|it| &it.value);
        for Field { name, value: from } in fields {
            let rules = &schema["properties"][&name.text];
            let Some(most) = rules.get("most").and_then(Json::as_str) else { continue };
            let Some(to) = value(most) else { continue };
            let mut free = rules.get("wraps").and_then(Json::as_object).into_iter().flatten();
            let wraps = free.any(|(field, word)| {
                let found = value(field).and_then(Tree::name);
                found.is_some_and(|found| word.as_str() == Some(&found.text))
            });
            let (from, to) = (numbers(from), numbers(to));
            let both = from.iter().zip(&to).skip(usize::from(wraps));
            for ((at, from), (_, to)) in both.filter(|((_, from), (_, to))| to < from) {
                let name = &name.text;
                let message =
                    format!("`{name}` of {owner} is {from}, but must be at most `{most}`, {to}");
                self.find(code::OUT_OF_RANGE, at, message, "swap both numbers");
            }
        }
    }

    /// The port that takes values of a type with this name, for which a field was taken: `mesh` for `points`.
    pub(super) fn port_for(&self, name: &str, schema: &Json) -> Option<Help> {
        let properties = schema.get("properties")?.as_object()?;
        let wanted = name.replace('_', "");
        let mut ports = properties.iter().filter(|(_, port)| {
            let port = if port.get("items").is_some() { &port["items"] } else { *port };
            let types =
                super::resolve(self.root, port).get("types").and_then(Json::as_array).cloned();
            types.into_iter().flatten().any(|kind| {
                kind.as_str().is_some_and(|kind| {
                    let kind = kind.to_lowercase();
                    kind == wanted || Some(&kind[..]) == wanted.strip_suffix('s')
                })
            })
        });
        let (port, _) = ports.next().filter(|_| ports.next().is_none())?;
        Some(Help::rename(format!("rename it to `{port}`, the port that takes it"), name, port))
    }
}

/// The numbers of a value, each with its place.
fn numbers(tree: &Tree) -> Vec<(&Tree, f64)> {
    match &tree.kind {
        Kind::Number { value, .. } => vec![(tree, *value)],
        Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
            items.iter().flat_map(numbers).collect()
        }
        _ => Vec::new(),
    }
}
