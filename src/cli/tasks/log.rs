//! The logs of tasks that run on a render farm.
//!
//! The program writes the logs itself, next to the list of tasks. Engines store the output of jobs in different places or not at all, and
//! command lines do not contain the names of tasks. The job that ends last writes the contact sheet, because plain command lines (for GNU
//! parallel) have no final step.

use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use maquette_engine::eval::{Observer, State as NodeState};
use maquette_engine::writing;
use maquette_golden::sweep::Task;

use super::Batch;
use super::record::{Record, State, text_field};
use crate::events::unresponsive_message;

/// The first words of the last line of a log, if the task has ended.
const END_WORDS: [&str; 3] = ["done", "failed", "not run"];

/// The log of a task, open for writing.
pub(super) struct Log {
    start: Instant,
    /// The open file. `None` after a write error, because a task must not fail because of its log.
    file: Mutex<Option<File>>,
}

impl Log {
    fn write(&self, text: &str) {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        // Write all of the text in one call, so that it is complete even if the process is killed.
        if file.as_mut().is_some_and(|file| file.write_all(text.as_bytes()).is_err()) {
            *file = None;
        }
    }

    fn line(&self, words: &str) {
        self.write(&format!("{:9.2} s  {words}\n", self.start.elapsed().as_secs_f64()));
    }

    /// Writes the end of the task to the log. `record` is `None` if the task was stopped.
    pub(super) fn end(&self, record: Option<&Record>) {
        let Some(record) = record else { return self.line("stopped") };
        for problem in &record.problems {
            let numbers = ["line", "column"].iter().filter_map(|name| problem[*name].as_u64());
            let position = numbers
                .fold(text_field(problem, "file").to_owned(), |position, number| {
                    format!("{position}:{number}")
                });
            let position = if position.is_empty() { position } else { format!("{position}: ") };
            self.write(&format!(
                "{}: {position}{}\n",
                text_field(problem, "severity"),
                text_field(problem, "message")
            ));
            if !text_field(problem, "help").is_empty() {
                self.write(&format!("  = help: {}\n", text_field(problem, "help")));
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
    fn on_start(&self, node: &str) {
        self.line(&format!("computing {node}"));
    }

    fn on_unresponsive(&self, node: &str, kind: &str, pack: &str) {
        self.line(&unresponsive_message(node, kind, pack));
    }

    fn on_finish(&self, node: &str, state: NodeState, seconds: f64) {
        self.line(&format!("{} {node} ({seconds:.2} s)", state.word()));
    }
}

impl Batch<'_> {
    /// Begins the log of a task that was handed over to a farm. Returns `None` for any other task, because it has no log.
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

    /// Writes to the log that a task was not run, because its record is up to date.
    pub(super) fn log_up_to_date(&self, task: &Task, state: State) {
        let Some(path) = self.log_path(task) else { return };
        // Ignore errors, because logs are only read by people.
        let _ = writing::open_log(&path).and_then(|mut file| {
            writeln!(file, "not run: {}, and nothing has changed", state.word())
        });
    }

    /// Returns true if all tasks that were handed over have ended. For speed, checks the last task first: farms run tasks in order, so it
    /// usually ends last.
    pub(crate) fn have_all_ended(&self) -> bool {
        let mut tasks = self.sweep.tasks.iter().rev();
        tasks.all(|task| self.log_path(task).is_some_and(|path| has_ended(&path).unwrap_or(false)))
    }
}

fn has_ended(log: &Path) -> io::Result<bool> {
    const MAX_LENGTH: u64 = 80;
    let mut file = File::open(log)?;
    let length = file.metadata()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(MAX_LENGTH)))?;
    let mut end = Vec::new();
    file.read_to_end(&mut end)?;
    let end = String::from_utf8_lossy(&end);
    let line = end.trim_end().lines().last().unwrap_or_default();
    Ok(end.ends_with('\n') && END_WORDS.iter().any(|word| line.starts_with(word)))
}
