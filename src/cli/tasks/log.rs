//! The log of each task that a farm runs: what it does, until it ends or its process is killed.
//!
//! The program writes the log itself, beside the list of tasks: engines keep the output of a job in different places or nowhere, and a
//! command line has no names of tasks. The job that finds that all tasks have ended makes the contact sheet, because lines for GNU parallel
//! have no last step.

use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use maquette_engine::eval::{Observer, State as NodeState};
use maquette_engine::writing;
use maquette_golden::sweep::Task;

use super::Batch;
use super::record::{Record, State};
use crate::events::does_not_stop;

/// The last line of a task that has ended begins with one of these.
const ENDS: [&str; 3] = ["done", "failed", "not run"];

/// The open log of a task.
pub(super) struct Log {
    start: Instant,
    /// Nothing is written after an error: a log is worth no result.
    file: Mutex<Option<File>>,
}

impl Log {
    fn write(&self, text: &str) {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        // One call, so that the text is there whole if the process is killed.
        if file.as_mut().is_some_and(|file| file.write_all(text.as_bytes()).is_err()) {
            *file = None;
        }
    }

    fn line(&self, words: &str) {
        self.write(&format!("{:9.2} s  {words}\n", self.start.elapsed().as_secs_f64()));
    }

    /// Writes how the task ended; `None` if it was stopped.
    pub(super) fn end(&self, record: Option<&Record>) {
        let Some(record) = record else { return self.line("stopped") };
        for problem in &record.problems {
            let text = |name: &str| problem[name].as_str().unwrap_or_default();
            let numbers = ["line", "column"].iter().filter_map(|name| problem[*name].as_u64());
            let place =
                numbers.fold(text("file").to_owned(), |place, number| format!("{place}:{number}"));
            let place = if place.is_empty() { place } else { format!("{place}: ") };
            self.write(&format!("{}: {place}{}\n", text("severity"), text("message")));
            if !text("help").is_empty() {
                self.write(&format!("  = help: {}\n", text("help")));
            }
        }
        for output in &record.outputs {
            self.write(&format!("wrote {} ({} bytes)\n", output.path, output.bytes));
        }
        let word = match record.state {
            State::Done => "done in",
            State::Failed => "failed after",
        };
        self.write(&format!("{word} {:.2} s\n", record.seconds));
    }
}

impl Observer for Log {
    fn started(&self, node: &str) {
        self.line(&format!("computing {node}"));
    }

    fn does_not_stop(&self, node: &str, kind: &str, pack: &str) {
        self.line(&does_not_stop(node, kind, pack));
    }

    fn finished(&self, node: &str, state: NodeState, seconds: f64) {
        self.line(&format!("{} {node} ({seconds:.2} s)", state.word()));
    }
}

impl Batch<'_> {
    /// Begins the log of a task that was handed over; of others there is none.
    pub(super) fn begin_log(&self, task: &Task) -> Option<Log> {
        let path = self.log_path(task)?;
        let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
        let host = if host.is_empty() { String::new() } else { format!(" on {}", host.trim()) };
        let values = self.sweep.names.iter().zip(&task.row.values);
        let values = values.map(|(name, value)| format!("{name}: {value}\n"));
        let head = format!(
            "task {}, process {}{host}\n{}",
            task.name,
            std::process::id(),
            String::from_iter(values)
        );
        let file = writing::begin_log(&path).ok();
        let log = Log { start: Instant::now(), file: Mutex::new(file) };
        log.write(&head);
        Some(log)
    }

    /// Notes that a task need not be run.
    pub(super) fn note_unchanged(&self, task: &Task, state: State) {
        let Some(path) = self.log_path(task) else { return };
        // It is of no use but for people.
        let _ = writing::open_log(&path).and_then(|mut file| {
            writeln!(file, "not run: {}, and nothing has changed", state.word())
        });
    }

    /// Returns true if all tasks that were handed over have ended. What is asked most often is answered by one file: farms run tasks
    /// in order.
    pub(crate) fn have_all_ended(&self) -> bool {
        let mut tasks = self.sweep.tasks.iter().rev();
        tasks.all(|task| self.log_path(task).is_some_and(|path| has_ended(&path).unwrap_or(false)))
    }
}

fn has_ended(log: &Path) -> io::Result<bool> {
    const LONGEST: u64 = 80;
    let mut file = File::open(log)?;
    let length = file.metadata()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(LONGEST)))?;
    let mut end = Vec::new();
    file.read_to_end(&mut end)?;
    let end = String::from_utf8_lossy(&end);
    let line = end.trim_end().lines().last().unwrap_or_default();
    Ok(end.ends_with('\n') && ENDS.iter().any(|word| line.starts_with(word)))
}
