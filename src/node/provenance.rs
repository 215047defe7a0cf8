//! Provenance: a description of the graph that made an output file. It is stored in the file, so that the file can be made again.
//!
//! The provenance depends only on the meaning of the graph: on the nodes needed for the output, the values of their parameters, and the
//! hashes of files. Comments, the order of nodes and unrelated nodes do not affect it. For privacy, it contains no path outside of the
//! project, no user name and no time.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

mod files;

pub use files::{
    EmbeddedProvenance, comment_of_obj, comment_of_ply, extras_of_glb, find, pad, sign,
};

/// The provenance of an output, in the form in which it is written to files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signature {
    /// The provenance as one line of ASCII JSON that does not contain `*/`.
    pub words: String,
    /// The first hexadecimal digits of the hash of `words`, for file formats with little space.
    pub hash: String,
}

/// A map sorted by name, so that the order of entries in the graph does not affect the provenance.
type SortedMap = BTreeMap<String, Json>;

/// Number of hexadecimal digits to which each hash is shortened. They distinguish hashes, but do not resist deliberate collisions.
const DIGITS: usize = 16;

/// The provenance of an output. Empty fields are omitted from files.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[doc(hidden)]
pub struct Provenance {
    /// The version of `maquette`.
    pub maquette: String,
    /// The path of the graph file, relative to its project.
    #[doc(hidden)]
    pub graph: String,
    /// The name of the output in the graph.
    #[doc(hidden)]
    pub output: String,
    /// True if the output was made with the draft value of each `Draft` in the graph, not the final value.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    #[doc(hidden)]
    pub draft: bool,
    /// A hash of the types, parameters and links of all nodes needed for the output.
    #[doc(hidden)]
    pub made: String,
    /// The values of the graph's parameters that may affect the output.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[doc(hidden)]
    pub parameters: SortedMap,
    /// The values of fields of nodes that were set by the option `--set`.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[doc(hidden)]
    pub set: SortedMap,
    /// The hashes of the values at the inputs of the graph.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[doc(hidden)]
    pub inputs: SortedMap,
    /// The hashes of the files that the nodes read, by their paths in the project.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[doc(hidden)]
    pub files: SortedMap,
    /// The hashes of the pinned results that were used, by the names of the nodes.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[doc(hidden)]
    pub pins: SortedMap,
    /// The packs that define the nodes, with their versions.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[doc(hidden)]
    pub packs: SortedMap,
}

impl Provenance {
    /// Returns the provenance as one line of ASCII JSON. It contains no characters that end a comment in any file format.
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
        serde_json::from_str(words).ok().filter(|provenance: &Self| !provenance.maquette.is_empty())
    }

    /// Returns the differences between this provenance, from a file, and the current one, as messages.
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
            // The data determine the number of elements of a `ForEach`, so different data can change the nodes of an unchanged graph.
            let is_of_same = (&self.files, &self.inputs) == (&now.files, &now.inputs);
            changes.push(match is_of_same {
                true => "the graph changed".into(),
                false => "the graph changed, or how many elements its data have".into(),
            });
        }
        changes
    }
}

/// Shortens a hash to its first hexadecimal digits.
#[doc(hidden)]
pub fn shorten_hash(hash: &str) -> String {
    hash.chars().take(DIGITS).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn words_are_one_line_without_end_of_comment() {
        let provenance_of = Provenance {
            maquette: "0.1.0".into(),
            output: "Größe*/\n.glb".into(),
            parameters: SortedMap::from_iter([("growth".to_owned(), json!(12.0))]),
            ..Provenance::default()
        };
        let words = provenance_of.words();
        assert!(words.is_ascii() && !words.contains("*/") && !words.contains('\n'), "{words}");
        assert_eq!(Provenance::read(&words), Some(provenance_of));
        assert_eq!(Provenance::read("{}"), None);
    }

    #[test]
    fn changes_are_listed() {
        fn provenance(growth: f64, made: &str) -> Provenance {
            Provenance {
                parameters: SortedMap::from_iter([("growth".to_owned(), json!(growth))]),
                made: made.to_owned(),
                ..Provenance::default()
            }
        }
        assert_eq!(provenance(1.0, "a").changes(&provenance(1.0, "a")), [""; 0]);
        let expected = ["parameter `growth` was 1.0, now 2.0", "the graph changed"];
        assert_eq!(provenance(1.0, "a").changes(&provenance(2.0, "b")), expected);
        // With other data, the number of elements of a `ForEach` may differ too.
        let files = SortedMap::from_iter([("scan.ply".to_owned(), json!("00ff"))]);
        let other = Provenance { files, ..provenance(1.0, "b") };
        let expected = [
            "file `scan.ply` was not there",
            "the graph changed, or how many elements its data have",
        ];
        assert_eq!(provenance(1.0, "a").changes(&other), expected);
    }
}
