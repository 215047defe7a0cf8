//! Visits the scalar parameters of a node: booleans, numbers and texts.

use maquette_syntax::{resolve, resolve_field, variants};
use serde_json::Value as Json;

/// Visits the scalar parameters of a node, including those inside of lists and enum variants.
pub(super) struct Scalars<'a> {
    /// The JSON schema of the node.
    pub(super) schema: &'a Json,
    /// The maximum number of items that are visited in each list.
    pub(super) max_items: usize,
}

impl Scalars<'_> {
    /// Calls `visit` with the path, the value and the schema of each boolean, number and text.
    pub(super) fn visit(&self, parameters: &Json, visit: &mut impl FnMut(&str, &Json, &Json)) {
        for (name, value) in parameters.as_object().into_iter().flatten() {
            self.visit_value(name, value, &self.schema["properties"][name], visit);
        }
    }

    fn visit_value(
        &self,
        path: &str,
        value: &Json,
        field: &Json,
        visit: &mut impl FnMut(&str, &Json, &Json),
    ) {
        let schema = resolve_field(field, self.schema);
        match value {
            Json::Null => {}
            Json::Array(items) => {
                let mut of_items = schema["items"].clone();
                // The unit of a list is that of its items.
                if let (Some(unit), Some(of_items)) = (schema.get("unit"), of_items.as_object_mut())
                {
                    of_items.entry("unit").or_insert_with(|| unit.clone());
                }
                for (index, item) in items.iter().take(self.max_items).enumerate() {
                    self.visit_value(&format!("{path}.{index}"), item, &of_items, visit);
                }
            }
            Json::Object(entries) => {
                let choices = variants(&schema);
                for (name, value) in entries.iter().filter(|(name, _)| !name.starts_with('$')) {
                    let chosen = choices.iter().find(|(known, _)| known == name);
                    match chosen.map(|(_, content)| content.map(|it| resolve(self.schema, it))) {
                        // Leave the name of the variant out of the path: in a graph file, the fields of a variant follow its name directly.
                        Some(Some(content)) if content.get("properties").is_some() => {
                            self.visit_value(path, value, &content, visit);
                        }
                        Some(Some(content)) => {
                            self.visit_value(&format!("{path}.0"), value, &content, visit);
                        }
                        Some(None) => {}
                        None => {
                            let field = &schema["properties"][name];
                            self.visit_value(&format!("{path}.{name}"), value, field, visit);
                        }
                    }
                }
            }
            _ => visit(path, value, &schema),
        }
    }
}
