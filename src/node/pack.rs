//! Packs: lists of nodes, types of values and file formats.

use maquette_syntax::error::Error;
use maquette_value::fs::extension;
use maquette_value::{AnyValue, Value, ValueType, value_type};

use crate::NodeType;
use crate::fidelity::Fidelities;
use crate::importers::AnyReader;
use crate::provenance::{self, Signature};

mod content;

pub use content::Content;
pub use content::{CachedData, Pieces};

/// A named list of nodes, with the types of values and the file formats that the nodes need. [`Pack::EMPTY`] provides the fields that a
/// pack leaves empty:
///
/// ```
/// use maquette_node::Pack;
///
/// pub static PACK: Pack = Pack { name: "hair", version: env!("CARGO_PKG_VERSION"), ..Pack::EMPTY };
/// ```
#[derive(Clone, Copy)]
pub struct Pack {
    /// The name of the pack in lists, in lower case.
    pub name: &'static str,
    /// The version of the pack. It is part of the provenance in output files. Empty if the pack has no version.
    pub version: &'static str,
    /// The build id of the pack's code, as [`this_build!`](crate::this_build) returns it. Empty if it is not known. Programs with the same
    /// builds of their packs share cached results on disk. A pack without an id is identified by the files that contain its code.
    pub build: fn() -> &'static str,
    /// The nodes, in the order in which a typical graph uses them.
    pub nodes: &'static [NodeType],
    /// The types of values that the pack defines.
    pub values: &'static [&'static ValueType],
    /// The file formats to which values can be written.
    pub formats: &'static [Format],
    /// The readers of files from which values can be read.
    pub readers: &'static [AnyReader],
    /// The renamed nodes and fields. Graphs may still contain their old names.
    pub migrations: &'static [Migration],
    /// Templates for new projects. Templates that need more files come first.
    pub recipes: &'static [Recipe],
}

impl Pack {
    /// A pack without a name and without content.
    pub const EMPTY: Self = Self {
        name: "",
        version: "",
        build: || "",
        nodes: &[],
        values: &[],
        formats: &[],
        readers: &[],
        migrations: &[],
        recipes: &[],
    };
}

/// Returns the function that gives the build id of the calling crate, for [`Pack::build`]. The crate must be built with the engine's
/// `build.rs`.
#[macro_export]
macro_rules! this_build {
    () => {{
        // The id is in a module of its own, so that a new id does not cause the list of nodes to be compiled again.
        mod build_id {
            pub(super) fn build_id() -> &'static str {
                env!("MAQUETTE_BUILD", "the build script of this package must be the engine's")
            }
        }
        build_id::build_id
    }};
}

/// A template for new projects. `maquette new` replaces the input files in it by those of the project.
#[derive(Clone, Copy, Debug)]
pub struct Recipe {
    /// The name of the template, in lower-case letters and hyphens.
    pub name: &'static str,
    /// The text of the graph file. Its comments address the user.
    pub text: &'static str,
}

/// The declaration that a node or field of a pack was renamed.
///
/// A graph with the old name keeps its meaning, and a warning is reported. `maquette edit GRAPH migrate --write` writes the new name to the
/// file. Several migrations may follow each other. The migration of a field may refer to the node by any name that the node has had.
///
/// ```
/// use maquette_node::{Migration, NewValue};
///
/// const MIGRATIONS: &[Migration] = &[
///     // 0.2: Smoothen was a bad name, and its width is in millimeters now, not in centimeters.
///     Migration::Node { old: "Smoothen", new: "Smooth" },
///     Migration::Field { node: "Smooth", old: "size", new: "width", value: NewValue::Times(10.0) },
///     // 0.3: how it ends is said in one place.
///     Migration::Field { node: "Smooth", old: "rounds", new: "until.rounds", value: NewValue::Same },
///     Migration::Field { node: "Smooth", old: "kind", new: "kind", value: NewValue::Words(&[("Flat", "Linear")]) },
/// ];
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Migration {
    /// A node type was renamed.
    Node {
        /// The old name of the node type. No present node may have it.
        old: &'static str,
        /// The new name of the node type.
        new: &'static str,
    },
    /// A field was renamed or moved. Its value may be written differently, too.
    Field {
        /// The name of the node type, which may be any name that the type has had.
        node: &'static str,
        /// The old name of the field. The node must not have a field of this name now, unless the migration only changes words in the
        /// field's value.
        old: &'static str,
        /// The new name of the field. It is `group.name` if the field was moved into a group of fields.
        new: &'static str,
        /// The change of the value that comes with the new name.
        value: NewValue,
    },
}

/// The change of the value of a renamed field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NewValue {
    /// The value stays as it is written.
    Same,
    /// The number has another unit now, so it is multiplied by this factor. All numbers of a list or tuple are multiplied, and also
    /// parameters and expressions.
    Times(f64),
    /// Enum variants were renamed: pairs of the old and the new name.
    Words(&'static [(&'static str, &'static str)]),
}

/// A file format: writes values of one type to one kind of files.
pub trait FileFormat {
    /// The type of values that the format stores.
    type Value: Value;

    /// The extension of the files, in lower case, without the dot.
    const EXTENSION: &'static str;

    /// The data of meshes and points that the files preserve. `maquette help formats` prints it.
    const FIDELITY: Fidelities = &[];

    /// Returns the content of the file `name`, and of other files that belong to it. All of them are in one folder.
    ///
    /// # Errors
    /// If the value cannot be written in this format.
    fn write(value: &Self::Value, name: &str) -> Result<Vec<NewFile>, Error>;

    /// As [`write`](Self::write), with provenance in the files. By default, the provenance is added to files of well-known formats (GLB,
    /// PLY, OBJ, MTL, PCD, PNG, TIFF, STEP, 3MF and JSON objects; STL gets only a hash), and is omitted for other formats.
    ///
    /// # Errors
    /// The errors of [`write`](Self::write).
    fn write_signed(
        value: &Self::Value,
        name: &str,
        signature: &Signature,
    ) -> Result<Vec<NewFile>, Error> {
        let mut files = Self::write(value, name)?;
        for file in &mut files {
            provenance::sign(&extension(file.name.as_ref()), &mut file.bytes, signature);
        }
        Ok(files)
    }

    /// Returns the content in pieces that are computed while they are written, so that a large file is never completely in memory. Only
    /// formats with a single file per value can support that. By default, the result of [`write_signed`](Self::write_signed) is used.
    ///
    /// # Errors
    /// The errors of [`write`](Self::write).
    fn content<'a>(
        _value: &'a Self::Value,
        _signature: Option<&Signature>,
    ) -> Result<Option<Content<'a>>, Error> {
        Ok(None)
    }

    /// Returns warnings about data that the files cannot represent, or that other programs may read incorrectly. By default there are none.
    fn warnings(_value: &Self::Value) -> Vec<String> {
        Vec::new()
    }
}

/// A file to be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NewFile {
    /// The name of the file, without folders.
    pub name: String,
    /// The content of the file.
    pub bytes: Vec<u8>,
}

impl NewFile {
    /// Creates the list for an output that consists of one file.
    pub fn single(name: &str, bytes: Vec<u8>) -> Vec<Self> {
        vec![Self { name: name.to_owned(), bytes }]
    }
}

/// A function that writes a value to files, with provenance if a signature is given.
type WriteFunction = fn(&AnyValue, &str, Option<&Signature>) -> Result<Vec<NewFile>, Error>;

/// Returns the content of a value in pieces. `None` if the format does not support pieces.
type WriteContentFunction =
    for<'a> fn(&'a AnyValue, Option<&Signature>) -> Result<Option<Content<'a>>, Error>;

/// The description of a file format, without its Rust type. [`format()`] creates it.
#[derive(Clone, Copy)]
pub struct Format {
    /// The extension of the files.
    pub extension: &'static str,
    #[doc(hidden)]
    pub kind: fn() -> &'static ValueType,
    write: WriteFunction,
    content: WriteContentFunction,
    warnings: fn(&AnyValue) -> Vec<String>,
    /// The data of meshes and points that the files preserve.
    #[doc(hidden)]
    pub fidelity: Fidelities,
}

impl Format {
    /// Returns the address of the format's function, which identifies its code.
    #[doc(hidden)]
    pub fn code(&self) -> usize {
        self.write as usize
    }

    /// Writes a value of the format's type.
    #[doc(hidden)]
    pub fn write(&self, value: &AnyValue, name: &str) -> Result<Vec<NewFile>, Error> {
        (self.write)(value, name, None)
    }

    /// Returns the content in pieces, without provenance. `None` if the format does not support pieces.
    #[doc(hidden)]
    pub fn content<'a>(&self, value: &'a AnyValue) -> Result<Option<Content<'a>>, Error> {
        (self.content)(value, None)
    }

    /// Returns the names and contents of the files. If a signature is given, the files contain provenance. If the format supports pieces,
    /// the contents of large files are pieces.
    #[doc(hidden)]
    pub fn contents<'a>(
        &self,
        value: &'a AnyValue,
        name: &str,
        signature: Option<&Signature>,
    ) -> Result<Vec<(String, Content<'a>)>, Error> {
        if let Some(content) = (self.content)(value, signature)? {
            return Ok(vec![(name.to_owned(), content.in_memory_if_small())]);
        }
        let files = (self.write)(value, name, signature)?;
        Ok(files.into_iter().map(|file| (file.name, file.bytes.into())).collect())
    }

    /// Returns warnings about data that the files cannot represent.
    #[doc(hidden)]
    pub fn warnings(&self, value: &AnyValue) -> Vec<String> {
        (self.warnings)(value)
    }
}

/// Returns the description of the file format `F`.
pub const fn format<F: FileFormat>() -> Format {
    Format {
        extension: F::EXTENSION,
        kind: value_type::<F::Value>,
        write: |value, name, signature| {
            let value = downcast::<F>(value);
            match signature {
                Some(signature) => F::write_signed(value, name, signature),
                None => F::write(value, name),
            }
        },
        content: |value, signature| F::content(downcast::<F>(value), signature),
        warnings: |value| F::warnings(downcast::<F>(value)),
        fidelity: F::FIDELITY,
    }
}

fn downcast<F: FileFormat>(value: &AnyValue) -> &F::Value {
    value
        .get()
        .unwrap_or_else(|| panic!("a {value:?} came to a writer of {}", <F::Value as Value>::NAME))
}
