//! What a plugin is: a visible list of nodes, values and file formats.

use crate::error::Error;
use crate::node::NodeType;
use crate::plain::ending;
use crate::provenance::{self, Signature};
use crate::reading::AnyReader;
use crate::value::{AnyValue, Value, ValueType, value_type};

/// A named list of nodes, with the values and file formats that they need.
#[derive(Clone, Copy)]
pub struct Pack {
    /// The word before the nodes in lists: lower case.
    pub name: &'static str,
    /// Its nodes, in the order in which a graph uses them.
    pub nodes: &'static [NodeType],
    /// The types of values that it brings.
    pub values: &'static [&'static ValueType],
    /// The files that values can be written to.
    pub formats: &'static [Format],
    /// The files that values can be read from.
    pub readers: &'static [AnyReader],
}

/// A way to write one type of values to one kind of files.
pub trait FileFormat {
    /// What it writes.
    type Value: Value;

    /// The ending of the file's name, in lower case, without the dot.
    const ENDING: &'static str;

    /// The content of the file `name`, and of other files that belong to it, all in one folder.
    ///
    /// # Errors
    /// If the value cannot be written in this format.
    fn write(value: &Self::Value, name: &str) -> Result<Vec<NewFile>, Error>;

    /// The same, where the files tell where the value came from. If this is left out, files of well-known formats do so in their own
    /// way (GLB, PLY, OBJ, MTL, PCD, PNG, STEP, JSON objects, and by a hash STL), and others do not.
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

/// What the engine knows of a file format. Made by [`format()`].
#[derive(Clone, Copy)]
pub struct Format {
    /// The ending of the file's name.
    pub ending: &'static str,
    pub(crate) kind: fn() -> &'static ValueType,
    write: fn(&AnyValue, &str, Option<&Signature>) -> Result<Vec<NewFile>, Error>,
}

impl Format {
    /// Where its code is.
    pub(crate) fn code(&self) -> usize {
        self.write as usize
    }

    /// Writes a value of the format's type.
    pub(crate) fn write(&self, value: &AnyValue, name: &str) -> Result<Vec<NewFile>, Error> {
        (self.write)(value, name, None)
    }

    /// The same; the files tell where the value came from, if that is known.
    pub(crate) fn write_signed(
        &self,
        value: &AnyValue,
        name: &str,
        signature: Option<&Signature>,
    ) -> Result<Vec<NewFile>, Error> {
        (self.write)(value, name, signature)
    }
}

/// The description of the file format `F` for the engine.
pub const fn format<F: FileFormat>() -> Format {
    Format {
        ending: F::ENDING,
        kind: value_type::<F::Value>,
        write: |value, name, signature| {
            let value = value.get::<F::Value>().unwrap_or_else(|| {
                panic!("a {value:?} came to a writer of {}", <F::Value as Value>::NAME)
            });
            match signature {
                Some(signature) => F::write_signed(value, name, signature),
                None => F::write(value, name),
            }
        },
    }
}
