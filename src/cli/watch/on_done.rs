//! `--on-done`: a command of the user's after each successful run.
//!
//! The watch never waits for it. Only one runs at a time: if the next run is done while it still runs, it is started once more
//! when it ends, however many runs that were.

use std::path::PathBuf;
use std::process::{Command, ExitStatus, Stdio};

use super::Message;

pub(super) struct OnDone {
    command: String,
    folder: PathBuf,
    /// Whether what it prints is kept for the status instead of going to stderr.
    quiet: bool,
    running: bool,
    again: bool,
}

/// What became of the command.
pub(super) struct Ended {
    pub(super) status: std::io::Result<ExitStatus>,
    /// The last line that it printed, if that was kept.
    pub(super) last_line: String,
}

impl OnDone {
    pub(super) fn new(command: String, folder: PathBuf, quiet: bool) -> Self {
        let folder = std::path::absolute(&folder).unwrap_or(folder);
        Self { command, folder, quiet, running: false, again: false }
    }

    /// Starts the command, or notes that it is to be started again.
    pub(super) fn start(&mut self, sink: impl FnOnce(Message) + Send + 'static) {
        if self.running {
            self.again = true;
            return;
        }
        self.running = true;
        let (mut command, quiet) = (self.command(), self.quiet);
        std::thread::spawn(move || sink(Message::CommandEnded(run(&mut command, quiet))));
    }

    /// Takes note that it has ended; whether it has to be started again.
    pub(super) fn ended(&mut self) -> bool {
        self.running = false;
        std::mem::take(&mut self.again)
    }

    /// Runs it and waits for it: whether it succeeded.
    pub(super) fn run_to_the_end(&self) -> Ended {
        run(&mut self.command(), self.quiet)
    }

    fn command(&self) -> Command {
        #[cfg(not(windows))]
        let mut command = {
            let mut command = Command::new("sh");
            command.arg("-c").arg(&self.command);
            command
        };
        #[cfg(windows)]
        let mut command = {
            use std::os::windows::process::CommandExt;
            let mut command = Command::new("cmd");
            // `cmd` has rules of its own for quotes.
            command.arg("/C").raw_arg(&self.command);
            command
        };
        command.env("MAQUETTE_OUT", &self.folder).stdin(Stdio::null());
        command
    }
}

fn run(command: &mut Command, quiet: bool) -> Ended {
    if !quiet {
        // Stdout is for results of the watch alone.
        let status = command.stdout(std::io::stderr()).status();
        return Ended { status, last_line: String::new() };
    }
    match command.output() {
        Ok(output) => {
            let text = if output.stderr.is_empty() { &output.stdout } else { &output.stderr };
            let last = String::from_utf8_lossy(text).lines().last().unwrap_or_default().to_owned();
            Ended { status: Ok(output.status), last_line: last }
        }
        Err(error) => Ended { status: Err(error), last_line: String::new() },
    }
}

impl Ended {
    /// Why it failed; none if it did not.
    pub(super) fn failure(&self) -> Option<String> {
        let why = match &self.status {
            Ok(status) if status.success() => return None,
            Ok(status) => status.to_string(),
            Err(error) => error.to_string(),
        };
        let line = if self.last_line.is_empty() { "" } else { ": " };
        Some(format!("--on-done failed ({why}){line}{}", self.last_line))
    }
}
