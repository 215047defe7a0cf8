//! Decides when outputs are written during a series of changes. This module uses no clock and reads no files.
//!
//! An evaluation starts as soon as a change is complete ([`Batch`](super::Batch)), and a later change cancels it. Outputs are written, and
//! the user's command is started, only after some time without changes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The time without changes before outputs are written. Editors may need up to 200 ms to save all files. Outputs should be written within
/// 250 ms of a save.
const OUTPUT_DELAY: Duration = Duration::from_millis(230);

/// The time without changes before outputs are written, if files are polled. It is longer, because a change is noticed up to one polling
/// interval late.
const POLLED_OUTPUT_DELAY: Duration = Duration::from_millis(650);

/// The wait before the user's command starts, in addition to the wait before outputs. The command may take minutes, so it must not start
/// between two changes.
const COMMAND_DELAY: Duration = Duration::from_millis(120);

/// The maximum wait after the first change, so that continuous saves do not delay outputs forever.
const MAX_WAIT: Duration = Duration::from_secs(3);

/// The time without writes after which a file is read even if it is still open. Some programs never close their files.
const OPEN_FILE_DELAY: Duration = Duration::from_secs(2);

/// The maximum time for which a file is not read because it is still being written.
const MAX_GROWTH: Duration = Duration::from_secs(60);

/// The changes since outputs were last written.
#[derive(Debug, Default)]
pub(crate) struct Series {
    /// The times of the first and the last change of the series.
    times: Option<(Instant, Instant)>,
    /// The files that are open for writing, with the times of their first and last write.
    open: BTreeMap<PathBuf, (Instant, Instant)>,
    pub(crate) is_polled: bool,
}

impl Series {
    /// Records that a file has new content.
    pub(crate) fn record_change(&mut self, now: Instant) {
        let first = self.times.map_or(now, |(first, _)| first);
        self.times = Some((first, now));
    }

    /// Records a write to a file that is still open for writing.
    pub(crate) fn record_growth(&mut self, file: &Path, now: Instant) {
        let (_, last) = self.open.entry(file.to_owned()).or_insert((now, now));
        *last = now;
    }

    /// Returns true if a file is still open for writing.
    pub(crate) fn is_open(&self, file: &Path) -> bool {
        self.open.contains_key(file)
    }

    /// Records that a file was closed or deleted.
    pub(crate) fn record_close(&mut self, file: &Path) {
        self.open.remove(file);
    }

    /// Returns the earliest time at which an open file must be read.
    pub(crate) fn growth_due(&self) -> Option<Instant> {
        self.open.values().map(|&growth| end_of(growth)).min()
    }

    /// Returns the files that must be read now although they are still open, and removes them from the list of open files.
    pub(crate) fn take_grown(&mut self, now: Instant) -> Vec<PathBuf> {
        self.open
            .extract_if(.., |_, growth: &mut (Instant, Instant)| end_of(*growth) <= now)
            .map(|(file, _)| file)
            .collect()
    }

    /// Returns the time from which outputs may be written. `None` means that they may be written now.
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

    /// Ends the series, after outputs were written.
    pub(crate) fn end(&mut self) {
        self.times = None;
    }
}

/// Returns the time at which an open file must be read, given the times of its first and last write.
fn end_of((first, last): (Instant, Instant)) -> Instant {
    (last + OPEN_FILE_DELAY).min(first + MAX_GROWTH)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn instant_at(start: Instant, milliseconds: u64) -> Instant {
        start + Duration::from_millis(milliseconds)
    }

    /// Checks that outputs may be written from the time `due` on. `changes` are the times of changes. All times are in milliseconds.
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
