//! What stays of a page from one watch of a graph to the next: its port and its token, so that a page which is open finds the watch
//! again, and a link that was opened once opens the page for ever.
//!
//! They are kept in a folder of the user's own for state, not with results, which anybody may throw away and others may share. Where
//! they cannot be kept the link is another one the next time, and nothing else.

use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use maquette_engine::writing;
use maquette_value::plain;

/// Port and token of a page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Kept {
    pub(super) port: u16,
    /// 32 hexadecimal digits.
    pub(super) token: String,
}

/// Where they are kept.
#[derive(Clone, Debug)]
pub struct Keeper {
    folder: PathBuf,
    /// Made of the path of the graph.
    name: String,
}

/// A file that leads a browser to a page. It is removed when this goes.
pub struct Redirect(PathBuf);

/// Browsers have read a file that leads them to a page after this time, also one whose watch was killed.
const LONG_READ: Duration = Duration::from_secs(3600);

impl Kept {
    /// `41953 0123..`.
    fn read(text: &str) -> Option<Self> {
        let (port, token) = text.strip_suffix('\n')?.split_once(' ')?;
        let is_token = token.len() == 32
            && token.bytes().all(|byte: u8| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte));
        let port = port.parse().ok().filter(|port| *port > 0)?;
        is_token.then(|| Self { port, token: token.to_owned() })
    }
}

impl Keeper {
    /// None where the system has no folder for a user's state.
    pub(super) fn of(graph: &Path) -> Option<Self> {
        fn absolute(graph: &Path) -> PathBuf {
            std::path::absolute(graph).unwrap_or_else(|_| graph.to_owned())
        }
        let path = std::fs::canonicalize(graph).unwrap_or_else(|_| absolute(graph));
        let hash = blake3::hash(path.as_os_str().as_encoded_bytes()).to_hex();
        Some(Self { folder: folder()?, name: hash[..32].to_owned() })
    }

    /// What was kept; nothing if others could have read or written it.
    pub(super) fn load(&self) -> Option<Kept> {
        let path = self.path();
        let metadata = std::fs::symlink_metadata(&path).ok()?;
        let is_secret = metadata.is_file() && writing::is_private(&metadata, 0o077);
        Kept::read(&is_secret.then(|| plain::read_own_text(&path).ok()).flatten()?)
    }

    pub(super) fn save(&self, Kept { port, token }: &Kept) -> io::Result<()> {
        writing::write_private(&self.path(), format!("{port} {token}\n").as_bytes())
    }

    fn path(&self) -> PathBuf {
        self.folder.join(&self.name)
    }

    /// Writes a file that leads to the link of a page: what starts a browser is given this file, because everybody on a machine may
    /// read what programs are started with.
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

    /// Removes what watches that were killed have left.
    fn sweep(&self) {
        for entry in std::fs::read_dir(&self.folder).into_iter().flatten().flatten() {
            let path = entry.path();
            let is_redirect = path.extension().is_some_and(|ending| ending == "html");
            let modified = entry.metadata().and_then(|metadata| metadata.modified()).ok();
            let age = modified.and_then(|time| SystemTime::now().duration_since(time).ok());
            if is_redirect && age.is_some_and(|age| age > LONG_READ) {
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

/// The folder for what is kept of pages.
fn folder() -> Option<PathBuf> {
    let named =
        |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let system = if cfg!(windows) {
        named("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        named("HOME").map(|home| home.join("Library/Application Support"))
    } else {
        named("HOME").map(|home| home.join(".local/state"))
    };
    // As the specification of these folders says, one that is not absolute is none.
    let common = named("XDG_STATE_HOME").filter(|folder| folder.is_absolute());
    common.or(system).map(|folder| folder.join("maquette").join("pages"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keeper(folder: &Path) -> Keeper {
        Keeper { folder: folder.join("deep/pages"), name: "graph".into() }
    }

    fn kept() -> Kept {
        Kept { port: 41953, token: "0123456789abcdef".repeat(2) }
    }

    #[test]
    fn what_is_kept_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        let keeper = keeper(folder.path());
        assert_eq!(keeper.load(), None);
        keeper.save(&kept()).unwrap();
        assert_eq!(keeper.load(), Some(kept()));
        let other = Kept { port: 1, ..kept() };
        keeper.save(&other).unwrap();
        assert_eq!(keeper.load(), Some(other));
    }

    #[test]
    fn a_broken_file_is_none() {
        let token = kept().token;
        assert!(Kept::read(&format!("8 {token}\n")).is_some());
        for text in [
            String::new(),
            format!("0 {token}\n"),
            format!("65536 {token}\n"),
            format!("8 {token}"),
            format!("8 {}\n", &token[1..]),
            format!("8 {}\n", token.to_uppercase()),
            format!("8\n{token}\n"),
        ] {
            assert_eq!(Kept::read(&text), None, "{text:?}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn what_others_may_read_is_no_secret() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let keeper = keeper(folder.path());
        keeper.save(&kept()).unwrap();
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
        // What replaces it is a secret again.
        keeper.save(&kept()).unwrap();
        assert_eq!((mode(&keeper.path()), keeper.load()), (0o600, Some(kept())));
        // Nor is what a link leads to, which stays as it is.
        let elsewhere = folder.path().join("elsewhere");
        std::fs::rename(keeper.path(), &elsewhere).unwrap();
        symlink(&elsewhere, keeper.path()).unwrap();
        assert_eq!(keeper.load(), None);
        keeper.save(&Kept { port: 7, ..kept() }).unwrap();
        assert!(std::fs::read_to_string(&elsewhere).unwrap().starts_with("41953 "));
        // Where others may write nothing is kept.
        set(&keeper.folder, 0o777);
        assert!(keeper.save(&kept()).is_err());
    }

    #[test]
    fn what_leads_a_browser_goes_with_the_watch_and_old_ones_with_the_next() {
        let folder = tempfile::tempdir().unwrap();
        let keeper = keeper(folder.path());
        let redirect = keeper.redirect(8, "http://127.0.0.1:8/#00").unwrap();
        let path = redirect.path().to_owned();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains("content=\"0; url=http://127.0.0.1:8/#00\""), "{text}");
        drop(redirect);
        assert!(!path.exists());
        std::fs::write(&path, "left").unwrap();
        let two_hours_ago = SystemTime::now() - 2 * LONG_READ;
        let file = std::fs::File::options().append(true).open(&path).unwrap();
        file.set_modified(two_hours_ago).unwrap();
        keeper.save(&kept()).unwrap();
        let _other = keeper.redirect(9, "http://127.0.0.1:9/#00").unwrap();
        assert!(!path.exists());
        assert_eq!(keeper.load(), Some(kept()));
    }
}
