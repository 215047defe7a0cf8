//! What a plugin is: a visible list of nodes, values and file formats.

use maquette_syntax::error::Error;
use maquette_value::plain::ending;
use maquette_value::{AnyValue, Value, ValueType, value_type};

use crate::NodeType;
use crate::fidelity::Fidelities;
use crate::provenance::{self, Signature};
use crate::reading::AnyReader;

mod content;

pub use content::Content;
pub use content::{Kept, Pieces};

/// A named list of nodes, with the values and file formats that they need. A pack names only what it has:
///
/// ```
/// use maquette_node::Pack;
///
/// pub static PACK: Pack = Pack { name: "hair", version: env!("CARGO_PKG_VERSION"), ..Pack::EMPTY };
/// ```
#[derive(Clone, Copy)]
pub struct Pack {
    /// The word before the nodes in lists: lower case.
    pub name: &'static str,
    /// Its version, which files tell that were made by its nodes; empty if it has none.
    pub version: &'static str,
    /// The id of the build that the code of all of this is of, as [`this_build!`](crate::this_build) gives it; empty if it is not
    /// known. Programs whose packs are of the same builds share the results that are kept on disk. A pack without an id is known by
    /// the files that its code was loaded from.
    pub build: fn() -> &'static str,
    /// Its nodes, in the order in which a graph uses them.
    pub nodes: &'static [NodeType],
    /// The types of values that it brings.
    pub values: &'static [&'static ValueType],
    /// The files that values can be written to.
    pub formats: &'static [Format],
    /// The files that values can be read from.
    pub readers: &'static [AnyReader],
    /// What became of nodes and fields that graphs may still have under old names.
    pub migrations: &'static [Migration],
    /// Graphs that a new project may begin with, those that want the most files first.
    pub recipes: &'static [Recipe],
}

impl Pack {
    /// A pack without a name that brings nothing.
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

/// The id of the build of this crate, for [`Pack::build`]; the crate must be built with the engine's `build.rs`.
#[macro_export]
macro_rules! this_build {
    () => {{
        // Apart from the list of nodes, which need not be compiled again for each new id.
        mod build_id {
            pub(super) fn build_id() -> &'static str {
                env!("MAQUETTE_BUILD", "the build script of this package must be the engine's")
            }
        }
        build_id::build_id
    }};
}

/// A graph that a new project may begin with: `maquette new` puts the project's own files in place of those that its nodes read.
#[derive(Clone, Copy, Debug)]
pub struct Recipe {
    /// The word for it: lower-case letters and hyphens.
    pub name: &'static str,
    /// The file, with comments for who goes on with it.
    pub text: &'static str,
}

/// What became of a node or a field of a pack.
///
/// Graphs with the old name go on to mean what they meant, with a warning; `maquette migrate --write` puts the new one into their files.
/// Several may follow each other, as versions do: a field's migration names its node by any name that the node has had.
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
    /// A type of nodes has another name.
    Node {
        /// The name that it had: no node may have it now.
        old: &'static str,
        /// The one that it got.
        new: &'static str,
    },
    /// A field has another name or place, and its value may be said otherwise.
    Field {
        /// The type of nodes, by any name that it has had.
        node: &'static str,
        /// The name that the field had: the node may have no such field now, unless only words of its value have changed.
        old: &'static str,
        /// The one that it got; `group.name` if it was moved into a group of fields.
        new: &'static str,
        /// What became of its value.
        value: NewValue,
    },
}

/// How a value of an old field is said now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NewValue {
    /// As before.
    Same,
    /// A number in another unit: times this. All numbers of a list or tuple are; what a parameter or an expression gives, too.
    Times(f64),
    /// A choice that has another name: (old, new). Others stay.
    Words(&'static [(&'static str, &'static str)]),
}

/// A way to write one type of values to one kind of files.
pub trait FileFormat {
    /// What it writes.
    type Value: Value;

    /// The ending of the file's name, in lower case, without the dot.
    const ENDING: &'static str;

    /// What its files keep of a mesh or of points, for `maquette help formats`.
    const FIDELITY: Fidelities = &[];

    /// The content of the file `name`, and of other files that belong to it, all in one folder.
    ///
    /// # Errors
    /// If the value cannot be written in this format.
    fn write(value: &Self::Value, name: &str) -> Result<Vec<NewFile>, Error>;

    /// The same, where the files tell where the value came from. If this is left out, files of well-known formats do so in their own
    /// way (GLB, PLY, OBJ, MTL, PCD, PNG, TIFF, STEP, JSON objects, and by a hash STL), and others do not.
    ///
    /// # Errors
    /// Those of [`write`](Self::write).
    fn write_signed(
        value: &Self::Value,
        name: &str,
        signature: &Signature,
    ) -> Result<Vec<NewFile>, Error> {
        let mut files = Self::write(value, name)?;
        for file in &mut files {
            provenance::sign(&ending(file.name.as_ref()), &mut file.bytes, signature);
        }
        Ok(files)
    }

    /// The same content of a format whose values are one file each, and may be large: in pieces that are made while they are written, so
    /// that the file is never in memory as a whole. If this is left out, it is.
    ///
    /// # Errors
    /// Those of [`write`](Self::write).
    fn content<'a>(
        _value: &'a Self::Value,
        _signature: Option<&Signature>,
    ) -> Result<Option<Content<'a>>, Error> {
        Ok(None)
    }

    /// What of the value its files cannot tell, or what their readers will stumble over, in words: a warning for each. If this is left
    /// out, there is nothing.
    fn doubts(_value: &Self::Value) -> Vec<String> {
        Vec::new()
    }
}

/// A file to be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NewFile {
    /// Its name, without folders.
    pub name: String,
    /// Its content.
    pub bytes: Vec<u8>,
}

impl NewFile {
    /// The only file of an output.
    pub fn only(name: &str, bytes: Vec<u8>) -> Vec<Self> {
        vec![Self { name: name.to_owned(), bytes }]
    }
}

/// Writes a value to files of this name.
type Write = fn(&AnyValue, &str, Option<&Signature>) -> Result<Vec<NewFile>, Error>;

/// Writes a value to one file, if the format can do that in pieces.
type WriteContent =
    for<'a> fn(&'a AnyValue, Option<&Signature>) -> Result<Option<Content<'a>>, Error>;

/// What the engine knows of a file format. Made by [`format()`].
#[derive(Clone, Copy)]
pub struct Format {
    /// The ending of the file's name.
    pub ending: &'static str,
    #[doc(hidden)]
    pub kind: fn() -> &'static ValueType,
    write: Write,
    content: WriteContent,
    doubts: fn(&AnyValue) -> Vec<String>,
    /// What its files keep of a mesh or of points.
    #[doc(hidden)]
    pub fidelity: Fidelities,
}

impl Format {
    /// Where its code is.
    #[doc(hidden)]
    pub fn code(&self) -> usize {
        self.write as usize
    }

    /// Writes a value of the format's type.
    #[doc(hidden)]
    pub fn write(&self, value: &AnyValue, name: &str) -> Result<Vec<NewFile>, Error> {
        (self.write)(value, name, None)
    }

    /// The file of a value that the format can write in pieces, unsigned.
    #[doc(hidden)]
    pub fn content<'a>(&self, value: &'a AnyValue) -> Result<Option<Content<'a>>, Error> {
        (self.content)(value, None)
    }

    /// The same, each file by its name; they tell where the value came from, if that is known, and are made while they are written, if the
    /// format can do that and they are large.
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

    /// What of a value its files cannot tell, or what their readers will stumble over.
    #[doc(hidden)]
    pub fn doubts(&self, value: &AnyValue) -> Vec<String> {
        (self.doubts)(value)
    }
}

/// The description of the file format `F` for the engine.
pub const fn format<F: FileFormat>() -> Format {
    Format {
        ending: F::ENDING,
        kind: value_type::<F::Value>,
        write: |value, name, signature| {
            let value = own::<F>(value);
            match signature {
                Some(signature) => F::write_signed(value, name, signature),
                None => F::write(value, name),
            }
        },
        content: |value, signature| F::content(own::<F>(value), signature),
        doubts: |value| F::doubts(own::<F>(value)),
        fidelity: F::FIDELITY,
    }
}

fn own<F: FileFormat>(value: &AnyValue) -> &F::Value {
    value
        .get()
        .unwrap_or_else(|| panic!("a {value:?} came to a writer of {}", <F::Value as Value>::NAME))
}
