//! Makes parameters of a graph available as parameters of an Open Job Description job. The submitter of the job can set them.

use std::collections::BTreeSet;

use maquette_graph::Graph;
use serde_json::{Value as Json, json};

/// A parameter of a job.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct JobParameter {
    /// The declaration of the parameter in the job template.
    pub(super) definition: Json,
    /// The argument of `--set` by which the value of the job parameter is passed to the graph.
    pub(super) assignment: String,
}

/// Limits of Open Job Description: the maximum number of parameters without the project folder (`MAX_PARAMETERS`), and the maximum number
/// of characters in a name (`MAX_NAME`).
const MAX_PARAMETERS: usize = 49;
const MAX_NAME: usize = 64;
const MAX_TEXT: usize = 1024;
const MAX_DESCRIPTION: usize = 2048;

impl JobParameter {
    /// Returns the job parameters for a graph. Parameters in `set`, and those that a job template cannot represent, are left out.
    pub(crate) fn from_graph(graph: &Graph, set: &BTreeSet<&str>, is_draft: bool) -> Vec<Self> {
        let declared = graph.schema()["properties"].as_object().into_iter().flatten();
        let open = declared.filter(|(name, _)| !set.contains(&name[..]));
        let all = open.filter_map(|(name, schema)| Self::new(name, schema, is_draft));
        all.take(MAX_PARAMETERS).collect()
    }

    /// Creates the job parameter with this name. Returns `None` if it is an input of the graph, or if a template cannot represent its
    /// default.
    fn new(name: &str, schema: &Json, is_draft: bool) -> Option<Self> {
        let side = if is_draft { "draft" } else { "final" };
        let default = match &schema["draft"][side] {
            Json::Null => schema.get("default")?,
            default => default,
        };
        // Replace hyphens, which the names of job parameters must not contain.
        let own = name.replace('-', "_");
        if own.len() > MAX_NAME {
            return None;
        }
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
                if text.chars().count() > MAX_TEXT || text.contains(char::is_control) {
                    return None;
                }
                definition["type"] = "STRING".into();
                definition["default"] = text.into();
                match schema.get("enum") {
                    Some(choices) => definition["allowedValues"] = choices.clone(),
                    // The value is passed in quotes, so that it always is a text. So the default itself must not contain quotes.
                    None if text.contains(['"', '\\', '{']) => return None,
                    None => value = format!("\"{value}\""),
                }
            }
        }
        let unit = schema["unit"].as_str().map_or_else(String::new, |unit| format!(" ({unit})"));
        let doc = schema["description"].as_str().unwrap_or_default();
        let doc = doc
            .chars()
            .filter(|c| !c.is_control() || matches!(c, '\n' | '\t'))
            .take(MAX_DESCRIPTION - unit.len());
        let description = format!("{}{unit}", String::from_iter(doc)).trim().to_owned();
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
    fn each_parameter_type_becomes_a_job_parameter() {
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
    fn unsupported_parameters_are_skipped_and_long_descriptions_are_cut() {
        fn text(default: &str, doc: &str) -> Json {
            json!({ "type": "string", "default": default, "description": doc })
        }
        fn check_no_parameter(name: &str, default: &str) {
            assert_eq!(
                JobParameter::new(name, &text(default, ""), false),
                None,
                "{name} {default}"
            );
        }
        check_no_parameter(&"a".repeat(65), "x");
        check_no_parameter("a", &"x".repeat(1025));
        check_no_parameter("a", "a\tb");
        let doc = "\u{e4}\u{7}\n".repeat(2000);
        let found = JobParameter::new("a", &text("x", &doc), false).unwrap();
        let found = found.definition["description"].as_str().unwrap().to_owned();
        assert_eq!(
            (found.chars().count(), found.contains('\u{7}')),
            (2047, false),
            "the last line end is cut"
        );
    }

    #[test]
    fn an_input_is_not_a_job_parameter() {
        assert_eq!(JobParameter::new("mesh", &json!({ "type": "string" }), false), None);
    }
}
