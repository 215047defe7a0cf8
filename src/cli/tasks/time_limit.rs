//! The time limit of a task.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use maquette_node::CancelToken;

/// Cancels a task when its time is over, or when all tasks are cancelled.
pub(super) struct TimeLimit {
    token: CancelToken,
    is_over: Arc<AtomicBool>,
    /// The connection to the thread that measures the time. The thread ends when this sender is dropped.
    _clock: Option<Sender<()>>,
}

impl TimeLimit {
    /// The interval at which the thread checks if all tasks have been cancelled.
    const CHECK_INTERVAL: Duration = Duration::from_millis(20);

    pub(super) fn start(limit: Option<Duration>, all: &CancelToken) -> Self {
        let is_over = Arc::<AtomicBool>::default();
        let Some(limit) = limit else {
            return Self { token: all.clone(), is_over, _clock: None };
        };
        let token = CancelToken::default();
        let (clock, stopped) = channel::<()>();
        let of_clock = (token.clone(), is_over.clone(), all.clone());
        std::thread::spawn(move || {
            let ((token, is_over, all), start) = (of_clock, Instant::now());
            while stopped.recv_timeout(Self::CHECK_INTERVAL) == Err(RecvTimeoutError::Timeout) {
                let is_late = limit <= start.elapsed();
                if is_late || all.is_cancelled() {
                    is_over.store(is_late && !all.is_cancelled(), Ordering::Relaxed);
                    return token.cancel();
                }
            }
        });
        Self { token, is_over, _clock: Some(clock) }
    }

    /// Returns the token that cancels the task.
    pub(super) fn token(&self) -> &CancelToken {
        &self.token
    }

    /// Returns true if the task was cancelled because it exceeded its time limit.
    pub(super) fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }
}

/// Parses a time such as `90s`, `30min` or `1h 30min`.
///
/// # Errors
/// A message if the text is not a time, or the time is zero.
pub(crate) fn parse_time(text: &str) -> Result<Duration, String> {
    let wrong = || format!("expected a time such as 90s, 30min or 2h, found `{text}`");
    let (mut seconds, mut rest) = (0.0, text.trim());
    while !rest.is_empty() {
        let digits = rest.find(|c: char| !c.is_ascii_digit() && c != '.').ok_or_else(wrong)?;
        let number = rest[..digits].parse::<f64>().map_err(|_| wrong())?;
        rest = rest[digits..].trim_start();
        let letters = rest.find(|c: char| !c.is_ascii_alphabetic()).unwrap_or(rest.len());
        let unit = match &rest[..letters] {
            "s" => 1.0,
            "min" | "m" => 60.0,
            "h" => 3600.0,
            "d" => 86400.0,
            _ => return Err(wrong()),
        };
        seconds += number * unit;
        rest = rest[letters..].trim_start();
    }
    Duration::try_from_secs_f64(seconds).ok().filter(|time| !time.is_zero()).ok_or_else(wrong)
}

/// Formats a time so that [`parse_time`] can parse it.
pub(crate) fn format_time(time: Duration) -> String {
    let seconds = time.as_secs();
    if time.subsec_nanos() != 0 {
        return format!("{}s", time.as_secs_f64());
    }
    let parts = [(seconds / 3600, "h"), (seconds / 60 % 60, "min"), (seconds % 60, "s")];
    let parts = parts.iter().filter(|(count, _)| *count != 0);
    parts.map(|(count, unit)| format!("{count}{unit}")).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formatted_times_can_be_parsed() {
        for (text, seconds, words) in [
            ("90s", 90.0, "1min 30s"),
            ("30min", 1800.0, "30min"),
            ("2h", 7200.0, "2h"),
            ("1h30min", 5400.0, "1h 30min"),
            ("0.5 s", 0.5, "0.5s"),
            ("1d", 86400.0, "24h"),
        ] {
            let found = parse_time(text).unwrap();
            assert_eq!((found.as_secs_f64(), &format_time(found)[..]), (seconds, words));
            assert_eq!(parse_time(words).unwrap(), found);
        }
        for wrong in ["", "5", "h", "0s", "-1s", "5 parsecs", "1e999h", "1..2s"] {
            assert!(parse_time(wrong).unwrap_err().starts_with("expected a time"), "{wrong}");
        }
    }

    #[test]
    fn a_task_is_cancelled_with_all_tasks_or_at_its_limit() {
        let all = CancelToken::default();
        fn wait(limit: &TimeLimit) -> bool {
            while !limit.token().is_cancelled() {
                std::thread::sleep(Duration::from_millis(1));
            }
            limit.is_over()
        }
        assert!(wait(&TimeLimit::start(Some(Duration::from_millis(1)), &all)));
        let limit = TimeLimit::start(Some(Duration::from_secs(3600)), &all);
        all.cancel();
        assert!(!wait(&limit));
    }
}
