//! Decides when a group of file changes is complete, so that the graph can be evaluated. This module uses no clock and reads no files.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The time without further changes after which the change of a single file is complete. The steps of one save in an editor (write, rename,
/// set the time) take up to 2 ms. With a longer time every evaluation would be delayed. With a shorter one, half of a save could be
/// evaluated.
const MIN_QUIET: Duration = Duration::from_millis(10);

/// The time without further changes after which the change of several files is complete. Copying or checking out files takes at most a few
/// milliseconds from one file to the next.
const MIN_QUIET_AFTER_SEVERAL: Duration = Duration::from_millis(30);

/// The maximum wait after the first change, so that continuous saves do not delay the evaluation forever. A file that is empty or missing
/// may be in the middle of a save, and is waited for as long.
const MAX_WAIT: Duration = Duration::from_millis(150);

/// The state of a file, which shows if a save may still be in progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FileState {
    /// The file has content, so it is assumed to be complete.
    Complete,
    /// The file is empty or missing, so a save may be in progress.
    Unfinished,
}

impl FileState {
    pub(crate) fn is_complete(self) -> bool {
        self == Self::Complete
    }
}

/// A group of changes that are evaluated together.
#[derive(Debug, Default)]
pub(crate) struct Batch {
    files: BTreeSet<PathBuf>,
    unfinished: BTreeSet<PathBuf>,
    /// The times of the first and the last change.
    times: Option<(Instant, Instant)>,
}

impl Batch {
    /// Records that a file has new content.
    pub(crate) fn record_change(&mut self, file: &Path, shape: FileState, now: Instant) {
        self.files.insert(file.to_owned());
        match shape {
            FileState::Complete => self.unfinished.remove(file),
            FileState::Unfinished => self.unfinished.insert(file.to_owned()),
        };
        let first = self.times.map_or(now, |(first, _)| first);
        self.times = Some((first, now));
    }

    /// Returns the time at which the changes are to be evaluated, or `None` if nothing has changed.
    pub(crate) fn due(&self) -> Option<Instant> {
        let (first, last) = self.times?;
        let deadline = first + MAX_WAIT;
        if !self.unfinished.is_empty() {
            return Some(deadline);
        }
        let quiet = if self.files.len() == 1 { MIN_QUIET } else { MIN_QUIET_AFTER_SEVERAL };
        Some(deadline.min(last + quiet))
    }

    /// Returns the changed files if it is time to evaluate them, and begins the next group.
    pub(crate) fn take(&mut self, now: Instant) -> Option<BTreeSet<PathBuf>> {
        if self.due()? > now {
            return None;
        }
        Some(std::mem::take(self).files)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checks when the evaluation is due. Each change is a time in milliseconds and a file. A file whose name ends with `-` is unfinished.
    fn check(changes: &[(u64, &str)], due: u64) {
        let start = Instant::now();
        let mut batch = Batch::default();
        for &(at, file) in changes {
            let shape =
                if file.ends_with('-') { FileState::Unfinished } else { FileState::Complete };
            let file = file.trim_end_matches('-');
            batch.record_change(Path::new(file), shape, start + Duration::from_millis(at));
        }
        let due = start + Duration::from_millis(due);
        assert_eq!(batch.due(), Some(due), "{changes:?}");
        assert_eq!(batch.take(due - Duration::from_nanos(1)), None, "{changes:?}");
        assert!(batch.take(due).is_some_and(|files| !files.is_empty()), "{changes:?}");
        assert_eq!((batch.due(), batch.take(due)), (None, None));
    }

    #[test]
    fn one_changed_file_is_complete_after_ten_milliseconds() {
        check(&[(0, "a")], 10);
        check(&[(0, "a"), (3, "a"), (6, "a")], 16);
    }

    #[test]
    fn several_changed_files_wait_longer_but_not_past_the_deadline() {
        check(&[(0, "a"), (2, "b")], 32);
        check(&[(0, "a"), (100, "b"), (118, "c")], 148);
        check(&[(0, "a"), (100, "b"), (140, "c")], 150);
    }

    #[test]
    fn continuous_saves_do_not_block_the_evaluation() {
        let stream: Vec<_> = (0..30).map(|k| (k * 5, "a")).collect();
        check(&stream, 150);
    }

    #[test]
    fn an_empty_or_missing_file_waits_for_the_deadline() {
        check(&[(0, "a-")], 150);
        check(&[(0, "a-"), (4, "b")], 150);
    }

    #[test]
    fn a_file_with_content_again_is_complete() {
        check(&[(0, "a-"), (2, "a")], 12);
    }
}
