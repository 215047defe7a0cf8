//! Steps through a JSON schema. What need not be another schema is lent as it lies there: a graph takes these steps for each of its
//! fields.

use std::borrow::Cow;

use serde_json::Value as Json;

/// The schema behind a reference, with what stands beside the reference on top; itself if it refers to nothing.
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

/// A schema that says the same without words beside references: what both say stands there, so that steps through it copy nothing.
pub fn merged(schema: &Json) -> Json {
    merged_within(schema, schema, &mut Vec::new())
}

/// `open` are the references that it stands in: what refers to itself is not written out without an end.
fn merged_within(root: &Json, schema: &Json, open: &mut Vec<String>) -> Json {
    let entries = match schema {
        Json::Object(entries) => entries,
        Json::Array(items) => {
            return items.iter().map(|item| merged_within(root, item, open)).collect();
        }
        plain => return plain.clone(),
    };
    fn inside(
        (key, value): (&String, &Json),
        open: &mut Vec<String>,
        root: &Json,
    ) -> (String, Json) {
        (key.clone(), merged_within(root, value, open))
    }
    let target = schema.get("$ref").and_then(Json::as_str).filter(|_| 1 < entries.len());
    let Some(target) = target else {
        return entries.iter().map(|entry| inside(entry, open, root)).collect();
    };
    if open.iter().any(|known| known == target) {
        return schema.clone();
    }
    open.push(target.to_owned());
    let both = resolve(root, schema);
    let entries = both.as_object().into_iter().flatten();
    let merged = entries.map(|entry| inside(entry, open, root)).collect();
    open.pop();
    merged
}

/// The schema inside an `Option`, if it is one.
pub fn inside_option(schema: &Json) -> Option<Cow<'_, Json>> {
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

/// The schema of what a field takes, without the reference to it and without what says that it may be left out.
pub fn inside<'s>(schema: &'s Json, root: &'s Json) -> Cow<'s, Json> {
    let owned = |inner: Cow<'_, Json>| resolve(root, &inner).into_owned();
    match resolve(root, schema) {
        Cow::Borrowed(schema) => match inside_option(schema) {
            Some(Cow::Borrowed(inner)) => resolve(root, inner),
            Some(inner) => Cow::Owned(owned(inner)),
            None => Cow::Borrowed(schema),
        },
        Cow::Owned(schema) => {
            let inner = inside_option(&schema).map(owned);
            Cow::Owned(inner.unwrap_or(schema))
        }
    }
}

/// The choices of an enum: names, and the schema of what stands in parentheses behind them.
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
    fn what_lies_in_a_schema_is_lent() {
        let root = json!({ "$defs": { "Side": { "enum": ["Left", "Right"] } } });
        fn is_lent(schema: &Json, root: &Json) -> bool {
            matches!(inside(schema, &root), Cow::Borrowed(_))
        }
        let [plain, named] = [json!({ "type": "number" }), json!({ "$ref": "#/$defs/Side" })];
        fn option(inner: &Json) -> Json {
            json!({ "anyOf": [inner, { "type": "null" }] })
        }
        for schema in [&plain, &named, &option(&plain), &option(&named)] {
            assert!(is_lent(schema, &root), "{schema}");
        }
        assert_eq!(*inside(&option(&named), &root), root["$defs"]["Side"]);
        assert_eq!(variants(&inside(&named, &root)), [("Left", None), ("Right", None)]);
        let or_null = json!({ "type": ["integer", "null"], "minimum": 1 });
        assert_eq!(*inside(&or_null, &root), json!({ "type": "integer", "minimum": 1 }));
        let told = json!({ "$ref": "#/$defs/Side", "default": "Left" });
        let whole = json!({ "enum": ["Left", "Right"], "default": "Left" });
        assert_eq!(*inside(&told, &root), whole);
        assert_eq!(*inside(&option(&told), &root), whole);
    }

    #[test]
    fn a_merged_schema_says_the_same_and_is_lent() {
        let (told, side) = (
            json!({ "$ref": "#/$defs/Side", "default": "Left" }),
            json!({ "enum": ["Left", "Right"] }),
        );
        let chain = json!({ "$ref": "#/$defs/Chain", "unit": "mm" });
        let root = json!({
            "properties": { "told": told, "several": [{ "anyOf": [told, { "type": "null" }] }], "chain": chain },
            "$defs": { "Side": side, "Chain": { "properties": { "next": chain, "side": told } } },
        });
        let now = merged(&root);
        for way in [
            "/properties/told",
            "/properties/several/0",
            "/properties/chain/properties/side",
            "/$defs/Chain/properties/side",
        ] {
            let schema = inside(now.pointer(way).expect(way), &now);
            assert!(matches!(schema, Cow::Borrowed(_)), "{way}");
            assert_eq!(*schema, json!({ "enum": ["Left", "Right"], "default": "Left" }), "{way}");
        }
        // It refers to itself, which is written out once.
        let next = now.pointer("/properties/chain/properties/next");
        assert_eq!(next, Some(&chain));
        assert_eq!(now["properties"]["chain"]["unit"], "mm");
    }
}
