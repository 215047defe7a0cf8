//! The parameters of a graph as those of a job of Open Job Description: who submits the job may choose their values.

use std::collections::BTreeSet;

use maquette_graph::Graph;
use serde_json::{Value as Json, json};

/// A parameter of a job.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct JobParameter {
    /// As the job's template declares it.
    pub(super) definition: Json,
    /// The word of a command that gives the graph its value.
    pub(super) assignment: String,
}

impl JobParameter {
    /// Returns the parameters of a graph but those that are `set` already.
    pub(crate) fn all(graph: &Graph, set: &BTreeSet<&str>, is_draft: bool) -> Vec<Self> {
        let declared = graph.schema()["properties"].as_object().into_iter().flatten();
        let open = declared.filter(|(name, _)| !set.contains(&name[..]));
        open.filter_map(|(name, schema)| Self::new(name, schema, is_draft)).collect()
    }

    /// The parameter of this name; none if it is an input, or has a default that no template can hold.
    fn new(name: &str, schema: &Json, is_draft: bool) -> Option<Self> {
        let side = if is_draft { "draft" } else { "final" };
        let default = match &schema["draft"][side] {
            Json::Null => schema.get("default")?,
            default => default,
        };
        // Names there have no hyphens.
        let own = name.replace('-', "_");
        let mut definition = json!({ "name": own });
        let mut value = format!("{{{{Param.{own}}}}}");
        match schema["type"].as_str()? {
            kind @ ("number" | "integer") => {
                definition["type"] = if kind == "number" { "FLOAT" } else { "INT" }.into();
                definition["default"] = default.clone();
                for (limit, here) in [("minimum", "minValue"), ("maximum", "maxValue")] {
                    match &schema[limit] {
                        Json::Null => {}
                        limit if kind == "integer" => {
                            definition[here] = (limit.as_f64()? as i64).into();
                        }
                        limit => definition[here] = limit.clone(),
                    }
                }
            }
            "boolean" => {
                definition["type"] = "STRING".into();
                definition["default"] = default.to_string().into();
                definition["allowedValues"] = json!(["true", "false"]);
            }
            "array" => {
                let numbers = default.as_array()?.iter().map(Json::to_string);
                definition["type"] = "STRING".into();
                definition["default"] = format!("({})", Vec::from_iter(numbers).join(", ")).into();
            }
            _ => {
                let text = default.as_str()?;
                definition["type"] = "STRING".into();
                definition["default"] = text.into();
                match schema.get("enum") {
                    Some(choices) => definition["allowedValues"] = choices.clone(),
                    // Quotes make it a text whatever it is, and cannot be in it.
                    None if text.contains(['"', '\\', '{']) => return None,
                    None => value = format!("\"{value}\""),
                }
            }
        }
        let unit = schema["unit"].as_str().map_or_else(String::new, |unit| format!(" ({unit})"));
        let doc = schema["description"].as_str().unwrap_or_default();
        let description = format!("{doc}{unit}").trim().to_owned();
        if !description.is_empty() {
            definition["description"] = description.into();
        }
        Some(Self { definition, assignment: format!("{name}={value}") })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(schema: Json, definition: Json, assignment: &str) {
        let parameter = JobParameter::new("a-b", &schema, false).unwrap();
        assert_eq!(parameter.definition, definition);
        assert_eq!(parameter.assignment, assignment);
    }

    #[test]
    fn each_type_of_parameters_has_one_of_jobs() {
        check(
            json!({ "type": "number", "default": 1.5, "minimum": 0.0, "unit": "mm", "description": "How far." }),
            json!({ "name": "a_b", "type": "FLOAT", "default": 1.5, "minValue": 0.0, "description": "How far. (mm)" }),
            "a-b={{Param.a_b}}",
        );
        check(
            json!({ "type": "integer", "default": 2, "maximum": 4.0, "draft": { "final": 3, "draft": 1 } }),
            json!({ "name": "a_b", "type": "INT", "default": 3, "maxValue": 4 }),
            "a-b={{Param.a_b}}",
        );
        check(
            json!({ "type": "boolean", "default": true }),
            json!({ "name": "a_b", "type": "STRING", "default": "true", "allowedValues": ["true", "false"] }),
            "a-b={{Param.a_b}}",
        );
        check(
            json!({ "type": "string", "enum": ["Left", "Right"], "default": "Left" }),
            json!({ "name": "a_b", "type": "STRING", "default": "Left", "allowedValues": ["Left", "Right"] }),
            "a-b={{Param.a_b}}",
        );
        check(
            json!({ "type": "string", "default": "5" }),
            json!({ "name": "a_b", "type": "STRING", "default": "5" }),
            "a-b=\"{{Param.a_b}}\"",
        );
        check(
            json!({ "type": "array", "default": [0, 0.5, 1] }),
            json!({ "name": "a_b", "type": "STRING", "default": "(0, 0.5, 1)" }),
            "a-b={{Param.a_b}}",
        );
    }

    #[test]
    fn an_input_is_no_parameter() {
        assert_eq!(JobParameter::new("mesh", &json!({ "type": "string" }), false), None);
    }
}
