//! The files that a node names, and what was read of them.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_syntax::FILE;
use maquette_syntax::error::Error;
use maquette_value::Hash;
use maquette_value::plain::{ending, without_mark};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use serde_json::json;

/// A file that a node reads: a path relative to the graph's file. Empty means none.
///
/// The evaluator reads it; its content, not its path, is part of the node's key.
///
/// A field that takes only files of certain endings says so, and the check refuses all others before anything runs:
/// `#[schemars(extend("endings" = ["obj", "ply"]))]`, in lower case, without the dot; `extend("reads" = "Mesh")` stands for those
/// from which the program's packs read that type of values.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FilePath {
    #[doc(hidden)]
    given: String,
    resolved: PathBuf,
}

impl FilePath {
    /// Whether no file is named.
    pub fn is_empty(&self) -> bool {
        self.given.is_empty()
    }

    /// The path as the graph has it.
    pub fn given(&self) -> &str {
        &self.given
    }

    /// The file of that name in the same folder.
    #[must_use]
    pub fn beside(&self, name: &str) -> Self {
        let given = Path::new(&self.given).with_file_name(name);
        Self {
            given: given.to_string_lossy().into_owned(),
            resolved: self.resolved.with_file_name(name),
        }
    }

    #[doc(hidden)]
    pub fn resolved(&self) -> &Path {
        &self.resolved
    }
}

impl Serialize for FilePath {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if self.is_empty() {
            return "".serialize(serializer);
        }
        json!({ FILE: self.resolved.to_string_lossy() }).serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for FilePath {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Paths;
        impl<'de> de::Visitor<'de> for Paths {
            type Value = FilePath;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a path")
            }

            fn visit_str<E: de::Error>(self, path: &str) -> Result<FilePath, E> {
                Ok(FilePath { given: path.to_owned(), resolved: path.into() })
            }

            fn visit_seq<A: de::SeqAccess<'de>>(self, mut paths: A) -> Result<FilePath, A::Error> {
                let mut next =
                    || paths.next_element::<String>()?.ok_or_else(|| de::Error::custom("no path"));
                Ok(FilePath { given: next()?, resolved: next()?.into() })
            }
        }
        deserializer.deserialize_newtype_struct(FILE, Paths)
    }
}

impl JsonSchema for FilePath {
    fn schema_name() -> Cow<'static, str> {
        "FilePath".into()
    }

    fn inline_schema() -> bool {
        true
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string", "format": "file" })
    }
}

/// A file that the evaluator has read for a node.
#[derive(Clone, Debug)]
pub struct File {
    #[doc(hidden)]
    pub name: String,
    #[doc(hidden)]
    pub bytes: Arc<[u8]>,
    /// The files that it names, by name, or why they cannot be had.
    #[doc(hidden)]
    pub companions: Arc<Companions>,
    /// Of its content, and of that of its companions.
    #[doc(hidden)]
    pub hash: Hash,
}

/// Files that a file names, as its format does for materials and pictures: by name, with their contents or why they cannot be had.
#[doc(hidden)]
pub type Companions = BTreeMap<String, Result<Arc<[u8]>, String>>;

impl File {
    /// The path as the graph has it, for messages.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its content, of a text without the mark of UTF-8 (EF BB BF, a "BOM") with which some editors begin it.
    pub fn bytes(&self) -> &[u8] {
        without_mark(&self.bytes)
    }

    /// The content of a file that this one names, by a path relative to its folder: the materials of an OBJ file and their picture.
    ///
    /// # Errors
    /// If there is no such file, or it may not be read; the text says which.
    pub fn companion(&self, name: &str) -> Result<Arc<[u8]>, String> {
        let found = self.companions.get(name).cloned();
        found.unwrap_or_else(|| Err(format!("{} does not name `{name}`", self.name)))
    }

    /// What `read` makes of its content; an error names the file, which may be given from outside of the graph.
    ///
    /// # Errors
    /// Those of `read`.
    pub fn read<T, E: Into<Error>>(
        &self,
        read: impl FnOnce(&[u8]) -> Result<T, E>,
    ) -> Result<T, Error> {
        read(self.bytes()).map_err(|error| error.into().in_file(&self.name))
    }

    /// What stands behind the last dot of its name, in lower case; empty if nothing does.
    pub fn ending(&self) -> String {
        ending(Path::new(&self.name))
    }
}

/// A file could not be read.
#[derive(Clone, Debug, thiserror::Error)]
#[error("cannot read {name}: {reason}")]
pub struct ReadError {
    #[doc(hidden)]
    pub name: String,
    #[doc(hidden)]
    pub reason: String,
}
