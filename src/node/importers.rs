//! Readers of files. A reader is selected by the type of the value and the extension of the file name.

use std::cell::{Cell, RefCell};
use std::cmp::Reverse;
use std::collections::HashMap;
use std::fmt;
use std::io::{Read, Seek};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_syntax::error::Error;
use maquette_syntax::paths::{PathError, may_read, project_root};
use maquette_value::fs;
use maquette_value::fs::{extension, strip_bom};
use maquette_value::{AnyValue, Mesh, Points, Value, ValueType, value_type};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::fidelity::Fidelities;
use crate::size::{FileHead, ValueSize};

/// A reader of files, which returns values of one type from files of one format.
pub trait FileReader {
    /// The type of values that the reader returns.
    type Value: Value;

    /// The extensions of the files, in lower case and without the dot.
    const EXTENSIONS: &'static [&'static str];

    /// The data of meshes and points that the reader preserves, for `maquette help formats`.
    const FIDELITY: Fidelities = &[];

    /// Reads the value in a file. Must never panic. Memory use must be at most a small multiple of the file's actual size, whatever sizes
    /// the file declares.
    ///
    /// # Errors
    /// The file is invalid. The message must contain the position in the file.
    fn read(file: &InputFile<'_>) -> Result<Self::Value, Error>;

    /// A function that requests every companion file that [`read`](Self::read) may request, by [`InputFile::companion`]. `None` if files of
    /// this format have no companions. Companions are other files to which a file refers, such as the materials of an OBJ file. They count
    /// as a part of the file: results are computed again when a companion changes, and a watch monitors it. The function must never panic.
    const COMPANIONS: Option<fn(&InputFile<'_>)> = None;

    /// A function that reads the points of a large file in blocks; `None` if the format does not allow it. Only for readers of points
    /// without companions.
    const BLOCKS: Option<ReadBlocks> = None;
    /// A function that returns the size of the value from the first bytes of a file and its length, or `None` if they do not determine it.
    /// `None` if the format does not state sizes. The function must never panic.
    const SIZE: Option<fn(&FileHead<'_>) -> Option<ValueSize>> = None;
}

/// A file at any position of which bytes can be read.
pub trait ReadSeek: Read + Seek {}

impl<T: Read + Seek> ReadSeek for T {}

/// A file of points that a reader reads in blocks.
pub struct BlockFile<'a> {
    /// The content of the file.
    pub content: &'a mut dyn ReadSeek,
    /// The size of the file in bytes.
    pub size: u64,
    /// The maximum value of a color channel that the user has specified.
    pub color_range: Option<ColorRange>,
    /// The number of points in each block except the last one.
    pub block_len: usize,
}

/// A function that reads the points of a file in blocks, and passes each block on. Joined, the blocks are the points that
/// [`FileReader::read`] returns, bit for bit.
///
/// It fails with [`NotInBlocks`] if a block depends on later ones, or `read` would warn: the file is then read as a whole. It may also fail
/// with any other error, for the same reason: then `read` reports its own error.
pub type ReadBlocks =
    fn(&mut BlockFile<'_>, &mut dyn FnMut(Points) -> Result<(), Error>) -> Result<(), Error>;

/// The error that a file must be read as a whole.
#[derive(Clone, Copy, Debug, thiserror::Error)]
#[error("the file cannot be read in blocks")]
pub struct NotInBlocks;

/// The maximum value of a color channel, for files that do not specify it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum ColorRange {
    /// Channels go from 0 to 1.
    To1,
    /// Channels go from 0 to 255.
    To255,
    /// Channels go from 0 to 65535.
    To65535,
}

/// Returns the content of a companion file by its name, or the reason why it cannot be read.
pub type CompanionLookup<'a> = dyn Fn(&str) -> Result<Arc<[u8]>, String> + 'a;

/// A file that is passed to a reader. Gives access to the companions of the file.
pub struct InputFile<'a> {
    name: &'a str,
    bytes: &'a [u8],
    beside: &'a CompanionLookup<'a>,
    color_range: Option<ColorRange>,
    doubts: RefCell<Vec<String>>,
}

impl<'a> InputFile<'a> {
    /// Creates an input file with this name and content. `beside` returns the contents of its companion files by name.
    pub fn new(name: &'a str, bytes: &'a [u8], beside: &'a CompanionLookup<'a>) -> Self {
        let (bytes, color_range) = (strip_bom(bytes), None);
        Self { name, bytes, beside, color_range, doubts: RefCell::default() }
    }

    /// Sets the maximum value of a color channel that the user has specified.
    #[must_use]
    pub fn with_color_range(mut self, range: Option<ColorRange>) -> Self {
        self.color_range = range;
        self
    }

    /// Returns the maximum value of a color channel that the user has specified. If it is `None` and the file format does not specify it
    /// either, the reader must derive it from all colors of the file.
    pub fn color_range(&self) -> Option<ColorRange> {
        self.color_range
    }

    /// Creates a file without companions.
    pub fn standalone(name: &'a str, bytes: &'a [u8]) -> Self {
        Self::new(name, bytes, &|name| Err(format!("there is no file {name}")))
    }

    /// Returns the content of the file. A UTF-8 byte order mark (EF BB BF) at its start, which some editors write, is removed.
    pub fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// Returns the extension of the file name, in lower case and without the dot. Empty if the name has no extension.
    pub fn extension(&self) -> String {
        extension(self.name.as_ref())
    }

    /// Returns the content of a companion file in the same folder. A byte order mark at its start is removed.
    ///
    /// # Errors
    /// The companion file does not exist, or it may not be read.
    pub fn companion(&self, name: &str) -> Result<Arc<[u8]>, String> {
        let bytes = (self.beside)(name)?;
        let text = strip_bom(&bytes);
        Ok(if text.len() < bytes.len() { text.into() } else { bytes })
    }

    /// Adds a warning about the file.
    pub fn warn(&self, message: impl Into<String>) {
        self.doubts.borrow_mut().push(message.into());
    }

    /// Returns all warnings about the file so far.
    pub fn warnings(&self) -> Vec<String> {
        self.doubts.borrow().clone()
    }
}

/// The description of a reader, independent of its Rust type. [`reader()`] creates it.
#[derive(Clone, Copy)]
pub struct AnyReader {
    /// The extensions of the files, in lower case and without the dot.
    pub extensions: &'static [&'static str],
    kind: fn() -> &'static ValueType,
    read: fn(&InputFile<'_>) -> Result<AnyValue, Error>,
    companions: Option<fn(&InputFile<'_>)>,
    blocks: Option<ReadBlocks>,
    size: Option<fn(&FileHead<'_>) -> Option<ValueSize>>,
    /// The data of meshes and points that the reader preserves.
    #[doc(hidden)]
    pub fidelity: Fidelities,
}

/// Returns the description of the reader `R`.
pub const fn reader<R: FileReader>() -> AnyReader {
    AnyReader {
        extensions: R::EXTENSIONS,
        kind: value_type::<R::Value>,
        read: |file| R::read(file).map(AnyValue::new),
        companions: R::COMPANIONS,
        blocks: R::BLOCKS,
        size: R::SIZE,
        fidelity: R::FIDELITY,
    }
}

/// The error for a file that no reader can read: none returns values of the required type from files with this extension.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no {what} can be read from {}; supported extensions: {}", if extension.is_empty() { "a file without an extension".into() } else { format!("`.{extension}`") }, known.join(", "))]
pub struct NoReader {
    /// The required type of values, or the word `value` if any type is accepted.
    pub what: &'static str,
    /// The extension of the file that cannot be read.
    pub extension: String,
    /// The extensions of files from which values of the required type can be read.
    pub known: Vec<&'static str>,
}

/// The error for a file for which all readers of its extension have failed. Each item is an error and the types of values whose readers
/// returned it.
#[derive(Debug, thiserror::Error)]
#[error("{}", self.describe())]
struct ReadFailures(Vec<(Vec<&'static str>, Error)>);

impl ReadFailures {
    /// Groups the types of values by the errors of their readers. The error that most types share comes first.
    fn from_errors(refused: Vec<(&'static str, Error)>) -> Error {
        let mut reasons: Vec<(Vec<_>, Error)> = Vec::new();
        for (kind, error) in refused {
            let message = error.to_string();
            match reasons.iter_mut().find(|(_, reason)| reason.to_string() == message) {
                Some((kinds, _)) => kinds.push(kind),
                None => reasons.push((vec![kind], error)),
            }
        }
        reasons.sort_by_key(|(kinds, _)| Reverse(kinds.len()));
        match <[_; 1]>::try_from(reasons) {
            Ok([(_, reason)]) => reason,
            Err(reasons) => Self(reasons).into(),
        }
    }

    fn describe(&self) -> String {
        let errors = self.0.iter();
        let errors = errors.map(|(kinds, error)| format!("as {}: {error}", kinds.join(" or ")));
        errors.collect::<Vec<_>>().join("; ")
    }
}

/// The error for a text in UTF-16. All readers require UTF-8.
#[derive(Debug, thiserror::Error)]
#[error("it is text in UTF-16: save it as UTF-8")]
struct Utf16;

/// The readers of all packs of a program.
#[derive(Clone, Default)]
#[doc(hidden)]
pub struct Readers(Vec<AnyReader>);

impl Readers {
    /// Returns the readers, in the order of the packs.
    #[doc(hidden)]
    pub fn as_slice(&self) -> &[AnyReader] {
        &self.0
    }

    #[doc(hidden)]
    pub fn new(readers: impl IntoIterator<Item = AnyReader>) -> Self {
        Self(readers.into_iter().collect())
    }

    /// Returns the extensions of the files from which values of type `kind` can be read, in the order of the packs. If `kind` is `None`,
    /// returns the extensions for values of all types.
    #[doc(hidden)]
    pub fn extensions(&self, kind: Option<&str>) -> Vec<&'static str> {
        let mut endings: Vec<&str> = Vec::new();
        for &ending in self
            .0
            .iter()
            .filter(|reader| kind.is_none_or(|kind| reader.kind().name == kind))
            .flat_map(|reader| reader.extensions)
        {
            if !endings.contains(&ending) {
                endings.push(ending);
            }
        }
        endings
    }

    /// Reads a value of the type `kind` from a file.
    #[doc(hidden)]
    pub fn read(&self, kind: &ValueType, file: &InputFile<'_>) -> Result<AnyValue, Error> {
        let extension = file.extension();
        for reader in &self.0 {
            if reader.kind() == kind && reader.extensions.contains(&&extension[..]) {
                return reader.call(file);
            }
        }
        let known = self.extensions(Some(kind.name));
        Err(NoReader { what: kind.name, extension, known }.into())
    }

    /// Reads a value of any type. Its type is that of the first reader for the file's extension that succeeds.
    ///
    /// # Errors
    /// The errors of all readers, if no reader succeeds.
    #[doc(hidden)]
    pub fn read_any(&self, file: &InputFile<'_>) -> Result<AnyValue, Error> {
        let ending = file.extension();
        let (mut bare, mut refused) = (None, Vec::new());
        for reader in self.0.iter().filter(|reader| reader.extensions.contains(&&ending[..])) {
            match reader.call(file) {
                // A mesh without faces may be a point cloud or a line. Try the other readers before accepting it.
                Ok(value) if value.get::<Mesh>().is_some_and(|mesh| mesh.faces().is_empty()) => {
                    bare = bare.or(Some(value));
                }
                Ok(value) => return Ok(value),
                Err(error) => refused.push((reader.kind().name, error)),
            }
        }
        match (bare, refused.is_empty()) {
            (Some(value), _) => Ok(value),
            (None, false) => Err(ReadFailures::from_errors(refused)),
            (None, true) => {
                let known = self.extensions(None);
                Err(NoReader { what: "value", extension: ending, known }.into())
            }
        }
    }

    /// Returns the function that reads points in blocks from files with this extension; `None` if they are read as a whole.
    #[doc(hidden)]
    pub fn read_blocks(&self, extension: &str) -> Option<ReadBlocks> {
        let of_points = self.0.iter().filter(|reader| reader.kind().name == Points::NAME);
        of_points.filter(|reader| reader.extensions.contains(&extension)).find_map(|it| it.blocks)
    }

    /// Returns the size of the value of type `kind` in a file. `None` if the start of the file does not determine it.
    #[doc(hidden)]
    pub fn size(&self, kind: &ValueType, head: &FileHead<'_>) -> Option<ValueSize> {
        let mut readers = self.0.iter().filter(|reader| reader.kind() == kind);
        let reader = readers.find(|reader| reader.extensions.contains(&head.extension))?;
        reader.size.and_then(|size| size(head))
    }

    /// Returns true if files with this extension may have companions.
    #[doc(hidden)]
    pub fn may_name(&self, ending: &str) -> bool {
        fn names(reader: &AnyReader) -> bool {
            reader.companions.is_some()
        }
        self.0.iter().any(|reader| names(reader) && reader.extensions.contains(&ending))
    }

    /// Calls the `COMPANIONS` functions of all readers for the file's extension, which request all companions of the file.
    #[doc(hidden)]
    pub fn ask_companions(&self, file: &InputFile<'_>) {
        let ending = file.extension();
        self.0
            .iter()
            .filter(|reader| reader.extensions.contains(&&ending[..]))
            .for_each(|reader| reader.ask_companions(file));
    }

    /// Reads a value of the type `kind` from the file at a path. If `kind` is `None`, the value may have any type. Returns the value and
    /// the warnings of the reader. Companion files are read only if they are in the same project.
    ///
    /// # Errors
    /// The file cannot be read. The message contains the path.
    #[doc(hidden)]
    pub fn open(
        &self,
        path: &Path,
        kind: Option<&ValueType>,
    ) -> Result<(AnyValue, Vec<String>), String> {
        self.open_with_companions(path, kind, &|_| {})
    }

    /// Like [`open`](Self::open), but calls `on_companion` with the path of each companion file before the file is read.
    ///
    /// # Errors
    /// The same errors as in [`open`](Self::open).
    #[doc(hidden)]
    pub fn open_with_companions(
        &self,
        path: &Path,
        kind: Option<&ValueType>,
        on_companion: &dyn Fn(&Path),
    ) -> Result<(AnyValue, Vec<String>), String> {
        fn read_error_message(error: &dyn fmt::Display, path: &Path) -> String {
            format!("cannot read {}: {error}", path.display())
        }
        let bytes = fs::read(path).map_err(|error| read_error_message(&error, path))?;
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = std::fs::canonicalize(folder.unwrap_or(Path::new(".")));
        let folder = folder.map_err(|error| read_error_message(&error, path))?;
        let roots = [project_root(&folder)];
        let companions = CompanionFiles::new(&roots);
        let beside = |name: &str| {
            let path = folder.join(name);
            on_companion(&path);
            companions.read(name, &path)
        };
        let name = path.to_string_lossy();
        let reading = InputFile::new(&name, &bytes, &beside);
        let value = match kind {
            Some(kind) => self.read(kind, &reading),
            None => self.read_any(&reading),
        };
        Ok((value.map_err(|error| read_error_message(&error, path))?, reading.warnings()))
    }
}

impl AnyReader {
    /// Returns the type of values that the reader returns.
    #[doc(hidden)]
    pub fn kind(&self) -> &'static ValueType {
        (self.kind)()
    }

    /// Returns the address of the reader's function, which identifies its code.
    #[doc(hidden)]
    pub fn code(&self) -> usize {
        self.read as usize
    }

    /// Reads a file without checking its extension.
    #[doc(hidden)]
    pub fn call(&self, file: &InputFile<'_>) -> Result<AnyValue, Error> {
        let is_utf16 = [b"\xff\xfe", b"\xfe\xff"].iter().any(|mark| file.bytes.starts_with(*mark));
        (self.read)(file).map_err(|error| if is_utf16 { Utf16.into() } else { error })
    }

    /// Calls the reader's function `COMPANIONS`, which requests all companions of a file.
    #[doc(hidden)]
    pub fn ask_companions(&self, file: &InputFile<'_>) {
        if let Some(ask) = self.companions {
            ask(file);
        }
    }
}

/// The companion files of one file. Each companion is read only once, even if the file refers to it several times or by different paths.
#[doc(hidden)]
pub struct CompanionFiles<'a> {
    /// The folders in which companion files may be. A companion file outside of all these folders is not read.
    roots: &'a [PathBuf],
    /// The contents of the companion files, by their paths without symbolic links.
    contents: RefCell<HashMap<PathBuf, Arc<[u8]>>>,
    bytes: Cell<u64>,
}

/// Maximum allowed total size, in bytes, of the companions of one file. This is also the maximum size of a GLB file.
const MAX_BYTES: u64 = 4 << 30;

impl<'a> CompanionFiles<'a> {
    #[doc(hidden)]
    pub fn new(roots: &'a [PathBuf]) -> Self {
        Self { roots, contents: RefCell::default(), bytes: Cell::new(0) }
    }

    /// Returns the content of the companion file `name`, whose path is `path`. Returns an error if the file cannot be read, is outside of
    /// the allowed folders, or is too large.
    #[doc(hidden)]
    pub fn read(&self, name: &str, path: &Path) -> Result<Arc<[u8]>, String> {
        may_read(name, path, self.roots).map_err(|problem| match problem {
            PathError::Outside { message, .. } | PathError::Missing { message, .. } => message,
        })?;
        let failed = |error: std::io::Error| format!("cannot read {name}: {error}");
        let real = std::fs::canonicalize(path).map_err(failed)?;
        if let Some(known) = self.contents.borrow().get(&real) {
            return Ok(known.clone());
        }
        let length = std::fs::metadata(&real).map_err(failed)?.len();
        if MAX_BYTES - self.bytes.get() < length {
            return Err(format!(
                "cannot read {name}: the files that are named have more than {} GB together",
                MAX_BYTES >> 30
            ));
        }
        let content: Arc<[u8]> = fs::read(&real).map_err(failed)?.into();
        self.bytes.set(self.bytes.get() + length);
        self.contents.borrow_mut().insert(real, content.clone());
        Ok(content)
    }
}
