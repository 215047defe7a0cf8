//! What goes from the folder to a server of results, and comes from there into it.

use std::path::PathBuf;

use maquette_remote::{Address, Exchange, Remote, reach};
use maquette_value::Hash;
use maquette_value::parallel::*;

use super::super::cache::Outcome;
use super::entry::Entry;
use super::seal::unsealed;
use super::{Disk, Store};

/// The longest entry that is taken from a server: what is large in a result is in its columns.
const MOST: u64 = 64 << 20;

/// The variable with what is shown to a server that asks for a token.
const TOKEN: &str = "MAQUETTE_CACHE_REMOTE_TOKEN";

impl Disk {
    /// The same, sharing results with other machines through the server at this address, such as `http://host:8080/results`: one that
    /// keeps what is `PUT` there and gives it to a `GET`. A name and password stand in the address, a token in
    /// `MAQUETTE_CACHE_REMOTE_TOKEN`. `https://` is for builds with the feature `tls`, `s3://bucket/results` for those with the feature
    /// `s3`, whose keys are in the usual variables, such as `AWS_ACCESS_KEY_ID`.
    ///
    /// What is found there is put into the folder, if it is whole, and what is kept in the folder from now on is sent there. No result
    /// hangs on the server: one that is slow, lost or wrong is left alone. Who may write there is trusted, as in the folder.
    ///
    /// # Errors
    /// In words, if it is no address, or there are no keys for a bucket.
    pub fn sharing(self, server: &str) -> Result<Self, String> {
        let fingerprint = self.store.home.file_name().unwrap_or_default().to_string_lossy();
        let remote = Remote::new(address(server)?, &fingerprint);
        let _ = self.store.remote.set(remote);
        Ok(self)
    }

    /// The first trouble with the server, if there was any.
    pub fn server_trouble(&self) -> Option<&str> {
        self.store.remote.get()?.trouble()
    }

    /// What the server was asked for so far; none if there is none.
    pub fn exchange(&self) -> Option<Exchange> {
        self.store.remote.get().map(Remote::exchange)
    }

    /// Whether there is a server that answers at an address, which is given back without name and password; else why not.
    ///
    /// # Errors
    /// In words, if it is no address.
    pub fn reach(server: &str) -> Result<(String, Result<(), String>), String> {
        let address = address(server)?;
        Ok((address.to_string(), reach(&address)))
    }

    /// What another machine has found, which is in the folder then.
    pub(in super::super) fn fetch(&self, key: Hash) -> Option<Outcome> {
        self.store.fetch_entry(key).map(Entry::outcome)
    }
}

/// The server at this address, and who one is there.
fn address(server: &str) -> Result<Address, String> {
    let token = std::env::var(TOKEN).ok().filter(|token| !token.is_empty());
    Address::parse(server, token.as_deref())
}

impl Store {
    /// The server, if what it gives can be put into the folder.
    fn remote(&self) -> Option<&Remote> {
        self.remote.get().filter(|_| self.trouble.get().is_none())
    }

    /// Sends a file that has just been written, or was there.
    pub(super) fn share(&self, path: impl FnOnce() -> PathBuf, is_new: bool) {
        if let Some(remote) = self.remote() {
            remote.put(path(), is_new);
        }
    }

    fn fetch_entry(&self, key: Hash) -> Option<Entry> {
        let (remote, path) = (self.remote()?, self.entry_path(key));
        let (entry, content) = remote.get(&path, MOST, 0.0, |bytes| {
            let content = unsealed(&path, bytes)?;
            Some((Entry::parse(content.clone(), key, &self.types)?, content))
        })?;
        self.write_checked(&path, &content);
        remote.has_saved(entry.seconds());
        Some(entry)
    }

    /// Takes the columns of an entry that are not in the folder from the server, if that is quicker than so many seconds.
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
