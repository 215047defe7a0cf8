//! Results on a server that several machines share: plain HTTP, GET and PUT by name. What it gives is believed as little as what lies on disk:
//! it is written there, and read from there with its checksum.
//!
//! A server may be slow, full, lost or lying. It is left alone for the rest of the process, with one warning, when it has failed, has given
//! something wrong, or has cost more time than it saved.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ureq::Agent;
use ureq::http::{Response, StatusCode};

/// How long a server may take to answer at all.
const PATIENCE: Duration = Duration::from_millis(500);

/// How many bytes a second must come and go at the least.
const SLOWEST: u64 = 2_000_000;

/// How many seconds a server may cost beyond what it saves.
const MOST_LOST: f64 = 1.0;

/// Larger entries are none: large columns are files of their own.
const MOST_ENTRY: u64 = 64 << 20;

/// How many files may wait to be sent: what comes then is not sent.
const MOST_WAITING: usize = 4096;

/// How long the end of a process waits for what is still to be sent, while the server takes it well.
const LAST_WAIT: Duration = Duration::from_secs(30);

/// A server of results, for one program.
pub(super) struct Remote {
    server: Arc<Server>,
    waiting: Arc<AtomicUsize>,
    sender: Mutex<Option<(Sender<Upload>, JoinHandle<()>)>>,
}

enum Upload {
    File(PathBuf),
    /// Everything before is sent: say so.
    Done(Sender<()>),
}

struct Server {
    agent: Agent,
    /// `http://host/prefix/FINGERPRINT`.
    home: String,
    authorization: Option<String>,
    state: Mutex<State>,
}

/// What is known of a server.
#[derive(Default)]
struct State {
    /// Seconds that were waited for it, less those that its results took elsewhere.
    lost: f64,
    /// Why nothing is asked of it any more.
    off: Option<String>,
    /// Why nothing is sent to it any more.
    no_uploads: Option<String>,
}

/// Why a server cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("`{url}` is no server of results: {why}")]
pub struct RemoteError {
    url: String,
    why: &'static str,
}

impl Remote {
    /// The server at `http://[user:password@]host[:port][/prefix]`. Nothing is asked of it yet.
    pub(super) fn new(url: &str, token: Option<&str>, program: &str) -> Result<Self, RemoteError> {
        let wrong = |why| {
            // A password is not shown.
            let url = url.rsplit('@').next().unwrap_or_default().to_owned();
            RemoteError { url, why }
        };
        let rest = url
            .strip_prefix("http://")
            .ok_or_else(|| wrong("write http://HOST[:PORT][/PREFIX]"))?;
        let (host, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        let (user, host) =
            host.rsplit_once('@').map_or((None, host), |(user, host)| (Some(user), host));
        if host.is_empty() || prefix.contains(['?', '#', ' ']) {
            return Err(wrong("write http://HOST[:PORT][/PREFIX]"));
        }
        let prefix = prefix.trim_matches('/');
        let gap = if prefix.is_empty() { "" } else { "/" };
        let home = format!("http://{host}{gap}{prefix}/{program}");
        let basic = user.map(|user| format!("Basic {}", crate::telling::base64(user.as_bytes())));
        let authorization = token.map(|token| format!("Bearer {token}")).or(basic);
        let agent = Agent::config_builder()
            .timeout_connect(Some(PATIENCE))
            .timeout_recv_response(Some(PATIENCE))
            .max_redirects(0)
            .http_status_as_error(false)
            .proxy(None)
            .build()
            .into();
        let server = Server { agent, home, authorization, state: Mutex::default() };
        Ok(Self { server: server.into(), waiting: Arc::default(), sender: Mutex::default() })
    }

    /// A sealed entry by its name.
    pub(super) fn entry(&self, name: &str) -> Option<Vec<u8>> {
        self.server.get("entries", name, MOST_ENTRY)
    }

    /// A column of this length, which the one who asks compares with its hash.
    pub(super) fn column(&self, name: &str, length: usize) -> Option<Vec<u8>> {
        let bytes = self.server.get("columns", name, length as u64)?;
        if bytes.len() != length {
            self.lied();
            return None;
        }
        Some(bytes)
    }

    /// What came was not what was asked for.
    pub(super) fn lied(&self) {
        self.server.leave("it gave something else than what was asked for");
    }

    /// A result that came from the server took so many seconds elsewhere.
    pub(super) fn saved(&self, seconds: f64) {
        self.server.lock().lost -= seconds;
    }

    /// Sends a file of the cache, some time.
    pub(super) fn send(&self, path: &Path) {
        let no = self.server.lock();
        if no.off.is_some()
            || no.no_uploads.is_some()
            || MOST_WAITING < self.waiting.load(Ordering::Relaxed)
        {
            return;
        }
        drop(no);
        self.waiting.fetch_add(1, Ordering::Relaxed);
        // The thread ends only after the senders.
        let _ = self.uploads().send(Upload::File(path.to_owned()));
    }

    fn uploads(&self) -> Sender<Upload> {
        let mut sender = self.sender.lock().unwrap_or_else(PoisonError::into_inner);
        let (sender, _) = sender.get_or_insert_with(|| {
            let (sender, receiver) = channel();
            let (server, waiting) = (self.server.clone(), self.waiting.clone());
            (sender, std::thread::spawn(move || upload(&server, &receiver, &waiting)))
        });
        sender.clone()
    }

    /// Waits until everything is sent, as long as the server takes it well.
    pub(super) fn finish(&self) {
        if self.sender.lock().unwrap_or_else(PoisonError::into_inner).is_none() {
            return;
        }
        let (sender, receiver) = channel();
        let _ = self.uploads().send(Upload::Done(sender));
        if receiver.recv_timeout(LAST_WAIT).is_err() {
            self.server
                .lock()
                .no_uploads
                .get_or_insert_with(|| "it takes results too slowly".into());
        }
    }

    /// Why the server is not used as it should be.
    pub(super) fn trouble(&self) -> Option<String> {
        let state = self.server.lock();
        let host = self.server.home.rsplit_once('/').map_or("", |(host, _)| host);
        match (&state.off, &state.no_uploads) {
            (Some(why), _) => Some(format!("the server of results {host} is left alone: {why}")),
            (None, Some(why)) => {
                Some(format!("nothing more is sent to the server of results {host}: {why}"))
            }
            (None, None) => None,
        }
    }
}

/// Sends files one after the other.
fn upload(server: &Server, files: &Receiver<Upload>, waiting: &AtomicUsize) {
    for file in files {
        match file {
            Upload::File(path) => {
                server.put(&path);
                waiting.fetch_sub(1, Ordering::Relaxed);
            }
            Upload::Done(sender) => drop(sender.send(())),
        }
    }
}

impl Server {
    fn lock(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Asks nothing of the server any more.
    fn leave(&self, why: &str) {
        self.lock().off.get_or_insert_with(|| why.to_owned());
    }

    fn url(&self, what: &str, name: &str) -> String {
        format!("{}/{what}/{name}", self.home)
    }

    fn get(&self, what: &str, name: &str, most: u64) -> Option<Vec<u8>> {
        if self.lock().off.is_some() {
            return None;
        }
        let start = Instant::now();
        let found = self.got(what, name, most);
        let mut state = self.lock();
        state.lost += start.elapsed().as_secs_f64();
        match found {
            Ok(found) => {
                if MOST_LOST < state.lost {
                    state.off.get_or_insert_with(|| "it costs more time than it saves".into());
                }
                found
            }
            Err(why) => {
                state.off.get_or_insert(why);
                None
            }
        }
    }

    /// What the server has under a name, if it has that; in words, what is wrong with it.
    fn got(&self, what: &str, name: &str, most: u64) -> Result<Option<Vec<u8>>, String> {
        let body = PATIENCE + Duration::from_secs_f64(most.min(MOST_ENTRY) as f64 / SLOWEST as f64);
        let body = if what == "entries" { PATIENCE } else { body };
        let mut request = self.agent.get(self.url(what, name));
        if let Some(authorization) = &self.authorization {
            request = request.header("Authorization", authorization);
        }
        let answer = request.config().timeout_recv_body(Some(body)).build().call();
        let mut answer = answer.map_err(|error| error.to_string())?;
        match answer.status() {
            StatusCode::OK => {}
            StatusCode::NOT_FOUND | StatusCode::GONE | StatusCode::NO_CONTENT => return Ok(None),
            status => return Err(refused(status)),
        }
        // One byte more tells that it is too long.
        let body = answer.body_mut().with_config().limit(most + 1).read_to_vec();
        body.map(Some).map_err(|error| error.to_string())
    }

    /// Sends a file, unless the server has it.
    fn put(&self, path: &Path) {
        {
            let state = self.lock();
            if state.off.is_some() || state.no_uploads.is_some() {
                return;
            }
        }
        let names = [path.parent().and_then(Path::file_name), path.file_name()];
        let [Some(what), Some(name)] = names.map(|name| name.and_then(std::ffi::OsStr::to_str))
        else {
            return;
        };
        // It may have been dropped meanwhile.
        let Ok(bytes) = fs::read(path) else { return };
        let sent = self.sent(what, name, &bytes);
        if let Err(why) = sent {
            self.lock().no_uploads.get_or_insert(why);
        }
    }

    fn sent(&self, what: &str, name: &str, bytes: &[u8]) -> Result<(), String> {
        let time = PATIENCE + Duration::from_secs_f64(bytes.len() as f64 / SLOWEST as f64);
        let told = |answer: Result<Response<ureq::Body>, ureq::Error>| {
            answer.map_err(|error| error.to_string())
        };
        // Columns are those of many results.
        if what == "columns" {
            let mut request = self.agent.head(self.url(what, name));
            if let Some(authorization) = &self.authorization {
                request = request.header("Authorization", authorization);
            }
            if told(request.call())?.status() == StatusCode::OK {
                return Ok(());
            }
        }
        let mut request = self.agent.put(self.url(what, name));
        if let Some(authorization) = &self.authorization {
            request = request.header("Authorization", authorization);
        }
        let config =
            request.config().timeout_send_body(Some(time)).timeout_recv_response(Some(time));
        let status = told(config.build().send(bytes))?.status();
        if status.is_success() { Ok(()) } else { Err(refused(status)) }
    }
}

fn refused(status: StatusCode) -> String {
    match status.as_u16() {
        401 | 403 => format!("it does not let us ({status})"),
        405 | 507 => format!("it takes nothing ({status})"),
        300..=399 => format!("it sends us elsewhere ({status})"),
        _ => format!("it answers {status}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_url_names_a_server_and_its_password_is_not_shown() {
        let home =
            |url: &str| Remote::new(url, None, "0123").map(|remote| remote.server.home.clone());
        assert_eq!(home("http://host").unwrap(), "http://host/0123");
        assert_eq!(home("http://me:secret@host:81/a/b/").unwrap(), "http://host:81/a/b/0123");
        let remote = Remote::new("http://me:secret@host", None, "0123").unwrap();
        assert_eq!(remote.server.authorization.as_deref(), Some("Basic bWU6c2VjcmV0"));
        let remote = Remote::new("http://host", Some("token"), "0123").unwrap();
        assert_eq!(remote.server.authorization.as_deref(), Some("Bearer token"));
        for wrong in
            ["https://me:secret@host", "host", "http://", "http://host/a?b", "ftp://me:secret@host"]
        {
            let told = home(wrong).unwrap_err().to_string();
            assert!(told.contains("write http://") && !told.contains("secret"), "{told}");
        }
    }
}
