//! The identity of a node's result: what it would be computed from.
//!
//! The key is made of the hashes of the input *values*, not of the inputs' keys: a node that is computed anew and gives an equal
//! value leaves every key below it as it was, and the wave stops there with no second mechanism. The price is one pass over
//! each new value.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::Value as Json;

use crate::graph::GraphNode;
use crate::node::{FILE, File, LINK, ending};
use crate::value::{AnyValue, Hash};

/// What a node is computed from, field by field.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct KeyParts {
    kind: String,
    fields: Vec<Part>,
}

#[derive(Clone, Debug, PartialEq)]
struct Part {
    name: String,
    what: What,
    /// The field in canonical JSON, with links and files replaced by hashes.
    content: String,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum What {
    Parameter,
    Input,
    File,
}

impl KeyParts {
    pub(super) fn new(
        node: &GraphNode,
        inputs: &[AnyValue],
        files: &BTreeMap<PathBuf, Option<File>>,
    ) -> Self {
        let mut fields = Vec::new();
        for (name, field) in node.parameters.as_object().into_iter().flatten() {
            let mut what = What::Parameter;
            let content = canonical(field, inputs, files, &mut what).to_string();
            fields.push(Part { name: name.clone(), what, content });
        }
        for path in node.node.files() {
            let content = content_of(path.resolved(), files);
            let name = ending_name(path.resolved());
            fields.push(Part { name, what: What::File, content });
        }
        Self { kind: node.kind.clone(), fields }
    }

    pub(super) fn key(&self) -> Hash {
        let mut text = self.kind.clone();
        for part in &self.fields {
            text.extend(["\n", &part.name, "=", &part.content]);
        }
        Hash::of(text.as_bytes())
    }

    /// The first part that differs from what the node was computed from before, in words.
    pub(super) fn difference(&self, before: &Self) -> String {
        if self.kind != before.kind {
            return format!("it was {} before", crate::graph::with_article(&before.kind));
        }
        let changed = self.fields.iter().find(|part| !before.fields.contains(part));
        match changed {
            Some(Part { name, what: What::Parameter, .. }) => format!("parameter `{name}` changed"),
            Some(Part { name, what: What::Input, .. }) => format!("input `{name}` changed"),
            Some(Part { name, what: What::File, .. }) => format!("file `{name}` changed"),
            None => "its result is no longer in the cache".into(),
        }
    }
}

fn ending_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The field with links replaced by the hashes of their values, and files by the hashes of their contents.
fn canonical(
    field: &Json,
    inputs: &[AnyValue],
    files: &BTreeMap<PathBuf, Option<File>>,
    what: &mut What,
) -> Json {
    match field {
        Json::Object(entries) => {
            if let Some(slot) = entries.get(LINK).and_then(Json::as_u64) {
                *what = What::Input;
                let value = inputs.get(slot as usize);
                return value.map_or(Json::Null, |value| value.hash().to_string().into());
            }
            if let Some(path) = entries.get(FILE).and_then(Json::as_str) {
                *what = What::File;
                return content_of(Path::new(path), files).into();
            }
            let entry = |(name, value): (&String, &Json)| {
                (name.clone(), canonical(value, inputs, files, what))
            };
            Json::Object(entries.iter().map(entry).collect())
        }
        Json::Array(items) => {
            items.iter().map(|item| canonical(item, inputs, files, what)).collect()
        }
        plain => plain.clone(),
    }
}

/// A file's content hash and ending, in which alone its path matters.
fn content_of(path: &Path, files: &BTreeMap<PathBuf, Option<File>>) -> String {
    match files.get(path) {
        Some(Some(file)) => format!("{} {}", file.hash, ending(path)),
        _ => "absent".into(),
    }
}
