//! Rules: additional schema keywords that are not part of JSON schema. Most of them relate several numbers or fields:
//!
//! - `"direction": true` of a vector: the vector must not be zero.
//! - `"nonzero": true` of a number: the number must not be zero. Also the keyword `"multipleOf"` of JSON schema.
//! - `"most": "max"` of a field: its numbers must not exceed those of the field `max` of the same struct. With `"wraps": {"space": "Hsv"}`,
//!   the first numbers of both are not compared if the field `space` is `Hsv`.
//! - `"least": 1` of a port that takes a list: the list must not be empty.

use serde_json::Value as Json;

use super::Walk;
use crate::Help;
use crate::error::code;
use crate::tree::{Body, Field, Kind, Tree};

impl Walk<'_> {
    /// Checks a vector against the rules in its schema, such as `"direction": true`.
    pub(super) fn check_vector(&mut self, tree: &Tree, items: &[Tree], schema: &Json, field: &str) {
        if schema.get("direction").is_some()
            && items.iter().all(|item| matches!(item.kind, Kind::Number { value: 0.0, .. }))
        {
            let zeros = items.iter().map(|_| "0").collect::<Vec<_>>().join(", ");
            let message =
                format!("field `{field}` of {} is ({zeros}), which is not a direction", self.node);
            self.report(code::OUT_OF_RANGE, tree, message, "write one such as (0, 1, 0)");
        }
    }

    /// Describes the rule that a number violates. `None` if the number is valid. Its range is checked elsewhere.
    pub(super) fn violated_number_rule(value: f64, schema: &Json) -> Option<String> {
        let factor = schema.get("multipleOf").and_then(Json::as_f64);
        match factor.filter(|factor| value % factor != 0.0) {
            Some(factor) => Some(format!("a multiple of {factor}")),
            None if value == 0.0 && schema.get("nonzero").is_some() => Some("nonzero".into()),
            None => None,
        }
    }

    /// Checks pairs of fields that are a lower and an upper bound: no lower bound may exceed its upper bound.
    pub(super) fn check_order(&mut self, fields: &[Field], schema: &Json, owner: &str) {
        fn value<'a>(fields: &'a [Field], name: &str) -> Option<&'a Tree> {
            fields.iter().find(|field| field.name.text == name).map(|it| &it.value)
        }
        for Field { name, value: from } in fields {
            let rules = &schema["properties"][&name.text];
            let Some(most) = rules.get("most").and_then(Json::as_str) else { continue };
            let Some(to) = value(fields, most) else { continue };
            let mut free = rules.get("wraps").and_then(Json::as_object).into_iter().flatten();
            let wraps = free.any(|(field, word)| {
                let found = value(fields, field).and_then(Tree::name);
                found.is_some_and(|found| word.as_str() == Some(&found.text))
            });
            let (from, to) = (numbers(from), numbers(to));
            let both = from.iter().zip(&to).skip(usize::from(wraps));
            for ((at, from), (_, to)) in both.filter(|((_, from), (_, to))| to < from) {
                let name = &name.text;
                let message =
                    format!("`{name}` of {owner} is {from}, but must be at most `{most}`, {to}");
                self.report(code::OUT_OF_RANGE, at, message, "swap both numbers");
            }
        }
    }

    /// If an unknown field has the name of a type, such as `mesh` or `points`, suggests the port that takes values of this type. `None` if
    /// several ports do.
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

/// Returns all numbers in a value, each with its node of the tree.
fn numbers(tree: &Tree) -> Vec<(&Tree, f64)> {
    match &tree.kind {
        Kind::Number { value, .. } => vec![(tree, *value)],
        Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
            items.iter().flat_map(numbers).collect()
        }
        _ => Vec::new(),
    }
}
