//! Where a file came from: what an output tells of the graph that it was made by, so that it can be made again.
//!
//! It is a function of the graph's meaning: what the output hangs on, the values of the parameters that shape that, and hashes of
//! files. So a comment, another order or another node changes no byte of it, and no path outside of the project, user or time is in it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

mod files;

pub use files::{Found, comment_of_obj, comment_of_ply, extras_of_glb, find, padded, sign};

/// What is put into the files of an output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signature {
    /// Where the value came from: one line of JSON, in ASCII, in which no comment `/* .. */` ends.
    pub words: String,
    /// The beginning of the hash of the words, in hexadecimal digits, for files with little room.
    pub hash: String,
}

/// By name, so that no order of a graph counts.
type Sorted = BTreeMap<String, Json>;

/// So many digits of a hash are told: enough to tell two apart, not to withstand somebody who wants them equal.
const DIGITS: usize = 16;

/// What is told of an output. What does not apply is left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[doc(hidden)]
pub struct Provenance {
    /// The engine's version.
    pub maquette: String,
    /// The graph's file, within its project.
    #[doc(hidden)]
    pub graph: String,
    /// The output's name.
    #[doc(hidden)]
    pub output: String,
    /// Whether it is a draft.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    #[doc(hidden)]
    pub draft: bool,
    /// The hash of what the output hangs on: types of nodes, their parameters, and their links.
    #[doc(hidden)]
    pub made: String,
    /// The values of the graph's parameters that may shape it.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[doc(hidden)]
    pub parameters: Sorted,
    /// Values of nodes' fields from `--set`.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[doc(hidden)]
    pub set: Sorted,
    /// Hashes of the values at the graph's inputs.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[doc(hidden)]
    pub inputs: Sorted,
    /// Hashes of the files that were read, by their paths in the project.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[doc(hidden)]
    pub files: Sorted,
    /// Hashes of the results that were pinned, by their nodes.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[doc(hidden)]
    pub pins: Sorted,
    /// The packs of the nodes, and their versions.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[doc(hidden)]
    pub packs: Sorted,
}

impl Provenance {
    /// As it stands in files: one line of JSON, in ASCII, in which no comment of any format ends.
    #[doc(hidden)]
    pub fn words(&self) -> String {
        let json = serde_json::to_string(self).unwrap_or_default();
        let mut words = String::with_capacity(json.len());
        for c in json.chars() {
            match c {
                '/' if words.ends_with('*') => words += "\\/",
                c if c.is_ascii() => words.push(c),
                c => c.encode_utf16(&mut [0; 2]).iter().for_each(|unit| {
                    words += &format!("\\u{unit:04x}");
                }),
            }
        }
        words
    }

    #[doc(hidden)]
    pub fn read(words: &str) -> Option<Self> {
        serde_json::from_str(words).ok().filter(|told: &Self| !told.maquette.is_empty())
    }

    /// What of the file's provenance is another one now, in words.
    #[doc(hidden)]
    pub fn changes(&self, now: &Self) -> Vec<String> {
        let mut changes = Vec::new();
        if self.maquette != now.maquette {
            changes.push(format!("maquette {} made it, this is {}", self.maquette, now.maquette));
        }
        for (what, before, now) in [
            ("pack", &self.packs, &now.packs),
            ("file", &self.files, &now.files),
            ("input", &self.inputs, &now.inputs),
            ("pin", &self.pins, &now.pins),
            ("parameter", &self.parameters, &now.parameters),
        ] {
            for (name, before) in before {
                match now.get(name) {
                    Some(now) if now == before => {}
                    Some(now) => changes.push(format!("{what} `{name}` was {before}, now {now}")),
                    None => changes.push(format!("{what} `{name}` is not there any more")),
                }
            }
            let new = now.keys().filter(|name| !before.contains_key(*name));
            changes.extend(new.map(|name| format!("{what} `{name}` was not there")));
        }
        if self.made != now.made {
            // As many nodes are made of a graph as its data have elements.
            let is_of_same = (&self.files, &self.inputs) == (&now.files, &now.inputs);
            changes.push(match is_of_same {
                true => "the graph changed".into(),
                false => "the graph changed, or how many elements its data have".into(),
            });
        }
        changes
    }
}

/// The beginning of a hash.
#[doc(hidden)]
pub fn short(hash: &str) -> String {
    hash.chars().take(DIGITS).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn words_are_one_line_that_ends_no_comment_and_read_back() {
        let told = Provenance {
            maquette: "0.1.0".into(),
            output: "Größe*/\n.glb".into(),
            parameters: Sorted::from_iter([("growth".to_owned(), json!(12.0))]),
            ..Provenance::default()
        };
        let words = told.words();
        assert!(words.is_ascii() && !words.contains("*/") && !words.contains('\n'), "{words}");
        assert_eq!(Provenance::read(&words), Some(told));
        assert_eq!(Provenance::read("{}"), None);
    }

    #[test]
    fn what_changed_is_named() {
        fn told(growth: f64, made: &str) -> Provenance {
            Provenance {
                parameters: Sorted::from_iter([("growth".to_owned(), json!(growth))]),
                made: made.to_owned(),
                ..Provenance::default()
            }
        }
        assert_eq!(told(1.0, "a").changes(&told(1.0, "a")), [""; 0]);
        let expected = ["parameter `growth` was 1.0, now 2.0", "the graph changed"];
        assert_eq!(told(1.0, "a").changes(&told(2.0, "b")), expected);
        // Other data may have other elements.
        let files = Sorted::from_iter([("scan.ply".to_owned(), json!("00ff"))]);
        let other = Provenance { files, ..told(1.0, "b") };
        let expected = [
            "file `scan.ply` was not there",
            "the graph changed, or how many elements its data have",
        ];
        assert_eq!(told(1.0, "a").changes(&other), expected);
    }
}
