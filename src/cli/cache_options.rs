//! Options for the cache of results: folder, server and memory.

use std::collections::BTreeSet;
use std::ops::{Deref, DerefMut};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use clap::Args;
use maquette_engine::session::{CacheFolder, CacheServer, Session, Settings, size};
use maquette_graph::catalog::Catalog;

use super::eprint;

/// The default of the option `--memory`, in bytes.
const DEFAULT_MEMORY: u64 = 2_000_000_000;

/// Options for the cache of results.
#[derive(Args)]
pub(super) struct CacheOptions {
    /// The folder in which results are cached between runs [default: $MAQUETTE_CACHE, or `maquette` in the system's folder for caches].
    #[arg(id = "cache", long = "cache", value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Neither read nor write the cache on disk.
    #[arg(long, conflicts_with = "cache")]
    no_cache: bool,
    /// A cache server that machines share, such as http://host:8080/results: any server that stores PUT and answers GET. The URL may
    /// contain a user name and a password; a token may be in MAQUETTE_CACHE_REMOTE_TOKEN. Builds with the feature `s3` accept https:// and
    /// s3://BUCKET/PREFIX, too, with keys in AWS_ACCESS_KEY_ID and so on [default: $MAQUETTE_CACHE_REMOTE].
    #[arg(long, value_name = "URL", conflicts_with = "no_cache")]
    cache_remote: Option<String>,
    /// The memory for results that no running node needs, such as 500MB or 2GB. Running nodes, the files that they read and the program
    /// itself (about 20 MB) need more.
    #[arg(long, value_name = "SIZE", default_value = "2GB", value_parser = size)]
    memory: u64,
    /// The memory for results and running nodes together, such as 4GB. A node that needs more fails before it begins, and its error gives
    /// the amount [default: 90 % of the free memory].
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(super) max_memory: Option<u64>,
    /// Compute this percentage of the cached results again, and report every node whose result differs.
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0, value_parser = parse_percentage)]
    verify_cache: f64,
}

impl CacheOptions {
    /// Returns the value of the option `--memory` in bytes.
    pub(super) fn memory(&self) -> usize {
        usize::try_from(self.memory).unwrap_or(usize::MAX)
    }

    /// Opens a session with these options. If the disk cache cannot be used, prints a warning and continues without it.
    pub(super) fn session(
        &self,
        threads: usize,
        catalog: &Arc<Catalog>,
    ) -> Result<Session, String> {
        open_session(catalog, &self.settings(threads))
    }

    /// Opens a session. When it is dropped, it prints warnings about the cache.
    pub(super) fn reporting_session(
        &self,
        threads: usize,
        catalog: &Arc<Catalog>,
    ) -> Result<ReportingSession, String> {
        self.session(threads, catalog).map(ReportingSession)
    }

    /// Opens one of several sessions that run at the same time. The memory for results is divided equally between them.
    pub(super) fn session_of(
        &self,
        sessions: usize,
        threads: usize,
        catalog: &Arc<Catalog>,
    ) -> Result<Session, String> {
        let settings = self.settings(threads);
        let memory = settings.memory / sessions.max(1);
        open_session(catalog, &Settings { memory, ..settings })
    }

    /// Returns the arguments that give another process the same cache options.
    pub(super) fn arguments(&self) -> Vec<String> {
        // Make the path absolute, because the other process may run in another folder.
        self.arguments_with(|folder| {
            std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned()).display().to_string()
        })
    }

    /// Returns the arguments that give another process the same cache options. `folder_in_words` formats the path of the cache folder.
    pub(super) fn arguments_with(&self, folder_in_words: impl Fn(&Path) -> String) -> Vec<String> {
        let mut words = match (&self.folder, self.no_cache) {
            (_, true) => vec!["--no-cache".into()],
            (Some(folder), _) => vec!["--cache".into(), folder_in_words(folder)],
            (None, _) => Vec::new(),
        };
        // Leave out a server URL that contains a password, because other users can read command lines.
        if let Some(server) = self.cache_remote.as_ref().filter(|_| !self.hides_server()) {
            words.extend(["--cache-remote".into(), server.clone()]);
        }
        if self.memory != DEFAULT_MEMORY {
            words.extend(["--memory".into(), format!("{}B", self.memory)]);
        }
        if let Some(most) = self.max_memory {
            words.extend(["--max-memory".into(), format!("{most}B")]);
        }
        words
    }

    /// Returns true if [`Self::arguments`] leaves the server out because its URL contains a user name or a password.
    pub(super) fn hides_server(&self) -> bool {
        self.cache_remote.as_ref().is_some_and(|server| {
            let rest = server.split_once("://").map_or(&server[..], |(_, rest)| rest);
            rest.split(['/', '?', '#']).next().is_some_and(|host| host.contains('@'))
        })
    }

    fn settings(&self, threads: usize) -> Settings {
        let cache = match (&self.folder, self.no_cache) {
            (_, true) => CacheFolder::None,
            (Some(folder), _) => CacheFolder::At(folder.clone()),
            (None, _) => CacheFolder::Default,
        };
        Settings {
            threads,
            memory: self.memory(),
            max_memory: self.max_memory,
            cache,
            server: self.cache_remote.clone().map_or(CacheServer::Default, CacheServer::At),
            verify: self.verify_cache / 100.0,
        }
    }
}

fn open_session(catalog: &Arc<Catalog>, settings: &Settings) -> Result<Session, String> {
    let session = Session::with_catalog(catalog.clone(), settings);
    let session = session.map_err(|error| error.to_string())?;
    if let Some(warning) = session.disk_warning() {
        warn_once(warning);
    }
    Ok(session)
}

/// A session that calls [`finish`] when it is dropped.
pub(super) struct ReportingSession(Session);

impl Deref for ReportingSession {
    type Target = Session;

    fn deref(&self) -> &Session {
        &self.0
    }
}

impl DerefMut for ReportingSession {
    fn deref_mut(&mut self) -> &mut Session {
        &mut self.0
    }
}

impl Drop for ReportingSession {
    fn drop(&mut self) {
        finish(&self.0);
    }
}

/// Waits until all results of the session are on disk. Prints a warning if results could not be stored, or if the cache server failed.
pub(super) fn finish(session: &Session) {
    session.finish();
    session.cache_warnings().iter().for_each(|warning| warn_once(warning));
}

/// Prints a warning, unless this process has already printed it.
fn warn_once(warning: &str) {
    static REPORTED: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
    let mut reported = REPORTED.lock().unwrap_or_else(PoisonError::into_inner);
    if reported.insert(warning.to_owned()) {
        eprint(&format!("warning: {warning}\n"));
    }
}

fn parse_percentage(text: &str) -> Result<f64, String> {
    let number = text.trim().trim_end_matches('%').trim_end().parse::<f64>();
    let inside = number.ok().filter(|number| (0.0..=100.0).contains(number));
    inside.ok_or_else(|| "expected a number from 0 to 100".into())
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use maquette_graph::catalog::Catalog;

    use super::*;

    #[derive(Parser)]
    struct Words {
        #[command(flatten)]
        cache: CacheOptions,
    }

    #[test]
    fn options_for_memory_are_passed_on() {
        fn words(words: &[&str]) -> Vec<String> {
            Words::parse_from([&["maquette"], words].concat()).cache.arguments()
        }
        assert_eq!(words(&["--memory", "2GB"]), Vec::<String>::new());
        let said = words(&["--no-cache", "--memory", "1.5GB", "--max-memory", "4GB"]);
        let again = ["--no-cache", "--memory", "1500000000B", "--max-memory", "4000000000B"];
        assert_eq!(said, again);
        assert_eq!(words(&again), again);
    }

    #[test]
    fn a_url_with_a_password_is_not_passed_on() {
        fn remote(url: &str) -> CacheOptions {
            Words::parse_from(["maquette", "--cache-remote", url]).cache
        }
        for hidden in ["http://me:secret@host/x", "http://me@host"] {
            assert!(
                remote(hidden).hides_server() && remote(hidden).arguments().is_empty(),
                "{hidden}"
            );
        }
        for shown in ["http://host/a@b", "s3://bucket/a@b", "http://host:8080/x"] {
            assert_eq!(remote(shown).arguments(), ["--cache-remote", shown]);
        }
    }

    #[test]
    fn sessions_that_work_at_the_same_time_share_the_memory() {
        let words = ["maquette", "--no-cache", "--memory", "1GB"];
        let catalog = Arc::new(Catalog::new(&[]));
        let Words { cache } = Words::parse_from(words);
        fn memory(sessions: usize, cache: &CacheOptions, catalog: &Arc<Catalog>) -> usize {
            cache.session_of(sessions, 1, catalog).unwrap().memory()
        }
        assert_eq!(
            (memory(1, &cache, &catalog), memory(4, &cache, &catalog)),
            (1_000_000_000, 250_000_000)
        );
    }
}
