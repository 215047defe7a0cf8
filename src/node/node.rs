//! A step of a graph: its ports, its files, and what it is given when it runs.

use std::any::type_name;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use maquette_syntax::error::{Cancelled, Error};
use maquette_syntax::{FILE, LINK};
use maquette_value::plain::{ending, without_mark};
use maquette_value::{AnyValue, Hash, Memo, Value, ValueType, hash_of_memo, value_type};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use serde_json::json;

use super::*;
use crate::limit::Estimate;
use crate::reading::{NoReader, Readers, Reading};

/// One step of a graph, and its whole description.
///
/// A field of type [`In<T>`], `Option<In<T>>` or `Vec<In<T>>` is a port, a field of type [`FilePath`] a file to read, every
/// other field a parameter. The doc comments of the type and its fields are the user's manual; `#[schemars(range(..))]` says which
/// numbers a parameter takes, and `#[schemars(extend("unit" = "mm"))]` the unit that manual and messages print beside them.
pub trait Node: Serialize + DeserializeOwned + JsonSchema + Send + Sync + 'static {
    /// What it gives: a tuple of values.
    type Outputs: Outputs;

    /// The names of its outputs, the first being the one that a link without a name means.
    const OUTPUTS: <Self::Outputs as Outputs>::Names;

    /// What it wants of the values that come in, beyond their types.
    const WANTS: &'static [Want<Self>] = &[];

    /// What it promises of the values that it gives, beyond their types: only what holds for all values that it accepts.
    const PROMISES: &'static [Promise<Self>] = &[];

    /// What becomes of the attributes of meshes, points and range images, for each port that takes and each output that gives some.
    const CARRIES: &'static [Carry] = &[];

    /// Files that it reads if they are there, beside those that its fields name.
    fn files(&self) -> Vec<FilePath> {
        Vec::new()
    }

    /// How much memory [`eval`](Self::eval) will need at most, told before it runs; none if nobody can say. A node whose result may
    /// be much larger than its inputs says it, so that it is refused with numbers instead of the program being killed.
    ///
    /// It sees the same context, so that it knows how large the inputs are, and must be quick: it counts, and allocates nothing
    /// large. Of two runs on equal inputs it says the same.
    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let _ = cx;
        None
    }

    /// Computes the outputs: a pure function of the parameters, the inputs and the files, the same bytes for any number of
    /// threads.
    ///
    /// # Errors
    /// Whatever is wrong with the inputs; the message says what, not where.
    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error>;

    /// What [`eval`](Self::eval) gives, made of what it gave for other inputs: the very bytes, and the same warnings. For nodes that have
    /// little to do where little has changed; none where nothing is gained, so that `eval` is asked. A node that gives something for
    /// little to do where little has changed; none where nothing is gained, so that `eval` is asked. A node that gives something for
    /// unchanged inputs is held to this by `maquette::conformance`.
    ///
    /// # Errors
    /// Those of `eval`.
    fn update(
        &self,
        cx: &Context<'_>,
        previous: &Previous<'_>,
    ) -> Result<Option<Self::Outputs>, Error> {
        let _ = (cx, previous);
        Ok(None)
    }
}

/// A type that a port takes or an output gives: a [`Value`], or a [`union`](crate::union!) of some.
pub trait PortType: Sized + 'static {
    /// The name of the value or of the union.
    const NAME: &'static str;

    /// What [`Context::get`] gives: `&T` for a value, the union itself for a union.
    type Ref<'a>;

    /// The values that fit.
    fn types() -> Vec<&'static ValueType>;

    /// The value as this type, if it fits.
    fn get(value: &AnyValue) -> Option<Self::Ref<'_>>;

    /// The value for a link.
    fn into_any(self) -> AnyValue;
}

impl<T: Value> PortType for T {
    const NAME: &'static str = T::NAME;

    type Ref<'a> = &'a T;

    fn types() -> Vec<&'static ValueType> {
        vec![value_type::<T>()]
    }

    fn get(value: &AnyValue) -> Option<&T> {
        value.get()
    }

    fn into_any(self) -> AnyValue {
        AnyValue::new(self)
    }
}

/// Declares a union of values, for a port that takes one of several types:
/// `union! { /// Doc. pub enum Solid { Mesh(Mesh), Surface(Surface) } }`.
///
/// An output of the same union has the type that came in.
#[macro_export]
macro_rules! union {
    ($(#[$doc:meta])* $vis:vis enum $name:ident { $($variant:ident($value:ty)),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Clone, Debug)]
        $vis enum $name {
            $(#[doc = concat!("A `", stringify!($variant), "`.")] $variant($value)),+
        }

        impl $crate::PortType for $name {
            const NAME: &'static str = stringify!($name);

            type Ref<'a> = Self;

            fn types() -> Vec<&'static $crate::ValueType> {
                vec![$($crate::value_type::<$value>()),+]
            }

            fn get(value: &$crate::AnyValue) -> Option<Self> {
                $(if let Some(value) = value.get::<$value>() {
                    return Some(Self::$variant(value.clone()));
                })+
                None
            }

            fn into_any(self) -> $crate::AnyValue {
                match self {
                    $(Self::$variant(value) => $crate::AnyValue::new(value)),+
                }
            }
        }
    };
}

/// The outputs of a node: a tuple of one to four values.
pub trait Outputs: Sized + 'static {
    /// One name per output: `[&'static str; N]`.
    type Names: AsRef<[&'static str]>;

    /// The type of each output: the name of a value or union, and the values it may be.
    fn types() -> Vec<(&'static str, Vec<&'static ValueType>)>;

    /// The values for links, in order.
    fn into_any(self) -> Vec<AnyValue>;
}

macro_rules! outputs {
    ($count:literal: $($type:ident $index:tt),+) => {
        impl<$($type: PortType),+> Outputs for ($($type,)+) {
            type Names = [&'static str; $count];

            fn types() -> Vec<(&'static str, Vec<&'static ValueType>)> {
                vec![$(($type::NAME, $type::types())),+]
            }

            fn into_any(self) -> Vec<AnyValue> {
                vec![$(self.$index.into_any()),+]
            }
        }
    };
}

outputs!(1: A 0);
outputs!(2: A 0, B 1);
outputs!(3: A 0, B 1, C 2);
outputs!(4: A 0, B 1, C 2, D 3);

/// A port: takes a link to a `T`.
pub struct In<T> {
    pub(super) slot: usize,
    marker: PhantomData<fn() -> T>,
}

impl<T> Clone for In<T> {
    fn clone(&self) -> Self {
        Self { slot: self.slot, marker: PhantomData }
    }
}

impl<T> fmt::Debug for In<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "In({})", self.slot)
    }
}

impl<T> Serialize for In<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        BTreeMap::from([(LINK, self.slot)]).serialize(serializer)
    }
}

impl<'de, T> Deserialize<'de> for In<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Slot;
        impl<'de> de::Visitor<'de> for Slot {
            type Value = usize;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a link")
            }

            fn visit_u64<E: de::Error>(self, slot: u64) -> Result<usize, E> {
                usize::try_from(slot).map_err(E::custom)
            }
        }
        let slot = deserializer.deserialize_newtype_struct(LINK, Slot)?;
        Ok(Self { slot, marker: PhantomData })
    }
}

impl<T: PortType> JsonSchema for In<T> {
    fn schema_name() -> Cow<'static, str> {
        format!("In<{}>", T::NAME).into()
    }

    fn inline_schema() -> bool {
        true
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let types = Vec::from_iter(T::types().iter().map(|kind| kind.name));
        json_schema!({ "port": T::NAME, "types": types })
    }
}

/// A file that a node reads: a path relative to the graph's file. Empty means none.
///
/// The evaluator reads it; its content, not its path, is part of the node's key.
///
/// A field that takes only files of certain endings says so, and the check refuses all others before anything runs:
/// `#[schemars(extend("endings" = ["obj", "ply"]))]`, in lower case, without the dot; `extend("reads" = "Mesh")` stands for those
/// from which the program's packs read that type of values.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FilePath {
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

/// How far a node is, and whether it should stop.
#[derive(Clone, Default)]
pub struct Progress<'a> {
    #[doc(hidden)]
    pub report: Option<&'a (dyn Fn(f64) + Sync)>,
    #[doc(hidden)]
    pub cancel: Option<&'a CancelToken>,
}

impl Progress<'_> {
    /// Reports to nobody and never stops: for calling an algorithm without a graph.
    pub fn none() -> Self {
        Self::default()
    }

    /// Whether to go on, where the share of the work that is done is not known. Call it at least every 50 ms.
    ///
    /// # Errors
    /// If the evaluation was told to stop.
    pub fn check(&self) -> Result<(), Cancelled> {
        if self.cancel.is_some_and(CancelToken::is_cancelled) { Err(Cancelled) } else { Ok(()) }
    }

    /// Says that this share of the work (0 to 1) is done. Call it at least every 50 ms.
    ///
    /// # Errors
    /// If the evaluation was told to stop.
    pub fn tick(&self, share: f64) -> Result<(), Cancelled> {
        self.check()?;
        if let Some(report) = self.report {
            report(share);
        }
        Ok(())
    }

    /// Lets a part of the work tell its own share (0 to 1), which is this range of the whole.
    pub fn part<R>(&self, range: Range<f64>, work: impl FnOnce(&Progress<'_>) -> R) -> R {
        let Some(report) = self.report else { return work(self) };
        let of_whole = |share: f64| report(range.start + (range.end - range.start) * share);
        work(&Progress { report: Some(&of_whole), cancel: self.cancel })
    }
}

/// Tells an evaluation to stop.
#[derive(Clone, Debug, Default)]
pub struct CancelToken(Arc<std::sync::atomic::AtomicBool>);

impl CancelToken {
    /// Stops every evaluation that holds this token.
    pub fn cancel(&self) {
        self.0.store(true, std::sync::atomic::Ordering::Relaxed);
    }

    /// Whether somebody did.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(std::sync::atomic::Ordering::Relaxed)
    }
}

/// Where memoized results live.
#[doc(hidden)]
pub trait Memos: Sync {
    fn find(&self, key: Hash) -> Option<AnyValue>;
    fn keep(&self, key: Hash, value: &AnyValue);
}

pub(super) fn at_port<'a, T: PortType>(inputs: &'a [AnyValue], port: &In<T>) -> T::Ref<'a> {
    let value = &inputs[port.slot];
    T::get(value).unwrap_or_else(|| {
        panic!("a {value:?} came to a port for {}; the check lets no such graph run", T::NAME)
    })
}

/// What a node sees of the world while it is evaluated.
pub struct Context<'a> {
    #[doc(hidden)]
    pub inputs: &'a [AnyValue],
    #[doc(hidden)]
    pub files: &'a BTreeMap<PathBuf, Option<File>>,
    #[doc(hidden)]
    pub progress: Progress<'a>,
    #[doc(hidden)]
    pub memos: Option<&'a dyn Memos>,
    #[doc(hidden)]
    pub readers: &'a Readers,
    #[doc(hidden)]
    pub warnings: Mutex<Vec<String>>,
}

impl Context<'_> {
    /// The value at a port.
    pub fn get<T: PortType>(&self, port: &In<T>) -> T::Ref<'_> {
        at_port(self.inputs, port)
    }

    /// A file that a field of the node names.
    ///
    /// # Errors
    /// If the file is not there or cannot be read.
    pub fn file(&self, path: &FilePath) -> Result<&File, Error> {
        match self.files.get(path.resolved()) {
            Some(Some(file)) => Ok(file),
            _ => Err(ReadError { name: path.given.clone(), reason: "no such file".into() }.into()),
        }
    }

    /// The value in a file that a field of the node names, by whatever reader the program's packs have for its ending; the
    /// reader's warnings become the node's. Such a field says `#[schemars(extend("reads" = "Mesh"))]`.
    ///
    /// # Errors
    /// If the file is not there, nothing reads such files, or the reader fails.
    pub fn read<T: Value>(&self, path: &FilePath) -> Result<T, Error> {
        let file = self.file(path)?;
        let beside = |name: &str| file.companion(name);
        let reading = Reading::new(file.name(), file.bytes(), &beside);
        // Where nothing reads such files, the error names the ending.
        let named = |error: Error| match error.downcast::<NoReader>() {
            Some(_) => error,
            None => error.in_file(file.name()),
        };
        let value = self.readers.read(value_type::<T>(), &reading).map_err(named)?;
        reading.doubts().into_iter().for_each(|doubt| self.warn(doubt));
        match value.get::<T>() {
            Some(value) => Ok(value.clone()),
            None => {
                panic!("two types of values are called {}; conformance::check finds this", T::NAME)
            }
        }
    }

    /// A file that the node may do without: one that [`Node::files`] lists.
    pub fn file_if_any(&self, path: &FilePath) -> Option<&File> {
        self.files.get(path.resolved()).and_then(Option::as_ref)
    }

    /// Progress and cancel, for an algorithm that runs long.
    pub fn progress(&self) -> &Progress<'_> {
        &self.progress
    }

    /// Says that this share of the work (0 to 1) is done.
    ///
    /// # Errors
    /// If the evaluation was told to stop.
    pub fn tick(&self, share: f64) -> Result<(), Cancelled> {
        self.progress.tick(share)
    }

    /// Tells the user of a doubt about the result.
    pub fn warn(&self, message: impl Into<String>) {
        self.warnings.lock().unwrap_or_else(|broken| broken.into_inner()).push(message.into());
    }

    /// The result of `make(part)`, computed once for equal parts, in this node and every other that asks the same function.
    ///
    /// `make` must be a plain `fn`, by its name: it cannot capture anything, so that the result depends on `part` alone.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn memo<P, T, F>(&self, part: &P, make: F) -> Result<T, Error>
    where
        P: Memo,
        T: Memo,
        F: Fn(&P) -> Result<T, Error>,
    {
        const { assert!(size_of::<F>() == 0, "the function of a memo must not capture anything") };
        let function = type_name::<F>();
        assert!(
            !function.contains("{{closure}}"),
            "the function of a memo must have a name: closures in one function cannot be told apart"
        );
        let key = Hash::of(format!("memo {function} {}", hash_of_memo(part)).as_bytes());
        let found = self.memos.and_then(|memos| memos.find(key));
        if let Some(value) = found.as_ref().and_then(AnyValue::memo::<T>) {
            return Ok(value.clone());
        }
        let value = make(part)?;
        if let Some(memos) = self.memos {
            memos.keep(key, &AnyValue::of_memo(value.clone()));
        }
        Ok(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_tells_its_share_of_the_whole() {
        let told = Mutex::new(Vec::new());
        let report = |share: f64| told.lock().unwrap().push(share);
        let progress = Progress { report: Some(&report), cancel: None };
        progress
            .part(0.5..1.0, |half| {
                half.tick(0.0)?;
                half.part(0.0..0.5, |quarter| quarter.tick(1.0))
            })
            .unwrap();
        assert_eq!(*told.lock().unwrap(), [0.5, 0.75]);
    }
}
