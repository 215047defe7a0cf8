//! Formats JSON values as RON.

use serde_json::{Map, Value as Json};

use super::schema_path::{option_inner, resolve, variants};

/// Formats a JSON value that conforms to `schema` as RON. Omits fields whose values equal their defaults.
pub fn to_ron(value: &Json, schema: &Json, root: &Json) -> String {
    let schema = resolve(root, schema);
    if value.is_null() {
        return "None".into();
    }
    if let Some(inner) = option_inner(&schema) {
        return to_ron(value, &inner, root);
    }
    let variants = variants(&schema);
    match value {
        Json::String(word) if !variants.is_empty() => word.clone(),
        Json::String(text) => quote(text),
        Json::Array(items) => list(items, &schema, root),
        Json::Object(entries) => match entries.iter().next() {
            Some((name, content)) if !variants.is_empty() => {
                let variant = variants.iter().find(|(known, _)| known == name);
                let schema = variant.and_then(|(_, schema)| *schema);
                let content =
                    schema.map_or_else(String::new, |schema| to_ron(content, schema, root));
                match content.starts_with('(') {
                    true => format!("{name}{content}"),
                    false => format!("{name}({content})"),
                }
            }
            _ => match schema.get("properties").and_then(Json::as_object) {
                Some(properties) => format!("({})", fields(entries, properties, root)),
                None => map(entries, &schema, root),
            },
        },
        other => other.to_string(),
    }
}

fn list(items: &[Json], schema: &Json, root: &Json) -> String {
    let fixed = schema.get("prefixItems").and_then(Json::as_array);
    fn limit(name: &str, schema: &Json) -> Option<u64> {
        schema.get(name).and_then(Json::as_u64)
    }
    let is_tuple = fixed.is_some()
        || limit("minItems", schema).is_some_and(|n| limit("maxItems", schema) == Some(n));
    let items = items
        .iter()
        .enumerate()
        .map(|(index, item)| {
            let schema = fixed.and_then(|fixed| fixed.get(index)).or_else(|| schema.get("items"));
            to_ron(item, schema.unwrap_or(&Json::Null), root)
        })
        .collect::<Vec<_>>()
        .join(", ");
    if is_tuple { format!("({items})") } else { format!("[{items}]") }
}

fn fields(values: &Map<String, Json>, properties: &Map<String, Json>, root: &Json) -> String {
    let fields = properties.iter().filter_map(|(name, schema)| {
        let value = values.get(name)?;
        let is_default = schema.get("default") == Some(value);
        (!is_default).then(|| format!("{name}: {}", to_ron(value, schema, root)))
    });
    fields.collect::<Vec<_>>().join(", ")
}

fn map(entries: &Map<String, Json>, schema: &Json, root: &Json) -> String {
    let content = schema.get("additionalProperties").unwrap_or(&Json::Null);
    let entries = entries.iter();
    let entries =
        entries.map(|(key, value)| format!("{}: {}", quote(key), to_ron(value, content, root)));
    format!("{{{}}}", entries.collect::<Vec<_>>().join(", "))
}

/// Quotes and escapes a text as a RON string.
pub fn quote(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' => quoted.push_str("\\\""),
            '\\' => quoted.push_str("\\\\"),
            '\n' => quoted.push_str("\\n"),
            '\r' => quoted.push_str("\\r"),
            '\t' => quoted.push_str("\\t"),
            c if c.is_control() => quoted.push_str(&format!("\\u{{{:x}}}", u32::from(c))),
            c => quoted.push(c),
        }
    }
    quoted + "\""
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn check(value: Json, schema: Json, expected: &str) {
        assert_eq!(to_ron(&value, &schema, &json!({})), expected);
        // Check the expected text itself with the crate `ron`.
        assert!(::ron::from_str::<::ron::Value>(expected).is_ok(), "{expected}");
    }

    #[test]
    fn words_texts_tuples_and_lists_are_distinguished() {
        check(json!("Up"), json!({"enum": ["Up", "Down"]}), "Up");
        check(json!("draft"), json!({"enum": ["draft", "fine"]}), "draft");
        check(json!("Up \"x\"\n"), json!({"type": "string"}), "\"Up \\\"x\\\"\\n\"");
        let pair = json!({"type": "array", "items": {}, "minItems": 2, "maxItems": 2});
        check(json!([1, 2.0]), pair, "(1, 2.0)");
        check(json!([]), json!({"type": "array", "items": {"type": "number"}}), "[]");
        check(json!(null), json!({"type": ["number", "null"]}), "None");
        check(json!(3.0), json!({"type": ["number", "null"]}), "3.0");
        check(
            json!({"a b": 1}),
            json!({"type": "object", "additionalProperties": {}}),
            "{\"a b\": 1}",
        );
    }

    #[test]
    fn a_variant_omits_fields_with_their_defaults() {
        let fields = json!({"type": "object", "properties": {"levels": {"default": 3}, "up": {}}});
        let choice = json!({"oneOf": [
            {"const": "Flat"},
            {"properties": {"Fine": fields}},
            {"properties": {"Share": {"type": "number"}}},
        ]});
        check(json!({"Fine": {"levels": 3, "up": 1}}), choice.clone(), "Fine(up: 1)");
        check(json!({"Fine": {"levels": 4}}), choice.clone(), "Fine(levels: 4)");
        check(json!({"Share": 90.0}), choice.clone(), "Share(90.0)");
        check(json!("Flat"), choice, "Flat");
    }
}
