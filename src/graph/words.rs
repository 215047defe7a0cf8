//! All words that a graph file may hold beside the names of its author, for the documentation to be judged by.

use maquette_syntax::{resolve, variants};
use serde_json::Value as Json;

use super::{declaration, each, expectation, expression, patch, subgraphs, top};

/// A word of the language of graphs.
pub struct Word {
    /// The topic that explains it.
    pub topic: &'static str,
    /// In which call or field it stands; empty if anywhere.
    pub within: String,
    pub name: String,
}

/// The words that stand in one call or field.
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

/// The choices of a type, which stand in one field, and their fields, as its schema has them.
pub fn words_of_choices(topic: &'static str, within: &str, schema: &Json) -> Vec<Word> {
    let mut words = Vec::new();
    for (name, content) in variants(schema) {
        words.extend(words_in(topic, within, [name]));
        let content = content.map(|content| resolve(schema, content));
        words.extend(content.iter().flat_map(|content| words_of_fields(topic, name, content)));
    }
    words
}

/// The fields of a type, which stand in one call or field.
pub fn words_of_fields(topic: &'static str, within: &str, schema: &Json) -> Vec<Word> {
    let fields = schema.get("properties").and_then(Json::as_object).into_iter().flatten();
    words_in(topic, within, fields.map(|(name, _)| &name[..]))
}

/// The words of graphs and patches.
pub fn words() -> Vec<Word> {
    let mut words = words_in("graph", "Graph", top::FIELDS);
    words.extend(words_in("graph", "inputs", subgraphs::INPUT_FIELDS));
    words.extend(words_in("params", "params", declaration::TYPES));
    for kind in declaration::TYPES {
        words.extend(words_in("params", kind, declaration::fields_of(kind).iter().copied()));
    }
    words.extend(words_in("params", "", ["Param"]));
    words.extend(words_in("expr", "", ["Expr"]));
    words.extend(words_in("expr", "Expr", expression::function_names()));
    words.extend(words_in("foreach", "nodes", ["ForEach"]));
    words.extend(words_in("foreach", "ForEach", each::EACH));
    words.extend(words_in("switch", "nodes", ["Switch"]));
    words.extend(words_in("switch", "Switch", each::SWITCH));
    words.extend(words_in("patch", "Patch", patch::FIELDS));
    words.extend(words_of_choices("expect", "expect", &expectation::schema()));
    words
}
