//! Decides when outputs are written after a series of changes. This module uses no clock and reads no files.
//!
//! The evaluation starts as soon as a change is complete ([`Batch`](super::Batch)), and a later change cancels it. Outputs are written,
//! and the user's command is started, only when no file has changed for a while.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The time without changes before outputs are written. Editors need up to 200 ms to save all files, and outputs should be written
/// within 250 ms of a save.
const OUTPUT_DELAY: Duration = Duration::from_millis(230);

/// The time without changes before outputs are written if files are polled. It is longer, because polling notices a change up to one
/// polling interval late.
const POLLED_OUTPUT_DELAY: Duration = Duration::from_millis(650);

/// The wait before the user's command, in addition to the wait before outputs. The command may take minutes, so it should not start too
/// early.
const COMMAND_DELAY: Duration = Duration::from_millis(120);

/// The maximum wait of outputs after the first change. It prevents continuous saves from delaying outputs forever.
const MAX_WAIT: Duration = Duration::from_secs(3);

/// The time without writes after which a file is read although it is still open. Some programs never close their files.
const OPEN_FILE_DELAY: Duration = Duration::from_secs(2);

/// The maximum time for which a file that is still being written remains unread.
const MAX_GROWTH: Duration = Duration::from_secs(60);

/// Changes since outputs were last written.
#[derive(Debug, Default)]
pub(crate) struct Series {
    /// The times of the first and the last change of the series.
    times: Option<(Instant, Instant)>,
    /// Files that are still open for writing, with the times of the first and the last write.
    open: BTreeMap<PathBuf, (Instant, Instant)>,
    pub(crate) is_polled: bool,
}

impl Series {
    /// Records that the content of a file has changed.
    pub(crate) fn record_change(&mut self, now: Instant) {
        let first = self.times.map_or(now, |(first, _)| first);
        self.times = Some((first, now));
    }

    /// Records a write to a file that is still open.
    pub(crate) fn record_growth(&mut self, file: &Path, now: Instant) {
        let (_, last) = self.open.entry(file.to_owned()).or_insert((now, now));
        *last = now;
    }

    /// Returns true if a file is still open for writing.
    pub(crate) fn is_open(&self, file: &Path) -> bool {
        self.open.contains_key(file)
    }

    /// Records that a file is no longer open, because it was closed or deleted.
    pub(crate) fn record_close(&mut self, file: &Path) {
        self.open.remove(file);
    }

    /// Returns the earliest time at which a file that is still open must be read.
    pub(crate) fn growth_due(&self) -> Option<Instant> {
        self.open.values().map(|&growth| end_of(growth)).min()
    }

    /// Takes the files that must be read now although they are still open.
    pub(crate) fn take_grown(&mut self, now: Instant) -> Vec<PathBuf> {
        self.open
            .extract_if(.., |_, growth: &mut (Instant, Instant)| end_of(*growth) <= now)
            .map(|(file, _)| file)
            .collect()
    }

    /// Returns the time at which outputs may be written, or `None` if they may be written now.
    pub(crate) fn outputs_due(&self) -> Option<Instant> {
        let (first, last) = self.times?;
        let rest = if self.is_polled { POLLED_OUTPUT_DELAY } else { OUTPUT_DELAY };
        let deadline = first + MAX_WAIT;
        Some(if self.open.is_empty() { deadline.min(last + rest) } else { deadline })
    }

    /// Returns the time at which the user's command may be started.
    pub(crate) fn command_due(&self) -> Option<Instant> {
        Some(self.outputs_due()? + COMMAND_DELAY)
    }

    /// Ends the series after outputs were written.
    pub(crate) fn end(&mut self) {
        self.times = None;
    }
}

/// Returns the time at which a file that is still open must be read. `first` and `last` are the times of the first and the last write.
fn end_of((first, last): (Instant, Instant)) -> Instant {
    (last + OPEN_FILE_DELAY).min(first + MAX_GROWTH)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn instant_at(start: Instant, milliseconds: u64) -> Instant {
        start + Duration::from_millis(milliseconds)
    }

    /// Checks that outputs may be written at `due` after changes at the times `changes`, in milliseconds.
    fn check(changes: &[u64], due: u64) {
        let start = Instant::now();
        let mut series = Series::default();
        changes.iter().for_each(|&change| series.record_change(instant_at(start, change)));
        assert_eq!(series.outputs_due(), Some(instant_at(start, due)), "{changes:?}");
        series.end();
        assert_eq!(series.outputs_due(), None);
    }

    #[test]
    fn files_that_are_saved_200_ms_apart_are_one_series() {
        check(&[0], 230);
        check(&[0, 200], 430);
        check(&[0, 200, 400], 630);
    }

    #[test]
    fn continuous_saves_do_not_block_outputs() {
        check(&(0..100).map(|k| k * 100).collect::<Vec<_>>(), 3000);
    }

    #[test]
    fn outputs_wait_for_an_open_file() {
        let start = Instant::now();
        let mut series = Series::default();
        series.record_change(start);
        series.record_growth(Path::new("a"), instant_at(start, 10));
        series.record_growth(Path::new("a"), instant_at(start, 900));
        assert_eq!(series.outputs_due(), Some(instant_at(start, 3000)));
        assert_eq!(series.growth_due(), Some(instant_at(start, 2900)));
        assert_eq!(series.take_grown(instant_at(start, 2899)), Vec::<PathBuf>::new());
        series.record_close(Path::new("a"));
        assert_eq!(
            (series.outputs_due(), series.growth_due()),
            (Some(instant_at(start, 230)), None)
        );
        (0..400).for_each(|k| series.record_growth(Path::new("b"), instant_at(start, k * 200)));
        assert_eq!(series.growth_due(), Some(instant_at(start, 60_000)));
        assert_eq!(series.take_grown(instant_at(start, 60_000)), [PathBuf::from("b")]);
    }
}
