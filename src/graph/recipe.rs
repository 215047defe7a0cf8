//! The recipe of a node: the properties that do not depend on the node's inputs.

use std::path::PathBuf;

use maquette_syntax::FILE;
use maquette_value::Hash;
use maquette_value::fs::extension;
use serde_json::{Value as Json, json};

use crate::files::NodeFile;
use crate::tree::join_path;

/// The properties of a node that do not depend on the node's inputs. They are known when the graph is read.
#[derive(Debug)]
pub struct Recipe {
    /// The name of the node type: `Threshold`.
    pub kind: String,
    /// The parameters of the node. Links are represented as `{"$link": slot}`, and files as `{"$file": path}`.
    pub parameters: Json,
    /// The hash of the type and the parameters. Only the extensions of file paths are included.
    pub identity: Hash,
}

impl Recipe {
    pub fn new(kind: &str, parameters: Json, files: &[NodeFile]) -> Self {
        let optional = files.iter().filter(|file| !file.needed).map(|file| extension(&file.path));
        let content = json!([kind, without_paths(&parameters), Vec::from_iter(optional)]);
        let identity = Hash::compute(content.to_string().as_bytes());
        Self { kind: kind.to_owned(), parameters, identity }
    }

    /// Adds tests of inputs to the hash, by slots and properties, because the results are those of inputs that pass the tests.
    pub(crate) fn with_guards(&self, tests: &[(usize, &str)]) -> Self {
        let content = json!([self.identity, tests]);
        let identity = Hash::compute(content.to_string().as_bytes());
        Self { kind: self.kind.clone(), parameters: self.parameters.clone(), identity }
    }

    /// Returns the files in the fields. With each comes its path through the fields: `color`, `select.mask`.
    pub fn files(&self) -> Vec<(String, PathBuf)> {
        let mut found = Vec::new();
        collect_files(&self.parameters, "", &mut found);
        found
    }

    /// Returns the parameters with only the extensions of file paths.
    pub(crate) fn without_paths(&self) -> Json {
        without_paths(&self.parameters)
    }
}

/// Returns the parameters with only the extensions of file paths.
fn without_paths(field: &Json) -> Json {
    match field {
        Json::Object(entries) => match entries.get(FILE).and_then(Json::as_str) {
            Some(path) => json!({ FILE: extension(path.as_ref()) }),
            None => Json::Object(
                entries
                    .iter()
                    .map(|(name, value): (&String, &Json)| (name.clone(), without_paths(value)))
                    .collect(),
            ),
        },
        Json::Array(items) => items.iter().map(without_paths).collect(),
        plain => plain.clone(),
    }
}

fn collect_files(value: &Json, path: &str, found: &mut Vec<(String, PathBuf)>) {
    match value {
        Json::Object(fields) => match fields.get(FILE).and_then(Json::as_str) {
            Some(file) => found.push((path.to_owned(), file.into())),
            None => {
                for (name, value) in fields {
                    collect_files(value, &join_path(path, name), found);
                }
            }
        },
        Json::Array(items) => {
            for (index, item) in items.iter().enumerate() {
                collect_files(item, &join_path(path, &index.to_string()), found);
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_extension_of_a_path_counts() {
        let [one, other, jpg] = ["/a/color.png", "/b/other.PNG", "/a/color.jpg"]
            .map(|path| Recipe::new("Threshold", json!({ "path": { FILE: path } }), &[]).identity);
        assert_eq!(one, other);
        assert_ne!(one, jpg);
    }
}
