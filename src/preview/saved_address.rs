//! Saves the port and token of the live page from one watch of a graph to the next. So the URL stays the same, and an open page reconnects
//! to the next watch.
//!
//! The port and token are saved in the user's private folder for program state. They are not saved with the cached results, which may be
//! deleted or shared. If they cannot be saved, the next watch has another URL.

use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use maquette_engine::writing;
use maquette_value::fs;

/// The port and token of a live page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct SavedAddress {
    pub(super) port: u16,
    /// The secret token: 32 hexadecimal digits.
    pub(super) token: String,
}

/// Saves the port and token of the live page of one graph in a file.
#[derive(Clone, Debug)]
pub struct Keeper {
    folder: PathBuf,
    /// The name of the file, derived from the path of the graph.
    name: String,
}

/// A file that redirects a browser to the live page. The file is removed when this is dropped.
pub struct Redirect(PathBuf);

/// The age at which redirect files of killed watches are removed. By then, the browser that was opened with such a file has read it.
const REDIRECT_LIFETIME: Duration = Duration::from_secs(3600);

impl SavedAddress {
    /// Parses the content of a saved file, such as `41953 0123..`. Returns `None` if it is invalid.
    fn read(text: &str) -> Option<Self> {
        let (port, token) = text.strip_suffix('\n')?.split_once(' ')?;
        let is_token = token.len() == 32
            && token.bytes().all(|byte: u8| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte));
        let port = port.parse().ok().filter(|port| *port > 0)?;
        is_token.then(|| Self { port, token: token.to_owned() })
    }
}

impl Keeper {
    /// Creates the keeper of a graph's address. Returns `None` if the system has no folder for program state.
    pub(super) fn for_graph(graph: &Path) -> Option<Self> {
        fn absolute(graph: &Path) -> PathBuf {
            std::path::absolute(graph).unwrap_or_else(|_| graph.to_owned())
        }
        let path = std::fs::canonicalize(graph).unwrap_or_else(|_| absolute(graph));
        let hash = blake3::hash(path.as_os_str().as_encoded_bytes()).to_hex();
        Some(Self { folder: folder()?, name: hash[..32].to_owned() })
    }

    /// Returns the saved port and token. Returns `None` if nothing is saved, or if other users can read or write the file.
    pub(super) fn load(&self) -> Option<SavedAddress> {
        let path = self.path();
        let metadata = std::fs::symlink_metadata(&path).ok()?;
        let is_secret = metadata.is_file() && writing::is_private(&metadata, 0o077);
        SavedAddress::read(&is_secret.then(|| fs::read_text_no_follow(&path).ok()).flatten()?)
    }

    pub(super) fn save(&self, SavedAddress { port, token }: &SavedAddress) -> io::Result<()> {
        writing::write_private(&self.path(), format!("{port} {token}\n").as_bytes())
    }

    fn path(&self) -> PathBuf {
        self.folder.join(&self.name)
    }

    /// Creates a file that redirects a browser to the URL `link`. The browser is started with the path of this file, because all users of
    /// the machine can see the arguments of programs, and the URL contains the secret token.
    pub(super) fn redirect(&self, port: u16, link: &str) -> io::Result<Redirect> {
        self.sweep();
        let path = self.folder.join(format!("{}-{port}.html", self.name));
        let text = format!(
            "<!doctype html>\n<meta charset=\"utf-8\">\n<meta name=\"referrer\" content=\"no-referrer\">\n\
             <meta http-equiv=\"refresh\" content=\"0; url={link}\">\n<title>maquette</title>\n<a href=\"{link}\">maquette</a>\n"
        );
        writing::write_private(&path, text.as_bytes())?;
        Ok(Redirect(path))
    }

    /// Removes redirect files that killed watches have left.
    fn sweep(&self) {
        for entry in std::fs::read_dir(&self.folder).into_iter().flatten().flatten() {
            let path = entry.path();
            let is_redirect = path.extension().is_some_and(|ending| ending == "html");
            let modified = entry.metadata().and_then(|metadata| metadata.modified()).ok();
            let age = modified.and_then(|time| SystemTime::now().duration_since(time).ok());
            if is_redirect && age.is_some_and(|age| age > REDIRECT_LIFETIME) {
                let _ = writing::remove(&path);
            }
        }
    }
}

impl Redirect {
    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Redirect {
    fn drop(&mut self) {
        let _ = writing::remove(&self.0);
    }
}

/// Returns the folder in which ports and tokens are saved, or `None` if the system has no folder for program state.
fn folder() -> Option<PathBuf> {
    fn variable(name: &str) -> Option<PathBuf> {
        std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from)
    }
    let system = if cfg!(windows) {
        variable("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        variable("HOME").map(|home| home.join("Library/Application Support"))
    } else {
        variable("HOME").map(|home| home.join(".local/state"))
    };
    // Ignore a relative path, as the XDG Base Directory Specification requires.
    let common = variable("XDG_STATE_HOME").filter(|folder| folder.is_absolute());
    common.or(system).map(|folder| folder.join("maquette").join("pages"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keeper(folder: &Path) -> Keeper {
        Keeper { folder: folder.join("deep/pages"), name: "graph".into() }
    }

    fn saved_address() -> SavedAddress {
        SavedAddress { port: 41953, token: "0123456789abcdef".repeat(2) }
    }

    #[test]
    fn a_saved_address_is_loaded() {
        let folder = tempfile::tempdir().unwrap();
        let keeper = keeper(folder.path());
        assert_eq!(keeper.load(), None);
        keeper.save(&saved_address()).unwrap();
        assert_eq!(keeper.load(), Some(saved_address()));
        let other = SavedAddress { port: 1, ..saved_address() };
        keeper.save(&other).unwrap();
        assert_eq!(keeper.load(), Some(other));
    }

    #[test]
    fn an_invalid_file_is_ignored() {
        let token = saved_address().token;
        assert!(SavedAddress::read(&format!("8 {token}\n")).is_some());
        for text in [
            String::new(),
            format!("0 {token}\n"),
            format!("65536 {token}\n"),
            format!("8 {token}"),
            format!("8 {}\n", &token[1..]),
            format!("8 {}\n", token.to_uppercase()),
            format!("8\n{token}\n"),
        ] {
            assert_eq!(SavedAddress::read(&text), None, "{text:?}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn files_readable_by_others_are_ignored() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let keeper = keeper(folder.path());
        keeper.save(&saved_address()).unwrap();
        fn mode(path: &Path) -> u32 {
            std::fs::metadata(path).unwrap().permissions().mode() & 0o777
        }
        fn set(path: &Path, mode: u32) {
            std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
        }
        assert_eq!((mode(&keeper.path()), mode(&keeper.folder)), (0o600, 0o700));
        for open in [0o640, 0o604, 0o620] {
            set(&keeper.path(), open);
            assert_eq!(keeper.load(), None, "{open:o}");
        }
        // Saving replaces the readable file by a private one.
        keeper.save(&saved_address()).unwrap();
        assert_eq!((mode(&keeper.path()), keeper.load()), (0o600, Some(saved_address())));
        // A symbolic link is not followed: it is not read, and its target is not changed.
        let elsewhere = folder.path().join("elsewhere");
        std::fs::rename(keeper.path(), &elsewhere).unwrap();
        symlink(&elsewhere, keeper.path()).unwrap();
        assert_eq!(keeper.load(), None);
        keeper.save(&SavedAddress { port: 7, ..saved_address() }).unwrap();
        assert!(std::fs::read_to_string(&elsewhere).unwrap().starts_with("41953 "));
        // Saving into a folder that other users can write to is an error.
        set(&keeper.folder, 0o777);
        assert!(keeper.save(&saved_address()).is_err());
    }

    #[test]
    fn redirect_files_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let keeper = keeper(folder.path());
        let redirect = keeper.redirect(8, "http://127.0.0.1:8/#00").unwrap();
        let path = redirect.path().to_owned();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains("content=\"0; url=http://127.0.0.1:8/#00\""), "{text}");
        drop(redirect);
        assert!(!path.exists());
        std::fs::write(&path, "left").unwrap();
        let two_hours_ago = SystemTime::now() - 2 * REDIRECT_LIFETIME;
        let file = std::fs::File::options().append(true).open(&path).unwrap();
        file.set_modified(two_hours_ago).unwrap();
        keeper.save(&saved_address()).unwrap();
        let _other = keeper.redirect(9, "http://127.0.0.1:9/#00").unwrap();
        assert!(!path.exists());
        assert_eq!(keeper.load(), Some(saved_address()));
    }
}
