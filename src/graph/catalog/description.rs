//! Descriptions of node types for people and programs: ports, outputs and parameters.

use maquette_node::{Carry, Exactness};
use maquette_syntax::{resolve, resolve_field, to_ron, variants};
use serde_json::{Value as Json, json};

/// The documentation of a node type: of a built-in node, or of a graph that is used as a node.
pub struct Description<'a> {
    pub name: &'a str,
    /// The name of the pack for a built-in node; the path of the file for a graph.
    pub pack: &'a str,
    /// The version of a graph. `None` for built-in nodes and for graphs without a version.
    pub version: Option<&'a str>,
    pub schema: &'a Json,
    /// The name of each output, and the types that its values can have.
    pub outputs: Vec<(String, Vec<&'static str>)>,
    /// The promised properties as text, each with the name of the output.
    pub promises: Vec<(String, String)>,
    /// The documented effects of the node on attributes. Empty if they are not documented.
    pub carries: &'static [Carry],
    /// How closely the results agree between machines and builds.
    pub exactness: Exactness,
}

impl Description<'_> {
    /// Returns the descriptions of the node's ports, in order.
    pub fn ports(&self) -> Vec<PortDescription> {
        ports(self.schema)
    }

    /// Returns the promised properties of an output, as text.
    pub fn promises_of<'d>(&'d self, output: &str) -> impl Iterator<Item = &'d str> {
        let of_it = self.promises.iter().filter(move |(name, _)| name == output);
        of_it.map(|(_, words)| &words[..])
    }

    pub fn to_json(&self) -> Json {
        let ports = self.ports();
        let mut parameters = self.schema.clone();
        if let Some(properties) = parameters.get_mut("properties").and_then(Json::as_object_mut) {
            properties.retain(|name, _| ports.iter().all(|port| port.name != *name));
        }
        if let Some(required) = parameters.get_mut("required").and_then(Json::as_array_mut) {
            required.retain(|name| ports.iter().all(|port| name.as_str() != Some(&port.name)));
        }
        let outputs = self.outputs.iter().map(|(name, types)| {
            let mut output = json!({ "name": name, "types": types });
            let promises = Vec::from_iter(self.promises_of(name));
            if !promises.is_empty() {
                output["promises"] = json!(promises);
            }
            output
        });
        let mut described = json!({
            "name": self.name,
            "pack": self.pack,
            "doc": self.schema.get("description").cloned().unwrap_or_default(),
            "inputs": ports.iter().map(PortDescription::to_json).collect::<Vec<_>>(),
            "outputs": outputs.collect::<Vec<_>>(),
            "parameters": parameters,
            "exactness": self.exactness.to_json(),
        });
        if !self.carries.is_empty() {
            described["attributes"] = self.carries.iter().map(|carry| carry.to_json()).collect();
        }
        if let Some(version) = self.version {
            described["version"] = version.into();
        }
        described
    }
}

/// The description of a port for people and programs.
pub struct PortDescription {
    pub name: String,
    pub types: Vec<String>,
    pub optional: bool,
    pub many: bool,
    /// The properties that the port requires of its values, as text.
    pub requirements: Vec<String>,
    pub doc: String,
}

impl PortDescription {
    fn to_json(&self) -> Json {
        let mut port = json!({
            "name": self.name,
            "types": self.types,
            "optional": self.optional,
            "many": self.many,
            "doc": self.doc,
        });
        if !self.requirements.is_empty() {
            port["wants"] = json!(self.requirements);
        }
        port
    }
}

/// Returns the ports among the fields of a schema, in order.
pub fn ports(schema: &Json) -> Vec<PortDescription> {
    let properties = schema.get("properties").and_then(Json::as_object);
    let required = schema.get("required").and_then(Json::as_array);
    fn is_optional(name: &str, required: &Option<&Vec<Json>>) -> bool {
        !required.is_some_and(|required| required.iter().any(|field| field.as_str() == Some(name)))
    }
    properties
        .into_iter()
        .flatten()
        .filter_map(|(name, field): (&String, &Json)| {
            port(name, field, is_optional(name, &required))
        })
        .collect()
}

fn string_list(list: &Json) -> Vec<String> {
    let words = list.as_array().into_iter().flatten();
    words.filter_map(Json::as_str).map(str::to_owned).collect()
}

fn port(name: &str, field: &Json, optional: bool) -> Option<PortDescription> {
    let items = field.get("items").filter(|items| items.get("port").is_some());
    let types = items.unwrap_or(field).get("types")?.as_array()?;
    Some(PortDescription {
        name: name.to_owned(),
        types: types.iter().filter_map(Json::as_str).map(str::to_owned).collect(),
        optional,
        many: items.is_some(),
        requirements: string_list(&field["wants"]),
        doc: field["description"].as_str().unwrap_or_default().to_owned(),
    })
}

/// Describes on one line the values that a parameter accepts.
pub fn describe_parameter(schema: &Json, root: &Json) -> String {
    describe_type(schema, root, &[])
}

/// Describes a schema that is nested in the types `within`. A type in this list, identified by its reference, is not described again, so
/// that the description of a recursive type is finite.
fn describe_type(schema: &Json, root: &Json, within: &[&str]) -> String {
    let refers = schema.get("$ref").and_then(Json::as_str);
    if refers.is_some_and(|refers| within.contains(&refers)) {
        return "..".into();
    }
    let within = &within.iter().copied().chain(refers).collect::<Vec<_>>()[..];
    let schema = &resolve_field(schema, root);
    let variants = variants(schema);
    if !variants.is_empty() {
        return variants
            .iter()
            .map(|(name, content)| match content {
                None => (*name).to_owned(),
                Some(content) => format!("{name}{}", describe_content(content, root, within)),
            })
            .collect::<Vec<_>>()
            .join(" | ");
    }
    let unit = schema.get("unit").and_then(Json::as_str);
    let unit = unit.map_or_else(String::new, |unit| format!(" {unit}"));
    match schema.get("type").and_then(Json::as_str) {
        Some("array") => {
            let fixed = schema.get("prefixItems").and_then(Json::as_array);
            let (least, most) = (schema.get("minItems"), schema.get("maxItems"));
            let bound = least.filter(|_| least == most).and_then(Json::as_u64);
            let count = fixed.map(Vec::len).or_else(|| bound.map(|count| count as usize));
            let words = |k: usize| {
                let item = fixed.and_then(|fixed| fixed.get(k)).or_else(|| schema.get("items"));
                item.map_or_else(String::new, |item| describe_type(item, root, within))
            };
            match count {
                Some(count) => {
                    let words = (0..count).map(words).collect::<Vec<_>>().join(", ");
                    format!("({words}){unit}")
                }
                None => format!("[{}, ..]{unit}", words(0)),
            }
        }
        Some("object") if schema.get("properties").is_none() => "{\"name\": .., ..}".into(),
        Some("object") => describe_content(schema, root, within),
        Some("string") => schema.get("format").and_then(Json::as_str).unwrap_or("text").to_owned(),
        Some("boolean") => "true | false".into(),
        Some(kind @ ("number" | "integer")) => {
            let [least, most, above, below] =
                ["minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum"]
                    .map(|name| schema.get(name).and_then(Json::as_f64));
            // If the schema has both an inclusive and an exclusive limit, use the narrower one.
            let above = above.filter(|above| least.is_none_or(|least| least <= *above));
            let below = below.filter(|below| most.is_none_or(|most| *below <= most));
            let lowest = above.map(|above| format!(" above {above}"));
            let lowest = lowest.or_else(|| least.map(|least| format!(" from {least}")));
            let highest = below.map(|below| format!(" below {below}"));
            let highest = highest.or_else(|| most.map(|most| format!(" up to {most}")));
            match (least, most) {
                (Some(least), Some(most)) if above.or(below).is_none() => {
                    format!("{kind} {least} to {most}{unit}")
                }
                _ => {
                    let range = lowest.into_iter().chain(highest).collect::<Vec<_>>().join(",");
                    format!("{kind}{range}{unit}")
                }
            }
        }
        _ => "value".into(),
    }
}

fn describe_content(content: &Json, root: &Json, within: &[&str]) -> String {
    let content = resolve(root, content);
    match content.get("properties").and_then(Json::as_object) {
        Some(fields) => {
            let fields = fields.iter().map(|(name, field)| {
                let (kind, default) =
                    (describe_type(field, root, within), describe_default(field, root));
                format!("{name}: {kind}{default}")
            });
            format!("({})", fields.collect::<Vec<_>>().join(", "))
        }
        None => {
            let inner = describe_type(&content, root, within);
            if inner.starts_with('(') { inner } else { format!("({inner})") }
        }
    }
}

/// Returns ` = default`, with the default as it would be written in a graph file. Empty if the schema has no default.
pub fn describe_default(schema: &Json, root: &Json) -> String {
    let default = schema.get("default");
    default.map_or_else(String::new, |default| format!(" = {}", to_ron(default, schema, root)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_say_whether_their_ends_belong_to_them() {
        for (schema, described) in [
            (json!({}), "number"),
            (json!({ "minimum": 0.0 }), "number from 0"),
            (json!({ "minimum": 0.0, "maximum": 1.0 }), "number 0 to 1"),
            (json!({ "maximum": 1.0, "unit": "mm" }), "number up to 1 mm"),
            // With both an inclusive and an exclusive limit, the narrower one is printed.
            (json!({ "minimum": 0.0, "exclusiveMinimum": 0.0, "unit": "mm" }), "number above 0 mm"),
            (json!({ "minimum": 1.0, "exclusiveMinimum": 0.0 }), "number from 1"),
            (json!({ "exclusiveMinimum": 0.0, "maximum": 2.0 }), "number above 0, up to 2"),
            (json!({ "minimum": 0.0, "exclusiveMaximum": 2.0 }), "number from 0, below 2"),
        ] {
            let mut schema = schema;
            schema["type"] = "number".into();
            assert_eq!(describe_parameter(&schema, &json!({})), described);
        }
    }

    /// A shape.
    #[derive(schemars::JsonSchema, serde::Serialize)]
    #[expect(dead_code, reason = "only its schema is looked at")]
    enum Shape {
        /// No shape.
        Nothing,
        /// A ball, as a variant with a struct.
        Ball(Ball),
    }

    /// A ball.
    #[derive(schemars::JsonSchema, serde::Serialize)]
    struct Ball {
        /// Radius of the ball.
        #[schemars(default)]
        radius: f64,
        /// Number of layers of the ball.
        #[schemars(default)]
        layers: u32,
    }

    #[test]
    fn a_struct_in_a_variant_is_described_as_its_fields() {
        let root = Json::from(schemars::schema_for!(Shape));
        let described = describe_parameter(&root, &root);
        assert!(
            described.starts_with("Nothing | Ball(radius: number = 0.0, layers: integer"),
            "{described}"
        );
    }
}
