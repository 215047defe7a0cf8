//! What a node sees while it runs: its inputs, its files, progress and the wish to stop.

use std::any::type_name;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use maquette_syntax::error::{Cancelled, Error};
use maquette_value::{AnyValue, Hash, Memo, Value, hash_of_memo, value_type};

use crate::file::{File, FilePath, ReadError};
use crate::port::{In, PortType, at_port};
use crate::reading::{ColorRange, NoReader, Readers, Reading};

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
            _ => {
                Err(ReadError { name: path.given().to_owned(), reason: "no such file".into() }
                    .into())
            }
        }
    }

    /// The value in a file that a field of the node names, by whatever reader the program's packs have for its ending; the
    /// reader's warnings become the node's. Such a field says `#[schemars(extend("reads" = "Mesh"))]`.
    ///
    /// # Errors
    /// If the file is not there, nothing reads such files, or the reader fails.
    pub fn read<T: Value>(&self, path: &FilePath) -> Result<T, Error> {
        self.read_with_colors(path, None)
    }

    /// The same, with the range of colors in files that do not say it, if the user knows it.
    ///
    /// # Errors
    /// Those of [`read`](Self::read).
    pub fn read_with_colors<T: Value>(
        &self,
        path: &FilePath,
        range: Option<ColorRange>,
    ) -> Result<T, Error> {
        let file = self.file(path)?;
        let beside = |name: &str| file.companion(name);
        let reading = Reading::new(file.name(), file.bytes(), &beside).with_color_range(range);
        // Where nothing reads such files, the error names the ending.
        let value = self.readers.read(value_type::<T>(), &reading).map_err(|error: Error| {
            match error.downcast::<NoReader>() {
                Some(_) => error,
                None => error.in_file(file.name()),
            }
        })?;
        reading.doubts().into_iter().for_each(|doubt| self.warn(doubt));
        match value.get::<T>() {
            Some(value) => Ok(value.clone()),
            None => {
                panic!("two types of values are called {}; conformance::check finds this", T::NAME)
            }
        }
    }

    /// A file that the node may do without: one that [`Node::files`](crate::Node::files) lists.
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
