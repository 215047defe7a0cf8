//! Changes that belong together though they are some time apart: logic alone, without a clock and without files.
//!
//! The evaluation starts as soon as a change is complete ([`Batch`](super::Batch)), and a later change stops it. What others see of it,
//! files and commands, waits until all files have rested.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How long files must rest before outputs are written. "Save all" saves files that belong together up to 200 ms apart; a save is to be
/// seen in the outputs after 250 ms.
const REST: Duration = Duration::from_millis(230);

/// The same where files are looked at twice a second: one may be seen at the next look.
const REST_IF_POLLED: Duration = Duration::from_millis(650);

/// How much longer the user's command waits than outputs do: it may take minutes.
const REST_OF_COMMAND: Duration = Duration::from_millis(120);

/// Outputs wait no longer than this after the first change, so that a stream of saves cannot starve them.
const MAX_WAIT: Duration = Duration::from_secs(3);

/// A file that its writer has not closed is read when it has rested so long: some programs keep files open.
const REST_IF_OPEN: Duration = Duration::from_secs(2);

/// A file that grows without end is read after this.
const MAX_GROWTH: Duration = Duration::from_secs(60);

/// Changes since outputs were last written.
#[derive(Debug, Default)]
pub(crate) struct Series {
    /// When the first and the last change happened.
    times: Option<(Instant, Instant)>,
    /// Files that their writers have not closed yet: when each was first and last written to.
    open: BTreeMap<PathBuf, (Instant, Instant)>,
    pub(crate) is_polled: bool,
}

impl Series {
    /// The content of a file has changed.
    pub(crate) fn changed(&mut self, now: Instant) {
        let first = self.times.map_or(now, |(first, _)| first);
        self.times = Some((first, now));
    }

    /// A file was written to, and is still open.
    pub(crate) fn grows(&mut self, file: &Path, now: Instant) {
        let (_, last) = self.open.entry(file.to_owned()).or_insert((now, now));
        *last = now;
    }

    /// Returns true if the writer of a file has not closed it.
    pub(crate) fn is_open(&self, file: &Path) -> bool {
        self.open.contains_key(file)
    }

    /// A file was closed, or has gone.
    pub(crate) fn closed(&mut self, file: &Path) {
        self.open.remove(file);
    }

    /// When the next file that is still open is to be read all the same.
    pub(crate) fn growth_due(&self) -> Option<Instant> {
        self.open.values().map(|&growth| end_of(growth)).min()
    }

    /// Takes the open files that are to be read.
    pub(crate) fn take_grown(&mut self, now: Instant) -> Vec<PathBuf> {
        self.open
            .extract_if(.., |_, growth: &mut (Instant, Instant)| end_of(*growth) <= now)
            .map(|(file, _)| file)
            .collect()
    }

    /// When outputs may be written; none if they need not wait.
    pub(crate) fn settles(&self) -> Option<Instant> {
        let (first, last) = self.times?;
        let rest = if self.is_polled { REST_IF_POLLED } else { REST };
        let deadline = first + MAX_WAIT;
        Some(if self.open.is_empty() { deadline.min(last + rest) } else { deadline })
    }

    /// When the user's command may be started.
    pub(crate) fn command_due(&self) -> Option<Instant> {
        Some(self.settles()? + REST_OF_COMMAND)
    }

    /// Outputs are written: what changes from now on is another series.
    pub(crate) fn end(&mut self) {
        self.times = None;
    }
}

/// When a file that is still open is read.
fn end_of((first, last): (Instant, Instant)) -> Instant {
    (last + REST_IF_OPEN).min(first + MAX_GROWTH)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(start: Instant, milliseconds: u64) -> Instant {
        start + Duration::from_millis(milliseconds)
    }

    /// Changes at some milliseconds, and when outputs may be written.
    fn check(changes: &[u64], due: u64) {
        let start = Instant::now();
        let mut series = Series::default();
        changes.iter().for_each(|&change| series.changed(at(start, change)));
        assert_eq!(series.settles(), Some(at(start, due)), "{changes:?}");
        series.end();
        assert_eq!(series.settles(), None);
    }

    #[test]
    fn files_that_are_saved_200_ms_apart_are_one_series() {
        check(&[0], 230);
        check(&[0, 200], 430);
        check(&[0, 200, 400], 630);
    }

    #[test]
    fn a_stream_of_saves_does_not_starve_outputs() {
        check(&(0..100).map(|k| k * 100).collect::<Vec<_>>(), 3000);
    }

    #[test]
    fn an_open_file_is_waited_for() {
        let start = Instant::now();
        let mut series = Series::default();
        series.changed(start);
        series.grows(Path::new("a"), at(start, 10));
        series.grows(Path::new("a"), at(start, 900));
        assert_eq!(series.settles(), Some(at(start, 3000)));
        assert_eq!(series.growth_due(), Some(at(start, 2900)));
        assert_eq!(series.take_grown(at(start, 2899)), Vec::<PathBuf>::new());
        series.closed(Path::new("a"));
        assert_eq!((series.settles(), series.growth_due()), (Some(at(start, 230)), None));
        (0..400).for_each(|k| series.grows(Path::new("b"), at(start, k * 200)));
        assert_eq!(series.growth_due(), Some(at(start, 60_000)));
        assert_eq!(series.take_grown(at(start, 60_000)), [PathBuf::from("b")]);
    }
}
