//! Settings of a session: threads, memory limits, and the folder and server for results.

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use maquette_graph::catalog::Catalog;

use crate::eval::{Disk, DiskError, Evaluator};

/// The settings of a session. They do not affect results, except that a node fails if there is too little memory for it.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The number of threads, from 0 to 1024. 0 means one thread per processor.
    pub threads: usize,
    /// The maximum size, in bytes, of results in memory that no running node needs.
    pub memory: usize,
    /// The maximum memory of results and running nodes together, in bytes. If it is `None`, the limit is nine tenths of the free memory of
    /// the machine; there is no limit if the system does not report its free memory. A node whose estimate exceeds the limit fails before
    /// it runs: see [`Node::estimate`](maquette_node::Node::estimate).
    pub max_memory: Option<u64>,
    /// The folder in which results are kept from one process to the next.
    pub cache: CacheFolder,
    /// The server through which machines share results.
    pub server: CacheServer,
    /// The fraction (0 to 1) of cached results that is computed again and compared with the cache.
    pub verify: f64,
}

/// The folder in which results are kept from one process to the next.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum CacheFolder {
    /// The default folder of the command line: `$MAQUETTE_CACHE`, or the folder `maquette` in the system's folder for caches.
    #[default]
    Default,
    /// Results are kept in the folder at this path.
    At(PathBuf),
    /// No folder: results are kept only in memory.
    None,
}

/// The server through which machines share results: see [`Disk::with_server`]. The server is used only if there is also a folder for
/// results.
#[derive(Clone, Default, PartialEq, Eq)]
pub enum CacheServer {
    /// The default server of the command line: the address in `$MAQUETTE_CACHE_REMOTE`, or no server if that is not set.
    #[default]
    Default,
    /// Results are shared through the server at this address.
    At(String),
    /// Results are not shared.
    None,
}

/// Hides the address, because it may contain a password.
impl fmt::Debug for CacheServer {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(match self {
            Self::Default => "Default",
            Self::At(_) => "At(..)",
            Self::None => "None",
        })
    }
}

/// The reason why a session could not be created.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct SessionError(pub(super) String);

/// The default maximum size of the results in memory, in bytes.
const MEMORY: usize = 2_000_000_000;

/// The default maximum size of the folder for results, in bytes.
const DISK_SIZE: u64 = 4_000_000_000;

/// The environment variable that contains the address of the server for results.
const SERVER: &str = "MAQUETTE_CACHE_REMOTE";

impl Default for Settings {
    /// Returns the default settings of the command line: one thread per processor, 2 GB of memory, and the default folder for results.
    fn default() -> Self {
        let (cache, server) = (CacheFolder::Default, CacheServer::Default);
        Self { threads: 0, memory: MEMORY, max_memory: None, cache, server, verify: 0.0 }
    }
}

impl Settings {
    /// Returns settings with one thread per processor and 2 GB of memory. Nothing is stored on disk.
    pub fn in_memory() -> Self {
        Self { cache: CacheFolder::None, ..Self::default() }
    }

    /// Sets the maximum size of the results in memory, from a text such as `2GB`, `500 MB`, `1.5GiB`, or a number of bytes.
    ///
    /// # Errors
    /// A message if the text is not a size.
    pub fn with_memory(self, text: &str) -> Result<Self, String> {
        Ok(Self { memory: usize::try_from(size(text)?).unwrap_or(usize::MAX), ..self })
    }

    /// Sets the maximum memory of results and running nodes together. The text has the same form as for [`with_memory`](Self::with_memory).
    ///
    /// # Errors
    /// A message if the text is not a size.
    pub fn with_max_memory(self, text: &str) -> Result<Self, String> {
        Ok(Self { max_memory: Some(size(text)?), ..self })
    }

    /// Creates an evaluator that runs on the given threads. Also returns the reason why the evaluator does not write results to disk
    /// although the settings ask for it; `None` if nothing prevents writing.
    pub(super) fn evaluator(
        &self,
        catalog: &Catalog,
        threads: Arc<rayon::ThreadPool>,
    ) -> Result<(Evaluator, Option<String>), SessionError> {
        let mut evaluator =
            Evaluator::with_threads(threads, self.memory).with_verification(self.verify);
        if let Some(most) = self.max_memory {
            evaluator = evaluator.with_max_memory(most);
        }
        let (folder, named) = match &self.cache {
            CacheFolder::Default => (default_folder(), false),
            CacheFolder::At(folder) => (Some(folder.clone()), true),
            CacheFolder::None => (None, false),
        };
        let Some(folder) = folder else { return Ok((evaluator, None)) };
        match Disk::open(&folder, disk_size().map_err(SessionError)?, catalog) {
            Ok(disk) => {
                let disk = self.server.connect(disk).map_err(SessionError)?;
                Ok((evaluator.with_disk(disk), None))
            }
            // Return an error: the user has given the folder explicitly, and it is probably the wrong one.
            Err(error @ (DiskError::Foreign(_) | DiskError::OtherUser(_))) if named => {
                Err(SessionError(format!("{error}; --cache chooses another folder")))
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
    /// Connects the disk cache to the server that the settings name, if they name one.
    fn connect(&self, disk: Disk) -> Result<Disk, String> {
        match self.address() {
            Some((named, address)) => {
                disk.with_server(&address).map_err(|why| format!("{named}: {why}"))
            }
            None => Ok(disk),
        }
    }

    /// Returns the address of the server, after the name of the option or environment variable that contains it; `None` if no server is
    /// used.
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

/// Returns the maximum size of the folder for results, in bytes. It is an error if `$MAQUETTE_CACHE_SIZE` is set but is not a size.
pub fn disk_size() -> Result<u64, String> {
    match std::env::var("MAQUETTE_CACHE_SIZE") {
        Ok(text) => size(&text).map_err(|why| format!("MAQUETTE_CACHE_SIZE: {why}")),
        Err(_) => Ok(DISK_SIZE),
    }
}

/// Returns the default folder for results, or `None` if the system has no folder for caches.
pub fn default_folder() -> Option<PathBuf> {
    fn folder_in(variable: &str) -> Option<PathBuf> {
        std::env::var_os(variable).filter(|value| !value.is_empty()).map(PathBuf::from)
    }
    if let Some(folder) = folder_in("MAQUETTE_CACHE") {
        return Some(folder);
    }
    let system = if cfg!(windows) {
        folder_in("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        folder_in("HOME").map(|home| home.join("Library/Caches"))
    } else {
        folder_in("HOME").map(|home| home.join(".cache"))
    };
    // Ignore a relative path, as the XDG Base Directory Specification requires.
    let common = folder_in("XDG_CACHE_HOME").filter(|folder| folder.is_absolute());
    common.or(system).map(|folder| folder.join("maquette"))
}

/// Parses a size in bytes, such as `2GB`, `500 MB`, `1.5GiB`, or a number of bytes.
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
        _ => return Err(format!("`{text}` is not a size: write 500MB or 2GB")),
    };
    match digits.trim().parse::<f64>() {
        Ok(number) if number.is_finite() && 0.0 <= number => Ok((number * unit) as u64),
        _ => Err(format!("`{text}` is not a size: write 500MB or 2GB")),
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
