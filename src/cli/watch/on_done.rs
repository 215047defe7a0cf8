//! `--on-done`: runs a command of the user after each successful run of the graph.
//!
//! The watch does not wait for the command. Only one instance of the command runs at a time. If the graph is run again in the meantime, the
//! command is started once more after it has ended.

use std::path::PathBuf;
use std::process::{Command, ExitStatus, Stdio};

use super::Message;

pub(super) struct OnDone {
    command: String,
    folder: PathBuf,
    /// True if the output of the command is captured for the block on the terminal, false if it goes to stderr.
    captures_output: bool,
    is_running: bool,
    must_restart: bool,
}

/// The result of the user's command.
pub(super) struct CommandResult {
    pub(super) status: std::io::Result<ExitStatus>,
    /// The last line that the command printed. Empty if the output was not captured.
    pub(super) last_line: String,
}

impl OnDone {
    pub(super) fn new(command: String, folder: PathBuf, quiet: bool) -> Self {
        let folder = std::path::absolute(&folder).unwrap_or(folder);
        Self { command, folder, captures_output: quiet, is_running: false, must_restart: false }
    }

    /// Starts the command. If it is still running, records that it must be started once more.
    pub(super) fn start(&mut self, sink: impl FnOnce(Message) + Send + 'static) {
        if self.is_running {
            self.must_restart = true;
            return;
        }
        self.is_running = true;
        let (mut command, quiet) = (self.command(), self.captures_output);
        std::thread::spawn(move || sink(Message::CommandEnded(run(&mut command, quiet))));
    }

    /// Records that the command has ended. Returns true if it must be started once more.
    pub(super) fn finish(&mut self) -> bool {
        self.is_running = false;
        std::mem::take(&mut self.must_restart)
    }

    /// Runs the command and waits until it ends.
    pub(super) fn run_and_wait(&self) -> CommandResult {
        run(&mut self.command(), self.captures_output)
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
            // Pass the command unchanged, because `cmd` does not parse quotes as other programs do.
            command.arg("/C").raw_arg(&self.command);
            command
        };
        command.env("MAQUETTE_OUT", &self.folder).stdin(Stdio::null());
        command
    }
}

fn run(command: &mut Command, quiet: bool) -> CommandResult {
    if !quiet {
        // Let the command write to stderr, because stdout is reserved for the watch.
        let status = command.stdout(std::io::stderr()).status();
        return CommandResult { status, last_line: String::new() };
    }
    match command.output() {
        Ok(output) => {
            let text = if output.stderr.is_empty() { &output.stdout } else { &output.stderr };
            let last = String::from_utf8_lossy(text).lines().last().unwrap_or_default().to_owned();
            CommandResult { status: Ok(output.status), last_line: last }
        }
        Err(error) => CommandResult { status: Err(error), last_line: String::new() },
    }
}

impl CommandResult {
    /// Returns an error message if the command failed, or `None` if it succeeded.
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
