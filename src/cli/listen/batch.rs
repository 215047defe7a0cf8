//! When to react to changes: logic alone, without a clock and without files.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How long one changed file must rest. An editor's steps of one save (write, rename, set the time) lie within 2 ms; longer
/// makes every save feel later, shorter evaluates the first half of a save.
const QUIET: Duration = Duration::from_millis(10);

/// How long files must rest once several have changed: a copy or a checkout goes from file to file within a few milliseconds.
const QUIET_AFTER_SEVERAL: Duration = Duration::from_millis(30);

/// A batch never waits longer than this after its first change, so that a stream of saves cannot starve it; and it waits this
/// long for the rest of a file that is empty or gone, as files are in the middle of a save.
const DEADLINE: Duration = Duration::from_millis(150);

/// Whether a file may still be in the middle of being written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shape {
    /// It has content.
    Whole,
    /// It is empty or not there.
    Unfinished,
}

impl Shape {
    pub(crate) fn is_whole(self) -> bool {
        self == Self::Whole
    }
}

/// Changes that belong together.
#[derive(Debug, Default)]
pub(crate) struct Batch {
    files: BTreeSet<PathBuf>,
    unfinished: BTreeSet<PathBuf>,
    /// When its first and its last change happened.
    times: Option<(Instant, Instant)>,
}

impl Batch {
    /// The content of a file has changed.
    pub(crate) fn changed(&mut self, file: &Path, shape: Shape, now: Instant) {
        self.files.insert(file.to_owned());
        match shape {
            Shape::Whole => self.unfinished.remove(file),
            Shape::Unfinished => self.unfinished.insert(file.to_owned()),
        };
        let first = self.times.map_or(now, |(first, _)| first);
        self.times = Some((first, now));
    }

    /// When to evaluate; none if nothing has changed.
    pub(crate) fn due(&self) -> Option<Instant> {
        let (first, last) = self.times?;
        let deadline = first + DEADLINE;
        if !self.unfinished.is_empty() {
            return Some(deadline);
        }
        let quiet = if self.files.len() == 1 { QUIET } else { QUIET_AFTER_SEVERAL };
        Some(deadline.min(last + quiet))
    }

    /// The changed files, if it is time; then the next batch begins.
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

    /// Changes as (milliseconds, file), a file with a `-` being unfinished, and when the evaluation is due after the last one.
    fn check(changes: &[(u64, &str)], due: u64) {
        let start = Instant::now();
        let mut batch = Batch::default();
        for &(at, file) in changes {
            let shape = if file.ends_with('-') { Shape::Unfinished } else { Shape::Whole };
            let file = file.trim_end_matches('-');
            batch.changed(Path::new(file), shape, start + Duration::from_millis(at));
        }
        let due = start + Duration::from_millis(due);
        assert_eq!(batch.due(), Some(due), "{changes:?}");
        assert_eq!(batch.take(due - Duration::from_nanos(1)), None, "{changes:?}");
        assert!(batch.take(due).is_some_and(|files| !files.is_empty()), "{changes:?}");
        assert_eq!((batch.due(), batch.take(due)), (None, None));
    }

    #[test]
    fn one_file_rests_ten_milliseconds() {
        check(&[(0, "a")], 10);
        check(&[(0, "a"), (3, "a"), (6, "a")], 16);
    }

    #[test]
    fn several_files_rest_longer_but_never_past_the_deadline() {
        check(&[(0, "a"), (2, "b")], 32);
        check(&[(0, "a"), (100, "b"), (118, "c")], 148);
        check(&[(0, "a"), (100, "b"), (140, "c")], 150);
    }

    #[test]
    fn a_stream_of_saves_does_not_starve_the_evaluation() {
        let stream: Vec<_> = (0..30).map(|k| (k * 5, "a")).collect();
        check(&stream, 150);
    }

    #[test]
    fn an_empty_or_missing_file_is_given_until_the_deadline() {
        check(&[(0, "a-")], 150);
        check(&[(0, "a-"), (4, "b")], 150);
    }

    #[test]
    fn a_file_that_comes_back_is_whole() {
        check(&[(0, "a-"), (2, "a")], 12);
    }
}
