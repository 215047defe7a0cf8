//! The recipe of a node: its type, parameters and files, but not the values of its inputs.

use std::path::PathBuf;

use maquette_syntax::FILE;
use maquette_value::Hash;
use maquette_value::fs::extension;
use serde_json::{Value as Json, json};

use crate::files::NodeFile;
use crate::tree::join_path;

/// The data of a node that do not depend on the values of its inputs. They are known as soon as the graph is read.
#[derive(Debug)]
pub struct Recipe {
    /// The name of the node type: `Threshold`.
    pub kind: String,
    /// The parameters of the node. Links are represented as `{"$link": slot}`, and files as `{"$file": path}`.
    pub parameters: Json,
    /// The hash of the type and the parameters. Paths of files do not affect it, except for their extensions.
    pub identity: Hash,
}

impl Recipe {
    pub fn new(kind: &str, parameters: Json, files: &[NodeFile]) -> Self {
        let optional = files.iter().filter(|file| !file.needed).map(|file| extension(&file.path));
        let content = json!([kind, without_paths(&parameters), Vec::from_iter(optional)]);
        let identity = Hash::compute(content.to_string().as_bytes());
        Self { kind: kind.to_owned(), parameters, identity }
    }

    /// Adds tests of inputs, each a slot and a property, to the hash. With tests, results exist only for inputs that pass them.
    pub(crate) fn with_guards(&self, tests: &[(usize, &str)]) -> Self {
        let content = json!([self.identity, tests]);
        let identity = Hash::compute(content.to_string().as_bytes());
        Self { kind: self.kind.clone(), parameters: self.parameters.clone(), identity }
    }

    /// Returns the files in the fields. Each has its path through the fields, such as `select.mask`, and the path of the file.
    pub fn files(&self) -> Vec<(String, PathBuf)> {
        let mut found = Vec::new();
        collect_files(&self.parameters, "", &mut found);
        found
    }

    /// Returns the parameters, in which each file path is reduced to its extension.
    pub(crate) fn without_paths(&self) -> Json {
        without_paths(&self.parameters)
    }
}

/// Returns parameters in which each file path is reduced to its extension.
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
