//! Files whose paths are in fields of nodes, and the contents of these files.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_syntax::FILE;
use maquette_syntax::error::Error;
use maquette_value::Hash;
use maquette_value::fs::{extension, strip_bom};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use serde_json::json;

/// The path of a file that a node reads, relative to the graph file. An empty path means that there is no file.
///
/// The evaluator reads the file. The content of the file is part of the node's cache key, but its path is not.
///
/// A field can restrict the extensions of its file, which are checked before the graph runs. The attribute `#[schemars(extend("endings" =
/// ["obj", "ply"]))]` lists the extensions in lower case, without the dot. The attribute `extend("reads" = "Mesh")` allows the extensions
/// that the program's readers can read as values of this type.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FilePath {
    #[doc(hidden)]
    given: String,
    resolved: PathBuf,
}

impl FilePath {
    /// Returns true if the path is empty, which means that there is no file.
    pub fn is_empty(&self) -> bool {
        self.given.is_empty()
    }

    /// Returns the path as the graph file contains it.
    pub fn name(&self) -> &str {
        &self.given
    }

    /// Returns the path of another file in the folder of this file.
    #[must_use]
    pub fn sibling(&self, name: &str) -> Self {
        let given = Path::new(&self.given).with_file_name(name);
        Self {
            given: given.to_string_lossy().into_owned(),
            resolved: self.resolved.with_file_name(name),
        }
    }

    #[doc(hidden)]
    pub fn resolved_path(&self) -> &Path {
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
    /// The companions: other files to which this file refers, by name. Each has its content, or the reason why it cannot be read.
    #[doc(hidden)]
    pub companions: Arc<Companions>,
    /// The hash of the content of the file and its companions.
    #[doc(hidden)]
    pub hash: Hash,
}

/// The files to which a file refers, such as materials and pictures, by name. Each has its content, or the reason why it cannot be read.
#[doc(hidden)]
pub type Companions = BTreeMap<String, Result<Arc<[u8]>, String>>;

impl File {
    /// Returns the path as the graph file contains it, for messages.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the content of the file. A UTF-8 byte order mark (EF BB BF) at its start, which some editors write, is removed.
    pub fn bytes(&self) -> &[u8] {
        strip_bom(&self.bytes)
    }

    /// Returns the content of a companion file, such as the materials of an OBJ file. `name` is its path relative to this file's folder.
    ///
    /// # Errors
    /// This file does not refer to that name, or the companion file may not be read.
    pub fn companion(&self, name: &str) -> Result<Arc<[u8]>, String> {
        let found = self.companions.get(name).cloned();
        found.unwrap_or_else(|| Err(format!("{} does not name `{name}`", self.name)))
    }

    /// Calls `read` with the content of the file. Adds the name of the file to an error.
    ///
    /// # Errors
    /// The errors of `read`.
    pub fn read<T, E: Into<Error>>(
        &self,
        read: impl FnOnce(&[u8]) -> Result<T, E>,
    ) -> Result<T, Error> {
        read(self.bytes()).map_err(|error| error.into().with_file(&self.name))
    }

    /// Returns the extension of the file name, in lower case and without the dot. Empty if the name has no extension.
    pub fn extension(&self) -> String {
        extension(Path::new(&self.name))
    }
}

/// The error for a file that could not be read.
#[derive(Clone, Debug, thiserror::Error)]
#[error("cannot read {name}: {reason}")]
pub struct ReadError {
    #[doc(hidden)]
    pub name: String,
    #[doc(hidden)]
    pub reason: String,
}
