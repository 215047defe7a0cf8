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

/// A named list of nodes, with the types of values and the file formats that the nodes need. A pack takes unused fields from
/// [`Pack::EMPTY`]:
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
    /// The version of the pack, which is written to output files as part of their provenance. Empty if the pack has no version.
    pub version: &'static str,
    /// Returns the id of the build of the pack's code; see [`this_build!`](crate::this_build). Empty if it is unknown. Programs whose packs
    /// have equal ids share cached results on disk. A pack without an id is identified by the program files that contain its code.
    pub build: fn() -> &'static str,
    /// The nodes, in the order in which a typical graph uses them.
    pub nodes: &'static [NodeType],
    /// The types of values that the pack defines.
    pub values: &'static [&'static ValueType],
    /// The file formats to which values can be written.
    pub formats: &'static [Format],
    /// The readers of files from which values can be read.
    pub readers: &'static [AnyReader],
    /// Renamed nodes and fields. Graph files may still contain the old names.
    pub migrations: &'static [Migration],
    /// Templates for new projects, sorted by the number of input files that they need, largest first.
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

/// Returns a function for [`Pack::build`] that returns the build id of the calling crate. That crate must be built with the engine's
/// `build.rs`.
#[macro_export]
macro_rules! this_build {
    () => {{
        // In a module of its own, because a new id should not cause the list of nodes to be compiled again.
        mod build_id {
            pub(super) fn build_id() -> &'static str {
                env!("MAQUETTE_BUILD", "the build script of this package must be the engine's")
            }
        }
        build_id::build_id
    }};
}

/// A template for new projects: a graph file. `maquette new` replaces the input files in it by those of the user.
#[derive(Clone, Copy, Debug)]
pub struct Recipe {
    /// The name of the template, in lower-case letters and hyphens.
    pub name: &'static str,
    /// The text of the graph file. Its comments address the user.
    pub text: &'static str,
}

/// A declaration that a pack has renamed a node type or field.
///
/// A graph with the old name keeps its meaning, and a warning is reported. `maquette edit GRAPH migrate --write` writes the new name to the
/// file. A name can be changed several times. The migration of a field can refer to the node type by its current name or any old name.
///
/// ```
/// use maquette_node::{Migration, NewValue};
///
/// const MIGRATIONS: &[Migration] = &[
///     // 0.2: `Smoothen` became `Smooth`; `size`, in centimeters, became `width`, in millimeters.
///     Migration::Node { old: "Smoothen", new: "Smooth" },
///     Migration::Field { node: "Smooth", old: "size", new: "width", value: NewValue::Times(10.0) },
///     // 0.3: `rounds` was moved into the group `until`.
///     Migration::Field { node: "Smooth", old: "rounds", new: "until.rounds", value: NewValue::Same },
///     Migration::Field { node: "Smooth", old: "kind", new: "kind", value: NewValue::Words(&[("Flat", "Linear")]) },
/// ];
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Migration {
    /// A node type was renamed.
    Node {
        /// The old name of the node type. No current node type may have this name.
        old: &'static str,
        /// The new name of the node type.
        new: &'static str,
    },
    /// A field was renamed or moved. The form of its value may have changed too.
    Field {
        /// The current name or any old name of the node type.
        node: &'static str,
        /// The old name of the field. The current node type must not have a field of this name, unless the migration only renames words in
        /// the value.
        old: &'static str,
        /// The new name of the field: `name`, or `group.name` if the field was moved into a group of fields.
        new: &'static str,
        /// The change of the field's value.
        value: NewValue,
    },
}

/// The change of the value of a renamed field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NewValue {
    /// The value does not change.
    Same,
    /// The unit of the field has changed, so all numbers in the value are multiplied by this factor. Parameters and expressions are
    /// multiplied too.
    Times(f64),
    /// Enum variants were renamed: pairs of the old and the new name.
    Words(&'static [(&'static str, &'static str)]),
}

/// A file format, which writes values of one type to files.
pub trait FileFormat {
    /// The type of values that the format stores.
    type Value: Value;

    /// The extension of the files, in lower case and without the dot.
    const EXTENSION: &'static str;

    /// The data of meshes and points that the files preserve, for `maquette help formats`.
    const FIDELITY: Fidelities = &[];

    /// Returns the file `name` with its content, and the other files that belong to it. All these files are in one folder.
    ///
    /// # Errors
    /// The value cannot be written in this format.
    fn write(value: &Self::Value, name: &str) -> Result<Vec<NewFile>, Error>;

    /// Like [`write`](Self::write), but adds provenance to the files. By default this is done for well-known formats (GLB, PLY, OBJ, MTL,
    /// PCD, PNG, TIFF, STEP, 3MF and JSON objects; STL gets only a hash). Files of other formats are not changed.
    ///
    /// # Errors
    /// The same errors as in [`write`](Self::write).
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

    /// Returns the content of the file in pieces that are computed while the file is written. A large file is then never completely in
    /// memory. Only formats with a single file per value can support this. `None`, the default, uses [`write_signed`](Self::write_signed)
    /// instead.
    ///
    /// # Errors
    /// The same errors as in [`write`](Self::write).
    fn content<'a>(
        _value: &'a Self::Value,
        _signature: Option<&Signature>,
    ) -> Result<Option<Content<'a>>, Error> {
        Ok(None)
    }

    /// Returns warnings about data that the files cannot represent, or that other programs may misread. Empty by default.
    fn warnings(_value: &Self::Value) -> Vec<String> {
        Vec::new()
    }
}

/// A file that is to be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NewFile {
    /// The name of the file, without folders.
    pub name: String,
    /// The content of the file.
    pub bytes: Vec<u8>,
}

impl NewFile {
    /// Creates the list of files for an output that consists of one file.
    pub fn single(name: &str, bytes: Vec<u8>) -> Vec<Self> {
        vec![Self { name: name.to_owned(), bytes }]
    }
}

/// Writes a value to files. If a signature is given, the files contain it as provenance.
type WriteFunction = fn(&AnyValue, &str, Option<&Signature>) -> Result<Vec<NewFile>, Error>;

/// Returns the content of a value's file in pieces. `None` if the format does not support pieces.
type WriteContentFunction =
    for<'a> fn(&'a AnyValue, Option<&Signature>) -> Result<Option<Content<'a>>, Error>;

/// The description of a file format, independent of its Rust type. [`format()`] creates it.
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
    /// Returns the address of the function that writes files of this format. The address identifies the code of the function.
    #[doc(hidden)]
    pub fn code(&self) -> usize {
        self.write as usize
    }

    /// Writes a value of the format's type.
    #[doc(hidden)]
    pub fn write(&self, value: &AnyValue, name: &str) -> Result<Vec<NewFile>, Error> {
        (self.write)(value, name, None)
    }

    /// Returns the content of the file in pieces, without provenance. `None` if the format does not support pieces.
    #[doc(hidden)]
    pub fn content<'a>(&self, value: &'a AnyValue) -> Result<Option<Content<'a>>, Error> {
        (self.content)(value, None)
    }

    /// Returns the names and contents of the files. If a signature is given, the files contain it as provenance. If the format supports
    /// pieces, the content of a large file is in pieces.
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
