//! What a node of a graph is, apart from what comes in.

use std::path::PathBuf;

use maquette_syntax::FILE;
use maquette_value::Hash;
use maquette_value::plain::ending;
use serde_json::{Value as Json, json};

use crate::files::NodeFile;

/// What a node is, apart from what comes in: all that is known when its graph is read.
#[derive(Debug)]
pub struct Recipe {
    /// The type's name: `Threshold`.
    pub kind: String,
    /// Its parameters, with links as `{"$link": slot}` and files as `{"$file": path}`.
    pub parameters: Json,
    /// The hash of both, in which of a file's path only the ending counts.
    pub identity: Hash,
}

impl Recipe {
    pub fn new(kind: &str, parameters: Json, files: &[NodeFile]) -> Self {
        let optional = files.iter().filter(|file| !file.needed).map(|file| ending(&file.path));
        let content = json!([kind, without_paths(&parameters), Vec::from_iter(optional)]);
        let identity = Hash::of(content.to_string().as_bytes());
        Self { kind: kind.to_owned(), parameters, identity }
    }

    /// The same with tests of what comes in, by slots and properties: its results are of values that have passed them.
    pub(crate) fn guarded(&self, tests: &[(usize, &str)]) -> Self {
        let content = json!([self.identity, tests]);
        let identity = Hash::of(content.to_string().as_bytes());
        Self { kind: self.kind.clone(), parameters: self.parameters.clone(), identity }
    }

    /// The files that its fields name, each with the way there: `color`, `select.mask`.
    pub fn files(&self) -> Vec<(String, PathBuf)> {
        fn collect(field: &Json, way: &str, found: &mut Vec<(String, PathBuf)>) {
            fn inside(step: &str, value: &Json, way: &str, found: &mut Vec<(String, PathBuf)>) {
                let way = if way.is_empty() { step.to_owned() } else { format!("{way}.{step}") };
                collect(value, &way, found);
            }
            match field {
                Json::Object(entries) => match entries.get(FILE).and_then(Json::as_str) {
                    Some(path) => found.push((way.to_owned(), path.into())),
                    None => {
                        entries.iter().for_each(|(name, value)| inside(name, value, way, found))
                    }
                },
                Json::Array(items) => {
                    items
                        .iter()
                        .enumerate()
                        .for_each(|(nth, item)| inside(&nth.to_string(), item, way, found));
                }
                _ => {}
            }
        }
        let mut found = Vec::new();
        collect(&self.parameters, "", &mut found);
        found
    }

    /// Its parameters with nothing but the ending of each file's path.
    pub(crate) fn without_paths(&self) -> Json {
        without_paths(&self.parameters)
    }
}

/// The parameters with nothing but the ending of each file's path.
fn without_paths(field: &Json) -> Json {
    match field {
        Json::Object(entries) => match entries.get(FILE).and_then(Json::as_str) {
            Some(path) => json!({ FILE: ending(path.as_ref()) }),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_counts_by_its_ending_alone() {
        let of =
            |path: &str| Recipe::new("Threshold", json!({ "path": { FILE: path } }), &[]).identity;
        assert_eq!(of("/a/color.png"), of("/b/other.PNG"));
        assert_ne!(of("/a/color.png"), of("/a/color.jpg"));
    }
}
