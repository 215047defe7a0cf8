//! The process of the editor: the server ends with it, even if somebody else keeps its stdin open.

use std::time::Duration;

use crossbeam_channel::Sender;

use super::watcher::Event;

/// How often the process is looked at.
const PERIOD: Duration = Duration::from_millis(500);

/// Sends an event when the process has ended. A process that is not there to begin with is one of another machine or container.
pub(super) fn watch(id: u32, events: Sender<Event>) {
    let Some(start) = start_of(id) else { return };
    std::thread::spawn(move || {
        while start_of(id).as_ref() == Some(&start) {
            std::thread::sleep(PERIOD);
        }
        // The server may have ended before.
        let _ = events.send(Event::EditorEnded);
    });
}

/// Whether a process has ended, perhaps without anybody having waited for it.
#[cfg(unix)]
pub fn has_ended(id: u32) -> bool {
    start_of(id).is_none()
}

/// When a process began, in words of the system, which tells it from a later one with its id; `None` if it has ended.
#[cfg(target_os = "linux")]
fn start_of(id: u32) -> Option<String> {
    let stat = std::fs::read_to_string(format!("/proc/{id}/stat")).ok()?;
    // The name of the program, in parentheses, may have any sign in it.
    let fields: Vec<_> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let has_ended = matches!(fields.first(), Some(&("Z" | "X" | "x")));
    if has_ended { None } else { fields.get(19).map(|start| (*start).to_owned()) }
}

#[cfg(all(unix, not(target_os = "linux")))]
fn start_of(id: u32) -> Option<String> {
    let id = rustix::process::Pid::from_raw(i32::try_from(id).ok()?)?;
    let is_there = rustix::process::test_kill_process(id) != Err(rustix::io::Errno::SRCH);
    is_there.then(String::new)
}

/// Not known here: the end of stdin has to do.
#[cfg(not(unix))]
fn start_of(_: u32) -> Option<String> {
    None
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use std::process::{Command, Stdio};

    use super::*;

    #[test]
    fn the_end_of_a_process_is_seen_before_its_parent_has_waited_for_it() {
        assert!(start_of(std::process::id()).is_some());
        let mut child = Command::new("cat").stdin(Stdio::piped()).spawn().unwrap();
        let (sender, events) = crossbeam_channel::unbounded();
        watch(child.id(), sender.clone());
        assert!(events.recv_timeout(2 * PERIOD).is_err());
        child.kill().unwrap();
        assert!(events.recv_timeout(Duration::from_secs(60)).is_ok());
        assert_eq!(start_of(child.id()), None);
        child.wait().unwrap();
        // No process has this id.
        watch(u32::MAX, sender);
        assert!(events.recv_timeout(2 * PERIOD).is_err());
    }
}
