//! Exchanges results between the cache folder and a server.

use std::path::PathBuf;

use maquette_remote::{Address, Remote, RequestCounts, check_server};
use maquette_value::Hash;
use maquette_value::parallel::*;

use super::super::cache::Outcome;
use super::entry::Entry;
use super::seal::unseal;
use super::{Disk, Store};

/// The maximum size of an entry from a server, in bytes. Entries are small, because large data is in columns.
const MAX_ENTRY_BYTES: u64 = 64 << 20;

/// The environment variable that contains the access token for the server.
const TOKEN: &str = "MAQUETTE_CACHE_REMOTE_TOKEN";

impl Disk {
    /// Shares results with other machines through the server at this address, such as `http://host:8080/results`. The server must store
    /// files that are sent by `PUT` and return them to a `GET`. Name and password are part of the address; a token is read from
    /// `MAQUETTE_CACHE_REMOTE_TOKEN`. An address `https://` needs a build with the feature `tls`. An address `s3://bucket/results` needs
    /// the feature `s3`, and access keys in the usual variables such as `AWS_ACCESS_KEY_ID`.
    ///
    /// Undamaged results from the server are written to the cache folder, and new results are sent to the server. The results of a graph do
    /// not depend on the server: if it is slow, unreachable or sends wrong data, it is ignored. Everybody who can write to the server is
    /// trusted, just as for the folder.
    ///
    /// # Errors
    /// A message if the address is invalid, or if the access keys for an S3 bucket are missing.
    pub fn with_server(self, server: &str) -> Result<Self, String> {
        let fingerprint = self.store.home.file_name().unwrap_or_default().to_string_lossy();
        let remote = Remote::new(address(server)?, &fingerprint);
        let _ = self.store.remote.set(remote);
        Ok(self)
    }

    /// Returns the first error that the server caused, or `None`.
    pub fn server_error(&self) -> Option<&str> {
        self.store.remote.get()?.problem()
    }

    /// Returns the numbers of requests to the server so far, or `None` if no server is used.
    pub fn exchange(&self) -> Option<RequestCounts> {
        self.store.remote.get().map(Remote::request_counts)
    }

    /// Checks that a server responds at an address. Returns the address without name and password, and the error if there is no response.
    ///
    /// # Errors
    /// A message if the address is invalid.
    pub fn check_server(server: &str) -> Result<(String, Result<(), String>), String> {
        let address = address(server)?;
        Ok((address.to_string(), check_server(&address)))
    }

    /// Fetches the result with this key, which another machine computed, and writes it to the cache folder. Returns `None` if the server
    /// does not provide the result.
    pub(in super::super) fn fetch(&self, key: Hash) -> Option<Outcome> {
        self.store.fetch_entry(key).map(Entry::outcome)
    }
}

/// Parses the address of a server and reads the credentials for that server.
fn address(server: &str) -> Result<Address, String> {
    let token = std::env::var(TOKEN).ok().filter(|token| !token.is_empty());
    Address::parse(server, token.as_deref())
}

impl Store {
    /// Returns the server. Returns `None` if no server is used, or if an error prevents writing of the server's results to the cache
    /// folder.
    fn remote(&self) -> Option<&Remote> {
        self.remote.get().filter(|_| self.write_error.get().is_none())
    }

    /// Sends a cache file to the server. `is_new` is true if the file has just been written.
    pub(super) fn share(&self, path: impl FnOnce() -> PathBuf, is_new: bool) {
        if let Some(remote) = self.remote() {
            remote.put(path(), is_new);
        }
    }

    fn fetch_entry(&self, key: Hash) -> Option<Entry> {
        let (remote, path) = (self.remote()?, self.entry_path(key));
        let (entry, content) = remote.get(&path, MAX_ENTRY_BYTES, 0.0, |bytes| {
            let content = unseal(&path, bytes)?;
            Some((Entry::parse(content.clone(), key, &self.types)?, content))
        })?;
        self.write_checked(&path, &content);
        remote.record_saved_time(entry.seconds());
        Some(entry)
    }

    /// Fetches the missing columns of an entry from the server, if that is expected to take less than `seconds`.
    pub(super) fn fetch_columns(&self, entry: &Entry, seconds: f64) {
        let Some(remote) = self.remote() else { return };
        let missing: Vec<_> = entry
            .columns()
            .iter()
            .copied()
            .filter(|(hash, _)| !self.column_path(*hash).exists())
            .collect();
        let most = entry.size() as u64;
        missing.par_iter().for_each(|&(hash, items)| {
            let path = self.column_path(hash);
            if let Some(bytes) = remote.get(&path, most, seconds, |bytes| {
                Some(bytes).filter(|bytes| {
                    let mut hasher = blake3::Hasher::new();
                    hasher.update(&items.to_le_bytes()).update_rayon(bytes);
                    Hash(*hasher.finalize().as_bytes()) == hash
                })
            }) {
                self.write(&path, &[&bytes]);
            }
        });
    }
}
