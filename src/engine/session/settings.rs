//! How a session works: threads, memory, and the folder of results.

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use maquette_graph::catalog::Catalog;

use crate::eval::{Disk, DiskError, Evaluator, ThreadsError};

/// How a session works. Nothing of it changes a result, but a node for which there is too little memory has none.
#[derive(Clone, Debug)]
pub struct Settings {
    /// How many threads there are, at most 1024; 0: as many as the machine has.
    pub threads: usize,
    /// How many bytes of memory results may hold when no node needs them any more.
    pub memory: usize,
    /// How many bytes results and nodes under way may hold together; none for nine tenths of what the machine has left, where the
    /// system tells that. A node that says that it needs more fails before it begins: see [`Node::estimate`](maquette_node::Node::estimate).
    pub max_memory: Option<u64>,
    /// Where results are kept from one process to the next.
    pub cache: CacheFolder,
    /// The server through which machines share what is kept there.
    pub server: CacheServer,
    /// Which share (0 to 1) of the results that are known is computed all the same, and compared.
    pub verify: f64,
}

/// Where results are kept from one process to the next.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum CacheFolder {
    /// Where the command line keeps them: `$MAQUETTE_CACHE`, or `maquette` in the system's folder for caches.
    #[default]
    Default,
    /// In this folder.
    At(PathBuf),
    /// Nowhere.
    None,
}

/// The server through which machines share results: see [`Disk::sharing`]. Without a folder for results there is none.
#[derive(Clone, Default, PartialEq, Eq)]
pub enum CacheServer {
    /// That of the command line: `$MAQUETTE_CACHE_REMOTE`, if it is set.
    #[default]
    Default,
    /// At this address.
    At(String),
    /// None.
    None,
}

/// An address may hold a password.
impl fmt::Debug for CacheServer {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(match self {
            Self::Default => "Default",
            Self::At(_) => "At(..)",
            Self::None => "None",
        })
    }
}

/// Why there is no session.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The threads.
    #[error(transparent)]
    Threads(#[from] ThreadsError),
    /// The folder that was named for results is somebody's.
    #[error("{0}; --cache chooses another folder")]
    Cache(DiskError),
    /// `MAQUETTE_CACHE_SIZE` is no size.
    #[error("{0}")]
    Size(String),
    /// The server of results has no such address.
    #[error("{0}")]
    Server(String),
}

/// How much memory results may hold unless something else is asked for.
const MEMORY: usize = 2_000_000_000;

/// How much the folder of results may hold, unless `MAQUETTE_CACHE_SIZE` says otherwise.
const DISK_SIZE: u64 = 4_000_000_000;

/// The variable that names the server of results.
const SERVER: &str = "MAQUETTE_CACHE_REMOTE";

impl Default for Settings {
    /// As the command line works: all threads, 2 GB, and the folder of results that it uses, too.
    fn default() -> Self {
        let (cache, server) = (CacheFolder::Default, CacheServer::Default);
        Self { threads: 0, memory: MEMORY, max_memory: None, cache, server, verify: 0.0 }
    }
}

impl Settings {
    /// All threads, 2 GB, nothing on disk.
    pub fn in_memory() -> Self {
        Self { cache: CacheFolder::None, ..Self::default() }
    }

    /// The same with so much memory, as people write it: `2GB`, `500 MB`, `1.5GiB`, or a number of bytes.
    ///
    /// # Errors
    /// In words, if the text is no size.
    pub fn with_memory(self, text: &str) -> Result<Self, String> {
        Ok(Self { memory: usize::try_from(size(text)?).unwrap_or(usize::MAX), ..self })
    }

    /// The same, with at most so much memory for results and nodes under way together, as [`with_memory`](Self::with_memory) reads it.
    ///
    /// # Errors
    /// In words, if the text is no size.
    pub fn with_max_memory(self, text: &str) -> Result<Self, String> {
        Ok(Self { max_memory: Some(size(text)?), ..self })
    }

    /// An evaluator on these threads, and why it does not keep results on disk though it should.
    pub(super) fn evaluator(
        &self,
        catalog: &Catalog,
        threads: Arc<rayon::ThreadPool>,
    ) -> Result<(Evaluator, Option<String>), SessionError> {
        let mut evaluator = Evaluator::on(threads, self.memory).verifying(self.verify);
        if let Some(most) = self.max_memory {
            evaluator = evaluator.holding_at_most(most);
        }
        let (folder, named) = match &self.cache {
            CacheFolder::Default => (default_folder(), false),
            CacheFolder::At(folder) => (Some(folder.clone()), true),
            CacheFolder::None => (None, false),
        };
        let Some(folder) = folder else { return Ok((evaluator, None)) };
        match Disk::open(&folder, disk_size().map_err(SessionError::Size)?, catalog) {
            Ok(disk) => {
                let disk = self.server.shared(disk).map_err(SessionError::Server)?;
                Ok((evaluator.with_disk(disk), None))
            }
            // Who names somebody's folder here does not mean what it says.
            Err(error @ (DiskError::Foreign(_) | DiskError::OtherUser(_))) if named => {
                Err(SessionError::Cache(error))
            }
            Err(error) => {
                let warning =
                    format!("{error}; results are not kept (--cache chooses another folder)");
                Ok((evaluator, Some(warning)))
            }
        }
    }
}

impl CacheServer {
    /// Results on disk that are shared through this server.
    fn shared(&self, disk: Disk) -> Result<Disk, String> {
        match self.address() {
            Some((named, address)) => {
                disk.sharing(&address).map_err(|why| format!("{named}: {why}"))
            }
            None => Ok(disk),
        }
    }

    /// Where the server is named, and its address.
    pub fn address(&self) -> Option<(&'static str, String)> {
        match self {
            Self::Default => {
                let named = std::env::var(SERVER).ok().filter(|address| !address.is_empty());
                named.map(|address| (SERVER, address))
            }
            Self::At(address) => Some(("--cache-remote", address.clone())),
            Self::None => None,
        }
    }
}

/// How much the folder of results may hold.
pub fn disk_size() -> Result<u64, String> {
    match std::env::var("MAQUETTE_CACHE_SIZE") {
        Ok(text) => size(&text).map_err(|why| format!("MAQUETTE_CACHE_SIZE: {why}")),
        Err(_) => Ok(DISK_SIZE),
    }
}

/// The folder for results of a user who names none; none where the system has no such place.
pub fn default_folder() -> Option<PathBuf> {
    let named =
        |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    if let Some(folder) = named("MAQUETTE_CACHE") {
        return Some(folder);
    }
    let system = if cfg!(windows) {
        named("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        named("HOME").map(|home| home.join("Library/Caches"))
    } else {
        named("HOME").map(|home| home.join(".cache"))
    };
    // As the specification of these folders says, one that is not absolute is none.
    let common = named("XDG_CACHE_HOME").filter(|folder| folder.is_absolute());
    common.or(system).map(|folder| folder.join("maquette"))
}

/// `2GB`, `500 MB`, `1.5GiB`, or a number of bytes.
pub fn size(text: &str) -> Result<u64, String> {
    let digits = text.trim().trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit = match text.trim()[digits.len()..].to_ascii_lowercase().as_str() {
        "" | "b" => 1.0,
        "k" | "kb" => 1e3,
        "m" | "mb" => 1e6,
        "g" | "gb" => 1e9,
        "t" | "tb" => 1e12,
        "kib" => 1024.0,
        "mib" => 1_048_576.0,
        "gib" => 1_073_741_824.0,
        _ => return Err(format!("`{text}` is no size: write 500MB or 2GB")),
    };
    match digits.trim().parse::<f64>() {
        Ok(number) if number.is_finite() && 0.0 <= number => Ok((number * unit) as u64),
        _ => Err(format!("`{text}` is no size: write 500MB or 2GB")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_with_and_without_a_unit() {
        let sizes = ["1000", "2GB", "1.5 GiB", "500mb", "0"].map(|text| size(text).unwrap());
        assert_eq!(sizes, [1000, 2_000_000_000, 1_610_612_736, 500_000_000, 0]);
        for bad in ["", "GB", "-1MB", "2 flops", "nan", "1e999"] {
            assert!(size(bad).is_err(), "{bad}");
        }
    }
}
