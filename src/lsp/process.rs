//! Monitors the editor's process. The server ends when the editor ends, even if another process keeps the server's stdin open.

use std::time::Duration;

use crossbeam_channel::Sender;

use super::watcher::Event;

/// The interval between two checks of the process.
const INTERVAL: Duration = Duration::from_millis(500);

/// Sends an event when the process `id` has ended. If there is no such process at the start, it is probably on another machine or in
/// another container, and no event is sent.
pub(super) fn watch(id: u32, events: Sender<Event>) {
    let Some(start) = start_time(id) else { return };
    std::thread::spawn(move || {
        while start_time(id).as_ref() == Some(&start) {
            std::thread::sleep(INTERVAL);
        }
        // Ignore an error: sending fails only if the server has already ended.
        let _ = events.send(Event::EditorEnded);
    });
}

/// Returns true if a process has ended. A zombie, whose exit status its parent has not read yet, counts as ended.
#[cfg(unix)]
pub fn has_ended(id: u32) -> bool {
    start_time(id).is_none()
}

/// Returns the start time of a process, in the format of the system. It distinguishes the process from a later process with the same id.
/// Returns `None` if the process has ended.
#[cfg(target_os = "linux")]
fn start_time(id: u32) -> Option<String> {
    let stat = std::fs::read_to_string(format!("/proc/{id}/stat")).ok()?;
    // Split after the last parenthesis: the name of the program is in parentheses and may contain any character.
    let fields: Vec<_> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let has_ended = matches!(fields.first(), Some(&("Z" | "X" | "x")));
    if has_ended { None } else { fields.get(19).map(|start| (*start).to_owned()) }
}

#[cfg(all(unix, not(target_os = "linux")))]
fn start_time(id: u32) -> Option<String> {
    let id = rustix::process::Pid::from_raw(i32::try_from(id).ok()?)?;
    let is_there = rustix::process::test_kill_process(id) != Err(rustix::io::Errno::SRCH);
    is_there.then(String::new)
}

/// Returns `None`, because start times are not available on this system. The server then ends only when stdin ends.
#[cfg(not(unix))]
fn start_time(_: u32) -> Option<String> {
    None
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use std::process::{Command, Stdio};

    use super::*;

    #[test]
    fn a_zombie_process_has_ended() {
        assert!(start_time(std::process::id()).is_some());
        let mut child = Command::new("cat").stdin(Stdio::piped()).spawn().unwrap();
        let (sender, events) = crossbeam_channel::unbounded();
        watch(child.id(), sender.clone());
        assert!(events.recv_timeout(2 * INTERVAL).is_err());
        child.kill().unwrap();
        assert!(events.recv_timeout(Duration::from_secs(60)).is_ok());
        assert_eq!(start_time(child.id()), None);
        child.wait().unwrap();
        // No process can have this id.
        watch(u32::MAX, sender);
        assert!(events.recv_timeout(2 * INTERVAL).is_err());
    }
}
