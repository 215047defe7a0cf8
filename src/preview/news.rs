//! What happens, for the pages that listen: each takes it at its own pace, and one that takes too little misses some of it.
//!
//! What all pages have taken is forgotten. So is what is too old or too much, however many pages still want it: a page that
//! never reads must not fill the memory.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex};

use tokio::sync::watch;

use super::unpoisoned;

/// Messages that a page may be behind before it is told everything anew, and their bytes.
const BEHIND: usize = 1024;
const BEHIND_BYTES: usize = 8 << 20;

/// What was told, and who listens.
pub(super) struct News {
    log: Mutex<Log>,
    /// Rings whenever something is told.
    bell: watch::Sender<()>,
}

#[derive(Default)]
struct Log {
    /// The newest last.
    texts: VecDeque<Arc<str>>,
    bytes: usize,
    /// How many came before these.
    gone: u64,
    /// How many each listener has taken.
    taken: BTreeMap<u64, u64>,
    /// The number of the next listener.
    next: u64,
}

/// Somebody who is told what comes.
pub(super) struct Listener<'n> {
    news: &'n News,
    number: u64,
    bell: watch::Receiver<()>,
}

/// Some of it was missed.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Missed;

impl News {
    pub(super) fn new() -> Self {
        Self { log: Mutex::default(), bell: watch::Sender::new(()) }
    }

    pub(super) fn tell(&self, text: Arc<str>) {
        let mut log = unpoisoned(&self.log);
        log.bytes += text.len();
        log.texts.push_back(text);
        log.forget();
        drop(log);
        self.bell.send_replace(());
    }

    /// Somebody who is told what comes from now on.
    pub(super) fn listen(&self) -> Listener<'_> {
        let bell = self.bell.subscribe();
        let mut log = unpoisoned(&self.log);
        let number = log.next;
        log.next += 1;
        let told = log.gone + log.texts.len() as u64;
        log.taken.insert(number, told);
        Listener { news: self, number, bell }
    }
}

impl Log {
    fn forget(&mut self) {
        let wanted = self.taken.values().min().copied().unwrap_or(u64::MAX);
        while let Some(first) = self.texts.front() {
            // The last one stays, however large: otherwise everybody would miss it.
            let is_much =
                self.texts.len() > BEHIND || (self.bytes > BEHIND_BYTES && self.texts.len() > 1);
            if wanted <= self.gone && !is_much {
                return;
            }
            self.bytes -= first.len();
            self.texts.pop_front();
            self.gone += 1;
        }
    }
}

impl Listener<'_> {
    /// What comes next, as soon as it comes; an error if that is forgotten already.
    pub(super) async fn next(&mut self) -> Result<Arc<str>, Missed> {
        loop {
            if let Some(next) = self.take() {
                return next;
            }
            // It rings as long as there are news, which outlive whoever listens.
            let _ = self.bell.changed().await;
        }
    }

    fn take(&self) -> Option<Result<Arc<str>, Missed>> {
        let mut log = unpoisoned(&self.news.log);
        let taken = log.taken.get(&self.number).copied()?;
        let Some(index) = taken.checked_sub(log.gone) else { return Some(Err(Missed)) };
        let text = log.texts.get(index as usize)?.clone();
        log.taken.insert(self.number, taken + 1);
        log.forget();
        Some(Ok(text))
    }
}

impl Drop for Listener<'_> {
    fn drop(&mut self) {
        let mut log = unpoisoned(&self.news.log);
        log.taken.remove(&self.number);
        log.forget();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many texts are remembered.
    fn remembered(news: &News) -> usize {
        let log = unpoisoned(&news.log);
        assert_eq!(log.bytes, log.texts.iter().map(|text| text.len()).sum::<usize>());
        log.texts.len()
    }

    fn tell(news: &News, text: &str) {
        news.tell(text.into());
    }

    #[test]
    fn what_all_have_taken_is_forgotten() {
        let news = News::new();
        tell(&news, "nobody listens");
        assert_eq!(remembered(&news), 0);
        let (quick, slow) = (news.listen(), news.listen());
        tell(&news, "a");
        tell(&news, "b");
        let take = |listener: &Listener<'_>| listener.take().map(|text| text.unwrap().to_string());
        assert_eq!([(); 3].map(|()| take(&quick)), [Some("a".into()), Some("b".into()), None]);
        assert_eq!((take(&slow), remembered(&news)), (Some("a".into()), 1));
        let late = news.listen();
        assert_eq!(take(&late), None);
        drop(slow);
        assert_eq!(remembered(&news), 0);
    }

    #[test]
    fn who_never_takes_anything_misses_it() {
        let news = News::new();
        let (slow, quick) = (news.listen(), news.listen());
        for _ in 0..=BEHIND {
            tell(&news, "x");
            assert_eq!(quick.take().unwrap(), Ok("x".into()));
        }
        assert_eq!((slow.take(), remembered(&news)), (Some(Err(Missed)), BEHIND));
        let slow = news.listen();
        let half = "x".repeat(BEHIND_BYTES / 2 + 1);
        tell(&news, &half);
        assert_eq!(slow.take().unwrap().unwrap().len(), half.len());
        tell(&news, &half);
        tell(&news, &half);
        assert_eq!((slow.take(), remembered(&news)), (Some(Err(Missed)), 1));
    }

    #[test]
    fn what_is_too_large_is_told_all_the_same() {
        let news = News::new();
        let listener = news.listen();
        tell(&news, &"x".repeat(BEHIND_BYTES + 1));
        assert!(listener.take().unwrap().is_ok());
        assert_eq!(remembered(&news), 0);
    }
}
