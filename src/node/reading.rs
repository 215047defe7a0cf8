//! Files that become values: what reads which, by the type that is wanted and the ending of the file's name.

use std::cell::{Cell, RefCell};
use std::cmp::Reverse;
use std::collections::HashMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_syntax::error::Error;
use maquette_syntax::paths::{PathProblem, may_read, project_root};
use maquette_value::plain;
use maquette_value::plain::{ending, without_mark};
use maquette_value::{AnyValue, Mesh, Value, ValueType, value_type};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::fidelity::Fidelities;

/// A way to read one type of values from one kind of files.
pub trait FileReader {
    /// What it reads.
    type Value: Value;

    /// The endings of such files' names, in lower case, without the dot.
    const ENDINGS: &'static [&'static str];

    /// What it keeps of a mesh or of points in a file, for `maquette help formats`.
    const FIDELITY: Fidelities = &[];

    /// The value in the file. It never panics, and reserves no more memory than a small multiple of the bytes that are there,
    /// whatever the file says of itself.
    ///
    /// # Errors
    /// If the bytes are no such file; the message says where and what.
    fn read(file: &Reading<'_>) -> Result<Self::Value, Error>;

    /// Asks for every file that [`read`](Self::read) may ask for ([`Reading::companion`]), if such files name others. What a node reads
    /// is a part of the file then, as materials are of an OBJ file: results are computed again when it changes, and a watch listens
    /// to it. As `read`, it never panics.
    const COMPANIONS: Option<fn(&Reading<'_>)> = None;
}

/// The largest number of a color channel, in files that do not say it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum ColorRange {
    /// Channels go from 0 to 1.
    To1,
    /// Channels go from 0 to 255.
    To255,
    /// Channels go from 0 to 65535.
    To65535,
}

/// Finds a file that another one names, or says why not.
pub type Beside<'a> = dyn Fn(&str) -> Result<Arc<[u8]>, String> + 'a;

/// A file that is being read.
pub struct Reading<'a> {
    name: &'a str,
    bytes: &'a [u8],
    beside: &'a Beside<'a>,
    color_range: Option<ColorRange>,
    doubts: RefCell<Vec<String>>,
}

impl<'a> Reading<'a> {
    /// A file of this name and content; `beside` finds the files that it names, or says why not.
    pub fn new(name: &'a str, bytes: &'a [u8], beside: &'a Beside<'a>) -> Self {
        let (bytes, color_range) = (without_mark(bytes), None);
        Self { name, bytes, beside, color_range, doubts: RefCell::default() }
    }

    /// The same file, where the user says the range of its colors.
    #[must_use]
    pub fn with_color_range(mut self, range: Option<ColorRange>) -> Self {
        self.color_range = range;
        self
    }

    /// The range of colors as the user says it. If `None`, a reader of a format that does not say it decides by all colors.
    pub fn color_range(&self) -> Option<ColorRange> {
        self.color_range
    }

    /// A file by itself: whatever it names is not there.
    pub fn alone(name: &'a str, bytes: &'a [u8]) -> Self {
        Self::new(name, bytes, &|name| Err(format!("{name} is not there")))
    }

    /// Its content, of a text without the mark of UTF-8 (EF BB BF, a "BOM") with which some editors begin it.
    pub fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// What stands behind the last dot of its name, in lower case; empty if nothing does.
    pub fn ending(&self) -> String {
        ending(self.name.as_ref())
    }

    /// The content of a file in the same folder that this one names, or that is always beside such files; of a text without its mark.
    ///
    /// # Errors
    /// If there is no such file, or it may not be read; the text says which.
    pub fn companion(&self, name: &str) -> Result<Arc<[u8]>, String> {
        let bytes = (self.beside)(name)?;
        let text = without_mark(&bytes);
        Ok(if text.len() < bytes.len() { text.into() } else { bytes })
    }

    /// Tells the user of a doubt about the file.
    pub fn doubt(&self, message: impl Into<String>) {
        self.doubts.borrow_mut().push(message.into());
    }

    /// All doubts so far.
    pub fn doubts(&self) -> Vec<String> {
        self.doubts.borrow().clone()
    }
}

/// What the engine knows of a reader of files. Made by [`reader()`].
#[derive(Clone, Copy)]
pub struct AnyReader {
    /// The endings of the files' names.
    pub endings: &'static [&'static str],
    kind: fn() -> &'static ValueType,
    read: fn(&Reading<'_>) -> Result<AnyValue, Error>,
    companions: Option<fn(&Reading<'_>)>,
    /// What it keeps of a mesh or of points in a file.
    #[doc(hidden)]
    pub fidelity: Fidelities,
}

/// The description of the reader `R` for the engine.
pub const fn reader<R: FileReader>() -> AnyReader {
    AnyReader {
        endings: R::ENDINGS,
        kind: value_type::<R::Value>,
        read: |file| R::read(file).map(AnyValue::new),
        companions: R::COMPANIONS,
        fidelity: R::FIDELITY,
    }
}

/// Nothing reads such a value from such a file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no {what} can be read from {}; known are {}", if ending.is_empty() { "a file without an ending".into() } else { format!("`.{ending}`") }, known.join(", "))]
pub struct NoReader {
    /// The type of values, or `value`.
    pub what: &'static str,
    /// The ending of the file's name.
    pub ending: String,
    /// The endings that are read.
    pub known: Vec<&'static str>,
}

/// Why a file is none of the types of values that files of its ending may hold.
#[derive(Debug, thiserror::Error)]
#[error("{}", self.in_words())]
struct NotRead(Vec<(Vec<&'static str>, Error)>);

impl NotRead {
    /// What is wrong with it as each type of values; what is wrong for most of them comes first.
    fn of(refused: Vec<(&'static str, Error)>) -> Error {
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

    fn in_words(&self) -> String {
        let words =
            |(kinds, reason): &(Vec<_>, Error)| format!("as {}: {reason}", kinds.join(" or "));
        self.0.iter().map(words).collect::<Vec<_>>().join("; ")
    }
}

/// Some editors write texts so, and no reader knows them.
#[derive(Debug, thiserror::Error)]
#[error("it is text in UTF-16: save it as UTF-8")]
struct Utf16;

/// The readers of some packs.
#[derive(Clone, Default)]
#[doc(hidden)]
pub struct Readers(Vec<AnyReader>);

impl Readers {
    /// All of them, in the packs' order.
    #[doc(hidden)]
    pub fn all(&self) -> &[AnyReader] {
        &self.0
    }

    #[doc(hidden)]
    pub fn new(readers: impl IntoIterator<Item = AnyReader>) -> Self {
        Self(readers.into_iter().collect())
    }

    /// The endings of files that hold a value of this type, or any; in the packs' order.
    #[doc(hidden)]
    pub fn endings(&self, kind: Option<&str>) -> Vec<&'static str> {
        let mut endings: Vec<&str> = Vec::new();
        for &ending in self
            .0
            .iter()
            .filter(|reader| kind.is_none_or(|kind| reader.kind().name == kind))
            .flat_map(|reader| reader.endings)
        {
            if !endings.contains(&ending) {
                endings.push(ending);
            }
        }
        endings
    }

    /// The value of this type in a file.
    #[doc(hidden)]
    pub fn read(&self, kind: &ValueType, file: &Reading<'_>) -> Result<AnyValue, Error> {
        let ending = file.ending();
        let fits =
            |reader: &&AnyReader| reader.kind() == kind && reader.endings.contains(&&ending[..]);
        match self.0.iter().find(fits) {
            Some(reader) => reader.call(file),
            None => {
                let known = self.endings(Some(kind.name));
                Err(NoReader { what: kind.name, ending, known }.into())
            }
        }
    }

    /// The value in a file, of whatever type: of the first reader of its ending that finds something in it.
    ///
    /// # Errors
    /// If none does: what each of them says.
    #[doc(hidden)]
    pub fn read_any(&self, file: &Reading<'_>) -> Result<AnyValue, Error> {
        let ending = file.ending();
        let (mut bare, mut refused) = (None, Vec::new());
        for reader in self.0.iter().filter(|reader| reader.endings.contains(&&ending[..])) {
            match reader.call(file) {
                // A mesh without faces is a cloud, or a line.
                Ok(value) if value.get::<Mesh>().is_some_and(|mesh| mesh.faces().is_empty()) => {
                    bare = bare.or(Some(value));
                }
                Ok(value) => return Ok(value),
                Err(error) => refused.push((reader.kind().name, error)),
            }
        }
        match (bare, refused.is_empty()) {
            (Some(value), _) => Ok(value),
            (None, false) => Err(NotRead::of(refused)),
            (None, true) => {
                let known = self.endings(None);
                Err(NoReader { what: "value", ending, known }.into())
            }
        }
    }

    /// Whether files of this ending may name others.
    #[doc(hidden)]
    pub fn may_name(&self, ending: &str) -> bool {
        fn names(reader: &AnyReader) -> bool {
            reader.companions.is_some()
        }
        self.0.iter().any(|reader| names(reader) && reader.endings.contains(&ending))
    }

    /// Asks for all files that a file names, whatever type of values is read from it.
    #[doc(hidden)]
    pub fn ask_companions(&self, file: &Reading<'_>) {
        let ending = file.ending();
        self.0
            .iter()
            .filter(|reader| reader.endings.contains(&&ending[..]))
            .for_each(|reader| reader.ask_companions(file));
    }

    /// The value of this type, or of any, in the file at a path, and what is to be doubted of it. Files that it names are read, too, if
    /// they lie in its project.
    ///
    /// # Errors
    /// If it cannot be read: which file, and why.
    #[doc(hidden)]
    pub fn open(
        &self,
        path: &Path,
        kind: Option<&ValueType>,
    ) -> Result<(AnyValue, Vec<String>), String> {
        self.open_noting(path, kind, &|_| {})
    }

    /// The same; `asked` is called with the path of each file that it names, before that is read.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    #[doc(hidden)]
    pub fn open_noting(
        &self,
        path: &Path,
        kind: Option<&ValueType>,
        asked: &dyn Fn(&Path),
    ) -> Result<(AnyValue, Vec<String>), String> {
        fn wrong(error: &dyn fmt::Display, path: &Path) -> String {
            format!("cannot read {}: {error}", path.display())
        }
        let bytes = plain::read(path).map_err(|error| wrong(&error, path))?;
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = std::fs::canonicalize(folder.unwrap_or(Path::new(".")));
        let folder = folder.map_err(|error| wrong(&error, path))?;
        let roots = [project_root(&folder)];
        let companions = CompanionFiles::new(&roots);
        let beside = |name: &str| {
            let path = folder.join(name);
            asked(&path);
            companions.read(name, &path)
        };
        let name = path.to_string_lossy();
        let reading = Reading::new(&name, &bytes, &beside);
        let value = match kind {
            Some(kind) => self.read(kind, &reading),
            None => self.read_any(&reading),
        };
        Ok((value.map_err(|error| wrong(&error, path))?, reading.doubts()))
    }
}

impl AnyReader {
    /// The type of values that it reads.
    #[doc(hidden)]
    pub fn kind(&self) -> &'static ValueType {
        (self.kind)()
    }

    /// Where its code is.
    #[doc(hidden)]
    pub fn code(&self) -> usize {
        self.read as usize
    }

    /// Reads a file, whatever its name is.
    #[doc(hidden)]
    pub fn call(&self, file: &Reading<'_>) -> Result<AnyValue, Error> {
        let is_utf16 = [b"\xff\xfe", b"\xfe\xff"].iter().any(|mark| file.bytes.starts_with(*mark));
        (self.read)(file).map_err(|error| if is_utf16 { Utf16.into() } else { error })
    }

    /// Asks for the files that a file names.
    #[doc(hidden)]
    pub fn ask_companions(&self, file: &Reading<'_>) {
        if let Some(ask) = self.companions {
            ask(file);
        }
    }
}

/// The files that one file names. Each is read once, however often it is named and however its name is spelled.
#[doc(hidden)]
pub struct CompanionFiles<'a> {
    /// The folders that they must lie in.
    roots: &'a [PathBuf],
    /// The contents, by real path.
    contents: RefCell<HashMap<PathBuf, Arc<[u8]>>>,
    bytes: Cell<u64>,
}

/// The files that one file names have at most this many bytes together, as many as a GLB file can hold.
const MAX_BYTES: u64 = 4 << 30;

impl<'a> CompanionFiles<'a> {
    #[doc(hidden)]
    pub fn new(roots: &'a [PathBuf]) -> Self {
        Self { roots, contents: RefCell::default(), bytes: Cell::new(0) }
    }

    /// Returns the content of the file `name`, which is at `path`, if it may be read.
    #[doc(hidden)]
    pub fn read(&self, name: &str, path: &Path) -> Result<Arc<[u8]>, String> {
        may_read(name, path, self.roots).map_err(|problem| match problem {
            PathProblem::Outside { message, .. } | PathProblem::Missing { message, .. } => message,
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
        let content: Arc<[u8]> = plain::read(&real).map_err(failed)?.into();
        self.bytes.set(self.bytes.get() + length);
        self.contents.borrow_mut().insert(real, content.clone());
        Ok(content)
    }
}
