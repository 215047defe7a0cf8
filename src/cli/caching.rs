//! How much is remembered, and where.

use std::collections::BTreeSet;
use std::ops::{Deref, DerefMut};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use clap::Args;
use maquette_engine::session::{CacheFolder, CacheServer, Session, Settings, size};
use maquette_graph::catalog::Catalog;

use super::eprint;

/// How many bytes of memory results may hold if nothing is said.
const DEFAULT_MEMORY: u64 = 2_000_000_000;

/// What shapes the memory of results.
#[derive(Args)]
pub(super) struct CacheOptions {
    /// The folder of results that are kept from one run to the next [default: $MAQUETTE_CACHE, or `maquette` in the system's
    /// folder for caches].
    #[arg(long = "cache", value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Neither use nor keep results on disk.
    #[arg(long, conflicts_with = "folder")]
    no_cache: bool,
    /// A server through which machines share results, as http://host:8080/results: any that keeps what is PUT there and gives it to a
    /// GET. A name and password may stand before the host, a token in MAQUETTE_CACHE_REMOTE_TOKEN. Built with the feature `s3`,
    /// also https:// and s3://BUCKET/PREFIX, with keys in AWS_ACCESS_KEY_ID and its like [default: $MAQUETTE_CACHE_REMOTE].
    #[arg(long, value_name = "URL", conflicts_with = "no_cache")]
    cache_remote: Option<String>,
    /// How much memory results may hold when no node needs them any more, as 500MB or 2GB. What nodes are working on, the files
    /// that they read and the program itself, some 20 MB, come on top.
    #[arg(long, value_name = "SIZE", default_value = "2GB", value_parser = size)]
    memory: u64,
    /// How much memory results and nodes under way may hold together, as 4GB. A node that would need more fails, and says how much,
    /// before it begins [default: nine tenths of what the machine has left].
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(super) max_memory: Option<u64>,
    /// Compute this percentage of the cached results all the same, and name every node whose result differs.
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0, value_parser = percentage)]
    verify_cache: f64,
}

impl CacheOptions {
    /// How many bytes of memory results may hold.
    pub(super) fn memory(&self) -> usize {
        usize::try_from(self.memory).unwrap_or(usize::MAX)
    }

    /// A session that remembers as the user wishes; a cache that cannot be used is a warning.
    pub(super) fn session(
        &self,
        threads: usize,
        catalog: &Arc<Catalog>,
    ) -> Result<Session, String> {
        opened(catalog, &self.settings(threads))
    }

    /// The same, for whoever runs a graph and has nothing to tell of its end.
    pub(super) fn told_session(
        &self,
        threads: usize,
        catalog: &Arc<Catalog>,
    ) -> Result<ToldSession, String> {
        self.session(threads, catalog).map(ToldSession)
    }

    /// One of some sessions that work at the same time, with its share of the memory for results.
    pub(super) fn session_of(
        &self,
        sessions: usize,
        threads: usize,
        catalog: &Arc<Catalog>,
    ) -> Result<Session, String> {
        let settings = self.settings(threads);
        let memory = settings.memory / sessions.max(1);
        opened(catalog, &Settings { memory, ..settings })
    }

    /// The words that say where results are kept, and how much memory may be used.
    pub(super) fn words(&self) -> Vec<String> {
        // It is read from another folder than this program's own.
        self.words_for(|folder| {
            std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned()).display().to_string()
        })
    }

    /// The same with a way to write the folder.
    pub(super) fn words_for(&self, folder_in_words: impl Fn(&Path) -> String) -> Vec<String> {
        let mut words = match (&self.folder, self.no_cache) {
            (_, true) => vec!["--no-cache".into()],
            (Some(folder), _) => vec!["--cache".into(), folder_in_words(folder)],
            (None, _) => Vec::new(),
        };
        // Words are shown, passwords are not.
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

    /// Returns true if the words leave the server out, because its URL has a name or a password.
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

fn opened(catalog: &Arc<Catalog>, settings: &Settings) -> Result<Session, String> {
    let session = Session::with_catalog(catalog.clone(), settings);
    let session = session.map_err(|error| error.to_string())?;
    if let Some(trouble) = session.trouble() {
        warn_once(trouble);
    }
    Ok(session)
}

/// A session that [`finish`]es when it goes.
pub(super) struct ToldSession(Session);

impl Deref for ToldSession {
    type Target = Session;

    fn deref(&self) -> &Session {
        &self.0
    }
}

impl DerefMut for ToldSession {
    fn deref_mut(&mut self) -> &mut Session {
        &mut self.0
    }
}

impl Drop for ToldSession {
    fn drop(&mut self) {
        finish(&self.0);
    }
}

/// Waits until results are on disk, and says so if they cannot be kept, or what trouble there was with the server.
pub(super) fn finish(session: &Session) {
    session.finish();
    session.troubles().iter().for_each(|trouble| warn_once(trouble));
}

/// Warns, unless another session of this process had the same trouble.
fn warn_once(trouble: &str) {
    static TOLD: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
    let mut told = TOLD.lock().unwrap_or_else(PoisonError::into_inner);
    if told.insert(trouble.to_owned()) {
        eprint(&format!("warning: {trouble}\n"));
    }
}

fn percentage(text: &str) -> Result<f64, String> {
    let number = text.trim().trim_end_matches('%').trim_end().parse::<f64>();
    let inside = number.ok().filter(|number| (0.0..=100.0).contains(number));
    inside.ok_or_else(|| "write a number from 0 to 100".into())
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
    fn what_was_said_of_memory_is_said_again() {
        let words =
            |words: &[&str]| Words::parse_from([&["maquette"], words].concat()).cache.words();
        assert_eq!(words(&["--memory", "2GB"]), Vec::<String>::new());
        let said = words(&["--no-cache", "--memory", "1.5GB", "--max-memory", "4GB"]);
        let again = ["--no-cache", "--memory", "1500000000B", "--max-memory", "4000000000B"];
        assert_eq!(said, again);
        assert_eq!(words(&again), again);
    }

    #[test]
    fn a_password_is_no_word() {
        fn remote(url: &str) -> CacheOptions {
            Words::parse_from(["maquette", "--cache-remote", url]).cache
        }
        for hidden in ["http://me:secret@host/x", "http://me@host"] {
            assert!(remote(hidden).hides_server() && remote(hidden).words().is_empty(), "{hidden}");
        }
        for shown in ["http://host/a@b", "s3://bucket/a@b", "http://host:8080/x"] {
            assert_eq!(remote(shown).words(), ["--cache-remote", shown]);
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
