//! The context of a running node: its inputs, its files, progress reports, and cancellation.

use std::any::{Any, type_name};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex};
use std::thread::{Builder, scope};
use std::time::Duration;

use maquette_syntax::error::{CancelledError, Error};
use maquette_value::parallel::{Meter, stoppable};
use maquette_value::{AnyValue, Hash, Memo, Value, hash_of_memo, value_type};

use crate::blocks::PointBlock;
use crate::file::{File, FilePath, ReadError};
use crate::importers::{ColorRange, InputFile, NoReader, NotInBlocks, Readers};
use crate::port::{In, PortType, value_at};

/// Progress reporting and cancellation.
#[derive(Clone, Default)]
pub struct Progress<'a> {
    #[doc(hidden)]
    pub report: Option<&'a (dyn Fn(f64) + Sync)>,
    #[doc(hidden)]
    pub cancel: Option<&'a CancelToken>,
}

impl Progress<'_> {
    /// Returns a `Progress` that reports nothing and is never cancelled, for running algorithms outside of a graph.
    pub fn silent() -> Self {
        Self::default()
    }

    /// Checks for cancellation. Use this instead of `tick` if the completed fraction of the work is unknown. Call it at least every 50 ms.
    ///
    /// # Errors
    /// The evaluation was cancelled.
    pub fn check(&self) -> Result<(), CancelledError> {
        if self.cancel.is_some_and(CancelToken::is_cancelled) {
            Err(CancelledError)
        } else {
            Ok(())
        }
    }

    /// Reports the completed fraction of the work, from 0 to 1, and checks for cancellation. Call it at least every 50 ms.
    ///
    /// # Errors
    /// The evaluation was cancelled.
    pub fn tick(&self, fraction: f64) -> Result<(), CancelledError> {
        self.check()?;
        if let Some(report) = self.report {
            report(fraction);
        }
        Ok(())
    }

    /// Runs a part of the work. The progress of the part, from 0 to 1, is mapped to `range` in the progress of the whole work.
    pub fn part<R>(&self, range: Range<f64>, work: impl FnOnce(&Progress<'_>) -> R) -> R {
        let Some(report) = self.report else { return work(self) };
        work(&Progress {
            report: Some(&|fraction| report(range.start + (range.end - range.start) * fraction)),
            cancel: self.cancel,
        })
    }

    /// Runs `work`, which does not report its progress. Its progress is the number of items that its loops have visited, as a fraction of
    /// `total`; see [`Meter`].
    pub fn metered<R>(&self, total: usize, work: impl FnOnce() -> R) -> R {
        let Some(report) = self.report.filter(|_| MIN_METERED <= total) else { return work() };
        let meter = Arc::new(Meter::default());
        let (over, ended) = channel::<()>();
        scope(|scope| {
            let watched = meter.clone();
            let watch = move || {
                while ended.recv_timeout(INTERVAL) == Err(RecvTimeoutError::Timeout) {
                    report((watched.items() as f64 / total as f64).min(1.0));
                }
            };
            // Ignore an error: if the thread cannot be started, no progress is reported.
            let _ = Builder::new().spawn_scoped(scope, watch);
            let result = meter.measure(work);
            drop(over);
            result
        })
    }
}

/// The minimum number of items whose progress is measured: fewer take less time than a thread.
const MIN_METERED: usize = 2_000_000;

/// The time between two reports of measured progress.
const INTERVAL: Duration = Duration::from_millis(200);

/// A token that cancels evaluations.
#[derive(Clone, Debug, Default)]
pub struct CancelToken(Arc<std::sync::atomic::AtomicBool>);

impl CancelToken {
    /// Cancels every evaluation that holds this token or a clone of it.
    pub fn cancel(&self) {
        self.0.store(true, std::sync::atomic::Ordering::Relaxed);
    }

    /// Returns true after [`cancel`](Self::cancel) was called.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(std::sync::atomic::Ordering::Relaxed)
    }

    /// Calls `work`. Its parallel loops stop soon after the token was cancelled, without being asked to look.
    ///
    /// # Errors
    /// The evaluation was cancelled.
    #[doc(hidden)]
    pub fn stops<T>(&self, work: impl FnOnce() -> T) -> Result<T, CancelledError> {
        stoppable(&self.0, work).ok_or(CancelledError)
    }
}

/// A cache of the results of [`Context::memo`], which the evaluator provides.
#[doc(hidden)]
pub trait Memos: Sync {
    fn find(&self, key: Hash) -> Option<AnyValue>;
    fn keep(&self, key: Hash, value: &AnyValue);
}

/// The data and functions that a node can access while it is evaluated.
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
    /// The points that take the place of a file, if the node reads it block by block.
    #[doc(hidden)]
    pub block: Option<&'a PointBlock>,
    #[doc(hidden)]
    pub warnings: Mutex<Vec<String>>,
}

impl Context<'_> {
    /// Returns the value that is linked to a port.
    pub fn get<T: PortType>(&self, port: &In<T>) -> T::Ref<'_> {
        value_at(self.inputs, port)
    }

    /// Returns the file whose path is in the field `path` of the node.
    ///
    /// # Errors
    /// The file does not exist or cannot be read.
    pub fn file(&self, path: &FilePath) -> Result<&File, Error> {
        match self.files.get(path.resolved_path()) {
            Some(Some(file)) => Ok(file),
            _ => {
                Err(ReadError { name: path.name().to_owned(), reason: "no such file".into() }
                    .into())
            }
        }
    }

    /// Reads a value from the file whose path is in the field `path` of the node. The program's packs provide a reader for the file's
    /// extension. Warnings of the reader become warnings of the node. The field must have the attribute `#[schemars(extend("reads" =
    /// "Mesh"))]`.
    ///
    /// # Errors
    /// The file does not exist, no reader supports its extension, or the reader fails.
    pub fn read<T: Value>(&self, path: &FilePath) -> Result<T, Error> {
        self.read_with_colors(path, None)
    }

    /// Like [`read`](Self::read). `range` is the maximum value of a color channel, for file formats that do not specify it.
    ///
    /// # Errors
    /// The errors of [`read`](Self::read).
    pub fn read_with_colors<T: Value>(
        &self,
        path: &FilePath,
        range: Option<ColorRange>,
    ) -> Result<T, Error> {
        if let Some(block) = self.block {
            let points: &dyn Any = block.read(range)?;
            return points.downcast_ref::<T>().cloned().ok_or_else(|| NotInBlocks.into());
        }
        let file = self.file(path)?;
        let beside = |name: &str| file.companion(name);
        let reading = InputFile::new(file.name(), file.bytes(), &beside).with_color_range(range);
        // The error that no reader exists already contains the extension, so do not add the file name.
        let value = self.readers.read(value_type::<T>(), &reading).map_err(|error: Error| {
            match error.downcast::<NoReader>() {
                Some(_) => error,
                None => error.with_file(file.name()),
            }
        })?;
        reading.warnings().into_iter().for_each(|doubt| self.warn(doubt));
        match value.get::<T>() {
            Some(value) => Ok(value.clone()),
            None => {
                panic!("two types of values are called {}; conformance::check finds this", T::NAME)
            }
        }
    }

    /// Returns the content of an optional file, which must be in the list that [`Node::files`](crate::Node::files) returns. `None` if it
    /// does not exist.
    pub fn file_if_any(&self, path: &FilePath) -> Option<&File> {
        self.files.get(path.resolved_path()).and_then(Option::as_ref)
    }

    /// Returns the object that long-running algorithms use to report progress and to check for cancellation.
    pub fn progress(&self) -> &Progress<'_> {
        &self.progress
    }

    /// Reports the completed fraction of the work, from 0 to 1, and checks for cancellation.
    ///
    /// # Errors
    /// The evaluation was cancelled.
    pub fn tick(&self, fraction: f64) -> Result<(), CancelledError> {
        self.progress.tick(fraction)
    }

    /// Adds a warning about the result.
    pub fn warn(&self, message: impl Into<String>) {
        self.warnings.lock().unwrap_or_else(|broken| broken.into_inner()).push(message.into());
    }

    /// Returns `make(part)`. The result is cached, and shared by all nodes that call the same function with equal arguments.
    ///
    /// `make` must be a named `fn`, which captures no variables, so that its result depends only on `part`.
    ///
    /// # Errors
    /// The errors of `make`.
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
            "the function of a memo must have a name: closures in one function cannot be distinguished"
        );
        let key = Hash::compute(format!("memo {function} {}", hash_of_memo(part)).as_bytes());
        let found = self.memos.and_then(|memos| memos.find(key));
        if let Some(value) = found.as_ref().and_then(AnyValue::memo::<T>) {
            return Ok(value.clone());
        }
        let value = make(part)?;
        if let Some(memos) = self.memos {
            memos.keep(key, &AnyValue::from_memo(value.clone()));
        }
        Ok(value)
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::parallel::{IntoParallel, Parallel};

    use super::*;

    #[test]
    fn progress_of_a_part_is_mapped_to_the_whole() {
        let reported = Mutex::new(Vec::new());
        let report = |fraction: f64| reported.lock().unwrap().push(fraction);
        let progress = Progress { report: Some(&report), cancel: None };
        progress
            .part(0.5..1.0, |half| {
                half.tick(0.0)?;
                half.part(0.0..0.5, |quarter| quarter.tick(1.0))
            })
            .unwrap();
        assert_eq!(*reported.lock().unwrap(), [0.5, 0.75]);
    }

    #[test]
    fn progress_of_loops_is_measured() {
        let reported = Mutex::new(Vec::new());
        let report = |fraction: f64| reported.lock().unwrap().push(fraction);
        let progress = Progress { report: Some(&report), cancel: None };
        let total = 2 * MIN_METERED;
        progress.part(0.5..1.0, |half| {
            half.metered(total, || {
                (0..total / 2).into_par_iter().for_each(drop);
                while reported.lock().unwrap().is_empty() {
                    std::thread::sleep(INTERVAL / 10);
                }
            });
        });
        let reported = reported.into_inner().unwrap();
        assert!(reported.iter().all(|fraction| (0.74..=0.75).contains(fraction)), "{reported:?}");
    }
}
