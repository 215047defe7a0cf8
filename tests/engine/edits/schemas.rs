//! Generates valid values for the fields of nodes and for parameters, from their JSON schemas.

use std::sync::OnceLock;

use serde_json::Value as Json;

use super::catalog;
use super::sketch::{Sketch, named_parts, parts};

/// Returns the JSON schema of a node type. Returns `None` if `kind` is a graph that the file uses.
fn node_type(kind: &str) -> Option<&'static Json> {
    static NODES: OnceLock<Json> = OnceLock::new();
    let nodes = NODES.get_or_init(|| catalog().to_json()["nodes"].take());
    nodes.as_array()?.iter().find(|node| node["name"] == kind)
}

/// Splits a target of the form `node.field.path`. Returns the JSON schema of the node's type, and `field.path`.
fn of_target<'t>(sketch: &Sketch, target: &'t str) -> Option<(&'static Json, &'t str)> {
    let (name, field) = target.split_once('.')?;
    let node = sketch.nodes.iter().find(|node| node.name == name)?;
    Some((node_type(&node.kind)?, field))
}

/// Returns the linked ports whose link may be removed: optional ports, and items of lists with several links.
pub(crate) fn free_ports(sketch: &Sketch) -> Vec<String> {
    fn is_free(port: &str, sketch: &Sketch) -> Option<bool> {
        let (node, field) = of_target(sketch, port)?;
        let (field, in_list) = field.split_once('.').map_or((field, false), |it| (it.0, true));
        let ports = node["inputs"].as_array()?;
        let found = ports.iter().find(|port| port["name"] == field)?;
        let start = port.rsplit_once('.')?.0;
        let siblings = sketch.links.iter().filter(|(other, _)| {
            other.strip_prefix(start).is_some_and(|rest| rest.starts_with('.'))
        });
        Some(match in_list {
            true => siblings.count() > 1,
            false => found["optional"] == true && found["many"] == false,
        })
    }
    let free = sketch.links.iter().filter(|(port, _)| is_free(port, sketch) == Some(true));
    free.map(|(port, _)| port.clone()).collect()
}

/// Returns values that are valid in place of `old`. If none is known, returns only `old`.
pub(crate) fn values(sketch: &Sketch, target: &str, old: &str) -> Vec<String> {
    let found = match target.contains('.') {
        true => of_field(sketch, target),
        false => of_parameter(old),
    };
    found.filter(|values| !values.is_empty()).unwrap_or_else(|| vec![old.to_owned()])
}

fn of_field(sketch: &Sketch, target: &str) -> Option<Vec<String>> {
    let (node, field) = of_target(sketch, target)?;
    let root = &node["parameters"];
    let field = &root["properties"][field];
    let schema = match field["$ref"].as_str() {
        Some(path) => root.pointer(path.trim_start_matches('#'))?,
        None => field,
    };
    fn number(name: &str, field: &Json) -> Option<f64> {
        field[name].as_f64()
    }
    match schema["type"].as_str() {
        Some("boolean") => Some(vec!["true".into(), "false".into()]),
        Some("number") => Some(numbers(number("minimum", field), number("maximum", field), false)),
        Some("integer") => Some(numbers(number("minimum", field), number("maximum", field), true)),
        _ => {
            let words = schema["enum"].as_array().into_iter().flatten();
            let choices = schema["oneOf"].as_array().into_iter().flatten();
            let words = words.chain(choices.map(|choice| &choice["const"]));
            Some(words.filter_map(Json::as_str).map(str::to_owned).collect())
        }
    }
}

/// Returns valid default values for the declaration of a parameter, such as `Number(default: 1.0, min: 0.0)`.
fn of_parameter(declaration: &str) -> Option<Vec<String>> {
    let (kind, inside) = declaration.split_once('(')?;
    let fields = named_parts(inside.strip_suffix(')')?);
    fn field(name: &str, fields: &[(String, String)]) -> Option<String> {
        let found = fields.iter().find(|(field, _)| field == name);
        found.map(|(_, value)| value.clone())
    }
    fn number(name: &str, fields: &[(String, String)]) -> Option<f64> {
        field(name, fields)?.parse::<f64>().ok()
    }
    match kind {
        "Number" | "Integer" => {
            Some(numbers(number("min", &fields), number("max", &fields), kind == "Integer"))
        }
        "Toggle" => Some(vec!["true".into(), "false".into()]),
        "Choice" => {
            Some(parts(field("of", &fields)?.trim_start_matches('[').trim_end_matches(']')))
        }
        _ => Some(vec![field("default", &fields)?]),
    }
}

/// Returns some numbers from `least` to `most`. They are whole numbers if `whole` is true.
fn numbers(least: Option<f64>, most: Option<f64>, whole: bool) -> Vec<String> {
    let inside =
        |x: &f64| least.is_none_or(|least| least <= *x) && most.is_none_or(|most| *x <= most);
    let ends = [least, most].into_iter().flatten().filter(|end| end.abs() < 1e6);
    let numbers =
        ends.chain([0.5_f64, 1.0, 2.0, 5.0].into_iter().filter(|x| !whole || x.fract() == 0.0));
    numbers
        .filter(inside)
        .map(|x: f64| if whole { format!("{x}") } else { format!("{x:?}") })
        .collect()
}
