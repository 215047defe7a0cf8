//! A small HTTP server that stores files by name and can misbehave in several ways. It has one thread and answers one request for each
//! connection.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// The way in which a server answers requests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Mode {
    Honest,
    /// Returns the content of another file.
    Lies,
    /// Changes a byte of each file that it returns.
    Flips,
    /// Closes the connection in the middle of a file.
    Truncates,
    /// Returns half of a file with a matching `Content-Length`.
    Shortens,
    Endless,
    StallsBefore,
    StallsInside,
    /// Sends one byte every 50 ms.
    Trickles,
    Fails,
    ReadOnly,
    Full,
    Redirects,
    Closes,
    /// Sends text that is not HTTP.
    Babbles,
    /// Chooses a mode at random for each request. The number is the state of the generator.
    Any(u64),
}

impl Mode {
    pub(super) const ALL: [Self; 15] = [
        Self::Honest,
        Self::Lies,
        Self::Flips,
        Self::Truncates,
        Self::Shortens,
        Self::Endless,
        Self::StallsBefore,
        Self::StallsInside,
        Self::Trickles,
        Self::Fails,
        Self::ReadOnly,
        Self::Full,
        Self::Redirects,
        Self::Closes,
        Self::Babbles,
    ];

    /// Returns true if the first request already shows that the server is useless.
    pub(super) fn is_failure(self) -> bool {
        use Mode::{Babbles, Closes, Fails, StallsBefore, StallsInside};
        [StallsBefore, StallsInside, Fails, Closes, Babbles].contains(&self)
    }
}

#[derive(Default)]
struct State {
    mode: Option<Mode>,
    files: BTreeMap<String, Vec<u8>>,
    /// The methods of all requests since the mode was set.
    asked: Vec<String>,
    authorizations: Vec<String>,
    /// Connections that are kept open without an answer.
    held: Vec<TcpStream>,
}

/// The path of the stored files in URLs.
const ROOT: &str = "/results/";

/// The server runs until the test process ends.
pub(super) struct Server {
    port: u16,
    state: Arc<Mutex<State>>,
}

impl Server {
    pub(super) fn new() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let (port, state) = (listener.local_addr().unwrap().port(), Arc::<Mutex<State>>::default());
        let answering = state.clone();
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                // The client may close the connection at any time.
                let _ = answer(stream, &answering);
            }
        });
        Self { port, state }
    }

    pub(super) fn address(&self) -> String {
        format!("http://127.0.0.1:{}{}", self.port, ROOT.trim_end_matches('/'))
    }

    /// Sets the mode for future requests and forgets the past ones.
    pub(super) fn set(&self, mode: Mode) {
        let mut state = self.state.lock().unwrap();
        state.mode = Some(mode);
        state.asked.clear();
    }

    /// Returns the number of requests with this method.
    pub(super) fn count_requests(&self, method: &str) -> usize {
        let state = self.state.lock().unwrap();
        state.asked.iter().filter(|asked| asked.contains(method)).count()
    }

    pub(super) fn authorizations(&self) -> Vec<String> {
        self.state.lock().unwrap().authorizations.clone()
    }

    /// Returns the names of the stored files.
    pub(super) fn names(&self) -> Vec<String> {
        let state = self.state.lock().unwrap();
        state.files.keys().map(|path| path.trim_start_matches(ROOT).to_owned()).collect()
    }

    /// Stores these files under their names.
    pub(super) fn fill(&self, files: &BTreeMap<String, Vec<u8>>) {
        let files = files.iter().map(|(name, bytes)| (format!("{ROOT}{name}"), bytes.clone()));
        self.state.lock().unwrap().files.extend(files);
    }

    /// Changes a byte of each stored file.
    pub(super) fn flip_all(&self) {
        let mut state = self.state.lock().unwrap();
        state.files.values_mut().for_each(|file| flip(file));
    }
}

fn flip(file: &mut [u8]) {
    let middle = file.len() / 2;
    file.get_mut(middle).into_iter().for_each(|byte| *byte ^= 16);
}

fn answer(mut stream: TcpStream, state: &Mutex<State>) -> std::io::Result<()> {
    stream.set_read_timeout(Some(Duration::from_secs(5)))?;
    let mut reader = BufReader::new(stream.try_clone()?);
    let mut lines = Vec::new();
    loop {
        let mut line = String::new();
        if reader.read_line(&mut line)? == 0 || line.trim().is_empty() {
            break;
        }
        lines.push(line.trim().to_owned());
    }
    let Some((method, rest)) = lines.first().and_then(|line| line.split_once(' ')) else {
        return Ok(());
    };
    let path = rest.split(' ').next().unwrap_or_default().to_owned();
    fn header(name: &str, lines: &[String]) -> Option<String> {
        lines
            .iter()
            .find(|line| line.to_lowercase().starts_with(&format!("{name}:")))
            .map(|line| line[name.len() + 1..].trim().to_owned())
    }
    let mut state = state.lock().unwrap();
    state.asked.push(method.to_owned());
    if let Some(told) =
        header("authorization", &lines).filter(|told| !state.authorizations.contains(told))
    {
        state.authorizations.push(told);
    }
    let mode = match state.mode.unwrap_or(Mode::Honest) {
        Mode::Any(seed) => {
            // Half of the requests are answered correctly, so that the server gets files with which it can misbehave.
            let next = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            state.mode = Some(Mode::Any(next ^ next >> 33));
            let pick = (next >> 40) as usize;
            Mode::ALL.get(pick % (2 * Mode::ALL.len())).copied().unwrap_or(Mode::Honest)
        }
        mode => mode,
    };
    match mode {
        Mode::StallsBefore => {
            state.held.push(stream);
            return Ok(());
        }
        Mode::Closes => return Ok(()),
        Mode::Babbles => return stream.write_all(b"220 mail.example ready\r\n"),
        Mode::Fails => return say(&mut stream, "500 Internal Server Error", b""),
        Mode::Redirects => {
            return stream.write_all(
                b"HTTP/1.1 302 Found\r\nLocation: http://127.0.0.1:9/\r\nContent-Length: 0\r\n\
                  Connection: close\r\n\r\n",
            );
        }
        _ => {}
    }
    if method == "PUT" {
        let mut file =
            vec![0; header("content-length", &lines).and_then(|it| it.parse().ok()).unwrap_or(0)];
        reader.read_exact(&mut file)?;
        return match mode {
            Mode::ReadOnly => say(&mut stream, "403 Forbidden", b""),
            Mode::Full => say(&mut stream, "507 Insufficient Storage", b""),
            _ => {
                state.files.insert(path, file);
                say(&mut stream, "201 Created", b"")
            }
        };
    }
    let name = state.files.keys().find(|name| (mode == Mode::Lies) != (**name == path)).cloned();
    let Some(mut file) = name.and_then(|name| state.files.get(&name).cloned()) else {
        return say(&mut stream, "404 Not Found", b"");
    };
    if method == "HEAD" {
        return stream.write_all(head("200 OK", file.len()).as_bytes());
    }
    let half = file.len() / 2;
    match mode {
        Mode::Flips => flip(&mut file),
        Mode::Shortens => file.truncate(half),
        Mode::Truncates | Mode::StallsInside => {
            stream.write_all(head("200 OK", file.len()).as_bytes())?;
            stream.write_all(&file[..half])?;
            if mode == Mode::StallsInside {
                state.held.push(stream);
            }
            return Ok(());
        }
        Mode::Trickles => {
            stream.write_all(head("200 OK", file.len()).as_bytes())?;
            return file.iter().try_for_each(|byte| {
                std::thread::sleep(Duration::from_millis(50));
                stream.write_all(&[*byte])
            });
        }
        Mode::Endless => {
            stream.write_all(b"HTTP/1.1 200 OK\r\nConnection: close\r\n\r\n")?;
            stream.set_write_timeout(Some(Duration::from_secs(5)))?;
            loop {
                stream.write_all(&file)?;
            }
        }
        _ => {}
    }
    say(&mut stream, "200 OK", &file)
}

fn head(status: &str, length: usize) -> String {
    format!("HTTP/1.1 {status}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n")
}

fn say(stream: &mut TcpStream, status: &str, body: &[u8]) -> std::io::Result<()> {
    stream.write_all(head(status, body.len()).as_bytes())?;
    stream.write_all(body)
}
