//! A log of messages for the open live pages. Each page reads at its own speed. A page that reads too slowly misses messages.
//!
//! Messages that all pages have read are removed. If the log becomes too long, the oldest messages are removed even if some pages have not
//! read them. So a page that does not read cannot fill the memory.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex};

use tokio::sync::watch;

use super::lock_ignoring_poison;

/// The maximum number of messages in the log, and their maximum total size in bytes. A page that misses messages because of these limits
/// gets the complete state again.
const MAX_BEHIND: usize = 1024;
const MAX_BEHIND_BYTES: usize = 8 << 20;

/// A log of messages, with the listeners that read it.
pub(super) struct EventLog {
    log: Mutex<Log>,
    /// Wakes the listeners when there are new messages.
    notifier: watch::Sender<()>,
}

#[derive(Default)]
struct Log {
    /// The messages in the log, the newest last.
    texts: VecDeque<Arc<str>>,
    bytes: usize,
    /// The number of messages that have been removed from the log.
    removed: u64,
    /// The number of messages that each listener has read, by the number of the listener. Removed messages count, too.
    read_counts: BTreeMap<u64, u64>,
    /// The number of the next listener.
    next: u64,
}

/// A reader of the log, for one open page.
pub(super) struct Listener<'n> {
    news: &'n EventLog,
    number: u64,
    bell: watch::Receiver<()>,
}

/// The error that messages were removed from the log before the listener read them.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct MissedEventsError;

impl EventLog {
    pub(super) fn new() -> Self {
        Self { log: Mutex::default(), notifier: watch::Sender::new(()) }
    }

    pub(super) fn send(&self, text: Arc<str>) {
        let mut log = lock_ignoring_poison(&self.log);
        log.bytes += text.len();
        log.texts.push_back(text);
        log.remove_old();
        drop(log);
        self.notifier.send_replace(());
    }

    /// Creates a listener that receives all messages sent after this call.
    pub(super) fn listen(&self) -> Listener<'_> {
        let bell = self.notifier.subscribe();
        let mut log = lock_ignoring_poison(&self.log);
        let number = log.next;
        log.next += 1;
        let next_message = log.removed + log.texts.len() as u64;
        log.read_counts.insert(number, next_message);
        Listener { news: self, number, bell }
    }
}

impl Log {
    fn remove_old(&mut self) {
        let wanted = self.read_counts.values().min().copied().unwrap_or(u64::MAX);
        while let Some(first) = self.texts.front() {
            // Keep the last message, however large it is. Otherwise every listener would miss it.
            let is_much = self.texts.len() > MAX_BEHIND
                || (self.bytes > MAX_BEHIND_BYTES && self.texts.len() > 1);
            if wanted <= self.removed && !is_much {
                return;
            }
            self.bytes -= first.len();
            self.texts.pop_front();
            self.removed += 1;
        }
    }
}

impl Listener<'_> {
    /// Waits for the next message and returns it. Returns an error if the message has already been removed.
    pub(super) async fn next(&mut self) -> Result<Arc<str>, MissedEventsError> {
        loop {
            if let Some(next) = self.next_message() {
                return next;
            }
            // Waiting cannot fail: the sender lives as long as the log, which outlives its listeners.
            let _ = self.bell.changed().await;
        }
    }

    fn next_message(&self) -> Option<Result<Arc<str>, MissedEventsError>> {
        let mut log = lock_ignoring_poison(&self.news.log);
        let taken = log.read_counts.get(&self.number).copied()?;
        let Some(index) = taken.checked_sub(log.removed) else {
            return Some(Err(MissedEventsError));
        };
        let text = log.texts.get(index as usize)?.clone();
        log.read_counts.insert(self.number, taken + 1);
        log.remove_old();
        Some(Ok(text))
    }
}

impl Drop for Listener<'_> {
    fn drop(&mut self) {
        let mut log = lock_ignoring_poison(&self.news.log);
        log.read_counts.remove(&self.number);
        log.remove_old();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the number of messages in the log.
    fn count_events(news: &EventLog) -> usize {
        let log = lock_ignoring_poison(&news.log);
        assert_eq!(log.bytes, log.texts.iter().map(|text| text.len()).sum::<usize>());
        log.texts.len()
    }

    fn send(news: &EventLog, text: &str) {
        news.send(text.into());
    }

    #[test]
    fn messages_read_by_all_are_removed() {
        let news = EventLog::new();
        send(&news, "nobody listens");
        assert_eq!(count_events(&news), 0);
        let (quick, slow) = (news.listen(), news.listen());
        send(&news, "a");
        send(&news, "b");
        fn take(listener: &Listener<'_>) -> Option<String> {
            listener.next_message().map(|text| text.unwrap().to_string())
        }
        assert_eq!([(); 3].map(|()| take(&quick)), [Some("a".into()), Some("b".into()), None]);
        assert_eq!((take(&slow), count_events(&news)), (Some("a".into()), 1));
        let late = news.listen();
        assert_eq!(take(&late), None);
        drop(slow);
        assert_eq!(count_events(&news), 0);
    }

    #[test]
    fn a_listener_that_never_reads_misses_messages() {
        let news = EventLog::new();
        let (slow, quick) = (news.listen(), news.listen());
        for _ in 0..=MAX_BEHIND {
            send(&news, "x");
            assert_eq!(quick.next_message().unwrap(), Ok("x".into()));
        }
        assert_eq!(
            (slow.next_message(), count_events(&news)),
            (Some(Err(MissedEventsError)), MAX_BEHIND)
        );
        let slow = news.listen();
        let half = "x".repeat(MAX_BEHIND_BYTES / 2 + 1);
        send(&news, &half);
        assert_eq!(slow.next_message().unwrap().unwrap().len(), half.len());
        send(&news, &half);
        send(&news, &half);
        assert_eq!((slow.next_message(), count_events(&news)), (Some(Err(MissedEventsError)), 1));
    }

    #[test]
    fn a_too_large_message_is_still_sent() {
        let news = EventLog::new();
        let listener = news.listen();
        send(&news, &"x".repeat(MAX_BEHIND_BYTES + 1));
        assert!(listener.next_message().unwrap().is_ok());
        assert_eq!(count_events(&news), 0);
    }
}
