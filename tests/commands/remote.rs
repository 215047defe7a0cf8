//! A server of results that machines share: whatever it does, results are right, and a bad one costs a warning and a moment.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use maquette::random::Random;
use serde_json::Value as Json;

use crate::project::Project;

/// What a server does with a request.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Mode {
    Honest,
    /// Gives what is of another name.
    Lying,
    /// Flips a bit in the middle of what it gives.
    Flipping,
    /// Ends in the middle.
    Torn,
    /// Never ends.
    Endless,
    /// Says nothing for long.
    Stalling,
    /// Stops in the middle for long.
    StallingInside,
    Failing,
    /// Takes nothing.
    ReadOnly,
    /// Has no room.
    Full,
    Closing,
    /// Sends us elsewhere.
    Elsewhere,
}

const BAD: [Mode; 11] = [
    Mode::Lying,
    Mode::Flipping,
    Mode::Torn,
    Mode::Endless,
    Mode::Stalling,
    Mode::StallingInside,
    Mode::Failing,
    Mode::ReadOnly,
    Mode::Full,
    Mode::Closing,
    Mode::Elsewhere,
];

/// How long a server that stalls does. Nobody waits for that.
const LONG: Duration = Duration::from_secs(60);

type Files = Arc<Mutex<BTreeMap<String, Vec<u8>>>>;
type Chooses = Arc<Mutex<Box<dyn FnMut() -> Mode + Send>>>;

struct Server {
    url: String,
    files: Files,
    mode: Chooses,
    asked: Arc<Mutex<Vec<String>>>,
}

impl Server {
    fn new() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}/cache", listener.local_addr().unwrap());
        let files = Files::default();
        let mode: Chooses = Arc::new(Mutex::new(Box::new(|| Mode::Honest)));
        let asked = Arc::<Mutex<Vec<String>>>::default();
        let server = Self { url, files: files.clone(), mode: mode.clone(), asked: asked.clone() };
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let (files, mode, asked) = (files.clone(), mode.clone(), asked.clone());
                std::thread::spawn(move || answer(stream, &files, &mode, &asked));
            }
        });
        server
    }

    fn becomes(&self, mode: Mode) {
        self.chooses(move || mode);
    }

    fn chooses(&self, choose: impl FnMut() -> Mode + Send + 'static) {
        *self.mode.lock().unwrap() = Box::new(choose);
    }

    fn asked(&self) -> Vec<String> {
        std::mem::take(&mut self.asked.lock().unwrap())
    }
}

/// Answers one request; nothing is said of a client that has gone.
fn answer(
    stream: TcpStream,
    files: &Files,
    mode: &Chooses,
    asked: &Mutex<Vec<String>>,
) -> Option<()> {
    let mut reader = BufReader::new(stream.try_clone().ok()?);
    let mut line = String::new();
    reader.read_line(&mut line).ok()?;
    let mut words = line.split_whitespace();
    let (method, path) = (words.next()?.to_owned(), words.next()?.to_owned());
    let mut length = 0;
    loop {
        let mut line = String::new();
        reader.read_line(&mut line).ok()?;
        let Some((name, value)) = line.split_once(':') else { break };
        if name.eq_ignore_ascii_case("content-length") {
            length = value.trim().parse().ok()?;
        }
    }
    let mut body = vec![0; length];
    reader.read_exact(&mut body).ok()?;
    asked.lock().unwrap().push(format!("{method} {path}"));
    let mode = (mode.lock().unwrap())();
    let mut stream = stream;
    let mut tell = |status: &str, length: Option<usize>, body: &[u8]| {
        let length = length.map_or(String::new(), |length| format!("Content-Length: {length}\r\n"));
        let head = format!("HTTP/1.1 {status}\r\n{length}Connection: close\r\n\r\n");
        stream.write_all(head.as_bytes()).ok()?;
        stream.write_all(body).ok()
    };
    match (mode, &method[..]) {
        (Mode::Closing, _) => return None,
        (Mode::Failing, _) => return tell("500 No", Some(0), b""),
        (Mode::Elsewhere, _) => {
            return tell("302 Found\r\nLocation: http://127.0.0.1:9/", Some(0), b"");
        }
        (Mode::Stalling, _) => {
            std::thread::sleep(LONG);
            return None;
        }
        (Mode::ReadOnly, "PUT") => return tell("405 No", Some(0), b""),
        (Mode::Full, "PUT") => return tell("507 Full", Some(0), b""),
        (_, "PUT") => {
            files.lock().unwrap().insert(path, body);
            return tell("201 Created", Some(0), b"");
        }
        _ => {}
    }
    let known = files.lock().unwrap().clone();
    let Some(found) = known.get(&path) else { return tell("404 Nothing", Some(0), b"") };
    let whole = found.len();
    match mode {
        _ if method == "HEAD" => tell("200 OK", Some(whole), b""),
        Mode::Lying => {
            let other =
                known.iter().find(|(name, _)| **name != path).map_or(found, |(_, other)| other);
            tell("200 OK", Some(other.len()), other)
        }
        Mode::Flipping => {
            let mut bytes = found.clone();
            bytes[whole / 2] ^= 4;
            tell("200 OK", Some(whole), &bytes)
        }
        Mode::Torn => tell("200 OK", Some(whole), &found[..whole / 2]),
        Mode::StallingInside => {
            tell("200 OK", Some(whole), &found[..whole / 2])?;
            std::thread::sleep(LONG);
            None
        }
        // More than anybody takes.
        Mode::Endless => tell("200 OK", None, &vec![7; 200 << 20]),
        _ => tell("200 OK", Some(whole), found),
    }
}

/// A run of the doll on a machine that knows nothing: its outputs, what it says as JSON, and its warnings.
fn run(server: &Server) -> (BTreeMap<String, Vec<u8>>, Json, String) {
    let project = Project::doll();
    let words = ["run", "doll.ron", "--out", "out", "--json", "--cache-remote", &server.url];
    let output = project.maquette(&words);
    let err = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{err}");
    (project.outputs(), serde_json::from_slice(&output.stdout).unwrap(), err)
}

fn computed(document: &Json) -> usize {
    document["nodes"].as_array().unwrap().iter().filter(|node| node["state"] == "computed").count()
}

#[test]
fn the_second_machine_computes_nothing_and_notes_of_paths_stay_at_home() {
    let server = Server::new();
    let (first, document, warnings) = run(&server);
    assert_eq!((computed(&document), &warnings[..]), (15, ""));
    assert!(server.asked().iter().any(|asked| asked.starts_with("PUT")));
    let (second, document, warnings) = run(&server);
    assert_eq!((computed(&document), &warnings[..]), (0, ""));
    assert!(first == second);
    let asked = server.asked();
    assert!(!asked.iter().any(|asked| asked.starts_with("PUT")), "{asked:?}");
    // One folder for a build, and no name of a graph or a folder.
    let homes = server
        .files
        .lock()
        .unwrap()
        .keys()
        .map(|path| path.split('/').nth(2).unwrap().to_owned())
        .collect::<Vec<_>>();
    assert!(homes.iter().all(|home| home.len() == 32 && *home == homes[0]));
    let kinds = server
        .files
        .lock()
        .unwrap()
        .keys()
        .map(|path| path.split('/').nth(3).unwrap().to_owned())
        .collect::<std::collections::BTreeSet<_>>();
    assert_eq!(Vec::from_iter(kinds), ["columns", "entries"]);
}

#[test]
fn a_bad_server_costs_a_warning_and_a_moment() {
    let server = Server::new();
    let (right, _, _) = run(&server);
    let files = server.files.lock().unwrap().clone();
    for mode in BAD {
        *server.files.lock().unwrap() = files.clone();
        // Some results are not known, so that something is sent, too.
        server.files.lock().unwrap().retain(|name, _| !name.ends_with(['0', '1', '2', '3']));
        server.becomes(mode);
        let start = Instant::now();
        let (outputs, document, warnings) = run(&server);
        assert!(outputs == right, "{mode:?}");
        assert!(start.elapsed() < LONG / 2, "{mode:?}");
        assert_eq!(warnings.matches("warning: ").count(), 1, "{mode:?}: {warnings}");
        let reads = matches!(mode, Mode::ReadOnly | Mode::Full);
        assert_eq!(reads, computed(&document) < 15, "{mode:?}: {warnings}");
        // What it gave is not believed later either.
        server.becomes(Mode::Honest);
        assert!(run(&server).0 == right, "{mode:?}");
    }
}

#[test]
fn a_server_that_is_not_there_is_told_of_once_and_a_url_that_is_none_at_once() {
    let project = Project::doll();
    let words = ["run", "doll.ron", "--out", "out", "--cache-remote", "http://127.0.0.1:9"];
    let output = project.maquette(&words);
    let err = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{err}");
    assert_eq!(
        err.matches("warning: the server of results http://127.0.0.1:9 is left alone: ").count(),
        1,
        "{err}"
    );
    let mut wrong = project.command(&["run", "doll.ron"]);
    let wrong = wrong.env("MAQUETTE_CACHE_REMOTE", "https://me:secret@host").output().unwrap();
    let err = String::from_utf8(wrong.stderr).unwrap();
    assert_eq!(wrong.status.code(), Some(2));
    assert_eq!(err, "error: `host` is no server of results: write http://HOST[:PORT][/PREFIX]\n");
}

#[test]
fn no_order_of_faults_changes_a_result() {
    let server = Server::new();
    let (right, _, _) = run(&server);
    for seed in 0..12 {
        let mut random = Random(seed);
        // Most answers are honest, so that it is not left alone at once.
        server.chooses(move || match random.below(6) {
            0 => BAD[random.below(BAD.len())],
            _ => Mode::Honest,
        });
        for _ in 0..2 {
            let (outputs, _, warnings) = run(&server);
            assert!(outputs == right, "seed {seed}");
            assert!(warnings.matches("warning: ").count() < 2, "seed {seed}: {warnings}");
        }
    }
}
