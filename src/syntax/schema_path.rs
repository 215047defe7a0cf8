//! Navigation in a JSON schema. Results are borrowed if possible, because checking a graph navigates in the schema for each field.

use std::borrow::Cow;

use serde_json::Value as Json;

/// Resolves the reference `$ref` in a schema. Keywords next to the reference override those of the target. A schema without a reference is
/// returned unchanged.
pub fn resolve<'s>(root: &'s Json, schema: &'s Json) -> Cow<'s, Json> {
    let Some(target) = schema.get("$ref").and_then(Json::as_str) else {
        return Cow::Borrowed(schema);
    };
    let name = target.rsplit('/').next().unwrap_or_default();
    let mut resolved = Cow::Borrowed(&root["$defs"][name]);
    let beside = schema.as_object().into_iter().flatten().filter(|(key, _)| *key != "$ref");
    for (key, value) in beside {
        if resolved.is_object() {
            resolved.to_mut()[key] = value.clone();
        }
    }
    resolved
}

/// Returns an equivalent schema in which no keywords are next to a reference, so that navigation need not clone parts of the schema.
pub fn merge_references(schema: &Json) -> Json {
    merge_nested(schema, schema, &mut Vec::new())
}

/// Merges keywords next to references into the targets. `open` holds the references that are being merged, so that the merge of a recursive
/// schema ends.
fn merge_nested(root: &Json, schema: &Json, open: &mut Vec<String>) -> Json {
    let entries = match schema {
        Json::Object(entries) => entries,
        Json::Array(items) => {
            return items.iter().map(|item| merge_nested(root, item, open)).collect();
        }
        plain => return plain.clone(),
    };
    fn merge_entry(
        (key, value): (&String, &Json),
        open: &mut Vec<String>,
        root: &Json,
    ) -> (String, Json) {
        (key.clone(), merge_nested(root, value, open))
    }
    let target = schema.get("$ref").and_then(Json::as_str).filter(|_| 1 < entries.len());
    let Some(target) = target else {
        return entries.iter().map(|entry| merge_entry(entry, open, root)).collect();
    };
    if open.iter().any(|known| known == target) {
        return schema.clone();
    }
    open.push(target.to_owned());
    let both = resolve(root, schema);
    let entries = both.as_object().into_iter().flatten();
    let merged = entries.map(|entry| merge_entry(entry, open, root)).collect();
    open.pop();
    merged
}

/// Returns the schema of `T` for a schema of `Option<T>`. `None` for other schemas.
pub fn option_inner(schema: &Json) -> Option<Cow<'_, Json>> {
    fn is_null(schema: &Json) -> bool {
        schema.get("type").and_then(Json::as_str) == Some("null")
    }
    if let Some(any) = schema.get("anyOf").and_then(Json::as_array) {
        let inner: Vec<&Json> = any.iter().filter(|schema| !is_null(schema)).collect();
        return match inner[..] {
            [inner] if any.len() == 2 => Some(Cow::Borrowed(inner)),
            _ => None,
        };
    }
    let types = schema.get("type").and_then(Json::as_array)?;
    let inner = types.iter().find(|kind| kind.as_str() != Some("null"))?;
    let mut schema = schema.clone();
    schema["type"] = inner.clone();
    if let Some(Json::Array(choices)) = schema.get_mut("enum") {
        choices.retain(|choice| !choice.is_null());
    }
    Some(Cow::Owned(schema))
}

/// Returns the schema of the value of a field. References are resolved, and the `null` of an optional field is removed.
pub fn resolve_field<'s>(schema: &'s Json, root: &'s Json) -> Cow<'s, Json> {
    let owned = |inner: Cow<'_, Json>| resolve(root, &inner).into_owned();
    match resolve(root, schema) {
        Cow::Borrowed(schema) => match option_inner(schema) {
            Some(Cow::Borrowed(inner)) => resolve(root, inner),
            Some(inner) => Cow::Owned(owned(inner)),
            None => Cow::Borrowed(schema),
        },
        Cow::Owned(schema) => {
            let inner = option_inner(&schema).map(owned);
            Cow::Owned(inner.unwrap_or(schema))
        }
    }
}

/// Returns the variants of an enum: their names, and the schemas of the contents of their parentheses.
pub fn variants(schema: &Json) -> Vec<(&str, Option<&Json>)> {
    let Some(choices) = schema.get("oneOf").and_then(Json::as_array) else {
        return words(schema).collect();
    };
    let mut variants = Vec::new();
    for choice in choices {
        variants.extend(words(choice));
        let content = choice.get("properties").and_then(Json::as_object).into_iter().flatten();
        variants.extend(content.map(|(name, content)| (&name[..], Some(content))));
    }
    variants
}

fn words(schema: &Json) -> impl Iterator<Item = (&str, Option<&Json>)> {
    let one = schema.get("const").into_iter();
    let several = schema.get("enum").and_then(Json::as_array).into_iter().flatten();
    one.chain(several).filter_map(Json::as_str).map(|word| (word, None))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn parts_of_a_schema_are_borrowed() {
        let root = json!({ "$defs": { "Side": { "enum": ["Left", "Right"] } } });
        fn is_lent(schema: &Json, root: &Json) -> bool {
            matches!(resolve_field(schema, root), Cow::Borrowed(_))
        }
        let [plain, named] = [json!({ "type": "number" }), json!({ "$ref": "#/$defs/Side" })];
        fn option(inner: &Json) -> Json {
            json!({ "anyOf": [inner, { "type": "null" }] })
        }
        for schema in [&plain, &named, &option(&plain), &option(&named)] {
            assert!(is_lent(schema, &root), "{schema}");
        }
        assert_eq!(*resolve_field(&option(&named), &root), root["$defs"]["Side"]);
        assert_eq!(variants(&resolve_field(&named, &root)), [("Left", None), ("Right", None)]);
        let or_null = json!({ "type": ["integer", "null"], "minimum": 1 });
        assert_eq!(*resolve_field(&or_null, &root), json!({ "type": "integer", "minimum": 1 }));
        let with_default = json!({ "$ref": "#/$defs/Side", "default": "Left" });
        let whole = json!({ "enum": ["Left", "Right"], "default": "Left" });
        assert_eq!(*resolve_field(&with_default, &root), whole);
        assert_eq!(*resolve_field(&option(&with_default), &root), whole);
    }

    #[test]
    fn a_merged_schema_is_equivalent_and_borrowed() {
        let (with_default, side) = (
            json!({ "$ref": "#/$defs/Side", "default": "Left" }),
            json!({ "enum": ["Left", "Right"] }),
        );
        let chain = json!({ "$ref": "#/$defs/Chain", "unit": "mm" });
        let root = json!({
            "properties": { "with_default": with_default, "several": [{ "anyOf": [with_default, { "type": "null" }] }], "chain": chain },
            "$defs": { "Side": side, "Chain": { "properties": { "next": chain, "side": with_default } } },
        });
        let now = merge_references(&root);
        for way in [
            "/properties/with_default",
            "/properties/several/0",
            "/properties/chain/properties/side",
            "/$defs/Chain/properties/side",
        ] {
            let schema = resolve_field(now.pointer(way).expect(way), &now);
            assert!(matches!(schema, Cow::Borrowed(_)), "{way}");
            assert_eq!(*schema, json!({ "enum": ["Left", "Right"], "default": "Left" }), "{way}");
        }
        // The schema refers to itself. It is expanded once, and the inner reference is kept.
        let next = now.pointer("/properties/chain/properties/next");
        assert_eq!(next, Some(&chain));
        assert_eq!(now["properties"]["chain"]["unit"], "mm");
    }
}
