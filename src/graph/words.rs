//! All keywords and field names of graph files. A test checks that the documentation covers them.

use maquette_syntax::{resolve, variants};
use serde_json::Value as Json;

use super::{declaration, expectation, expression, for_each, header, patch, subgraphs};

/// A keyword or field name of graph files.
pub struct Word {
    /// The topic of `maquette help` that explains the word.
    pub topic: &'static str,
    /// The call or field that contains the word. Empty if the word can occur anywhere.
    pub within: String,
    pub name: String,
}

/// Returns the words of one call or field.
pub(crate) fn words_in<'a>(
    topic: &'static str,
    within: &str,
    names: impl IntoIterator<Item = &'a str>,
) -> Vec<Word> {
    names
        .into_iter()
        .map(|name| Word { topic, within: within.to_owned(), name: name.to_owned() })
        .collect()
}

/// Returns the choices that a schema allows, with their fields.
pub fn words_of_choices(topic: &'static str, within: &str, schema: &Json) -> Vec<Word> {
    let mut words = Vec::new();
    for (name, content) in variants(schema) {
        words.extend(words_in(topic, within, [name]));
        let content = content.map(|content| resolve(schema, content));
        words.extend(content.iter().flat_map(|content| words_of_fields(topic, name, content)));
    }
    words
}

/// Returns the fields that a schema has, as words of graph files.
pub fn words_of_fields(topic: &'static str, within: &str, schema: &Json) -> Vec<Word> {
    let fields = schema.get("properties").and_then(Json::as_object).into_iter().flatten();
    words_in(topic, within, fields.map(|(name, _)| &name[..]))
}

/// Returns the words that graphs and patches can contain.
pub fn words() -> Vec<Word> {
    let mut words = words_in("graph", "Graph", header::FIELDS);
    words.extend(words_in("graph", "inputs", subgraphs::INPUT_FIELDS));
    words.extend(words_in("params", "params", declaration::TYPES));
    for kind in declaration::TYPES {
        words.extend(words_in("params", kind, declaration::fields_of(kind).iter().copied()));
    }
    words.extend(words_in("params", "", ["Param"]));
    words.extend(words_in("expr", "", ["Expr"]));
    words.extend(words_in("expr", "Expr", expression::function_names()));
    words.extend(words_in("foreach", "nodes", ["ForEach"]));
    words.extend(words_in("foreach", "ForEach", for_each::FOR_EACH_FIELDS));
    words.extend(words_in("switch", "nodes", ["Switch"]));
    words.extend(words_in("switch", "Switch", for_each::SWITCH_FIELDS));
    words.extend(words_in("patch", "Patch", patch::FIELDS));
    words.extend(words_of_choices("expect", "expect", &expectation::schema()));
    words
}
