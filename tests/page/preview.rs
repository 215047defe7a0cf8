//! The server of the live page as browsers and other programs see it: its messages, and the requests that it refuses.

use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use maquette::value::Mesh;
use maquette::{Options, Run, Session, Settings, Targets};
use nalgebra::{Matrix3, Point3, Vector3};
use serde_json::{Value as Json, json};
use tungstenite::client::IntoClientRequest;
use tungstenite::http::HeaderValue;
use tungstenite::{Message, WebSocket};

use crate::browser::Socket;
use crate::project::{Project, Watch};

#[cfg(unix)]
mod crowd;
mod drag;
pub(crate) mod link;
mod pointing;
mod undo;

pub(crate) use pointing::mesh_of;

/// Timeout for answers; only a failing test waits this long.
const PATIENCE: Duration = Duration::from_secs(60);

/// A process that watches a graph and serves its live page.
pub(crate) struct Server {
    pub(crate) watch: Watch,
    /// The server's address: 127.0.0.1 and the port.
    pub(crate) host: String,
    pub(crate) token: String,
}

impl Server {
    pub(crate) fn new(project: &Project) -> Self {
        Self::start_with(project, &["--preview"], &[])
    }

    /// Starts a watch with these arguments and environment variables.
    pub(crate) fn start_with(
        project: &Project,
        more: &[&str],
        variables: &[(&str, &OsStr)],
    ) -> Self {
        let mut watch = project.start_with(more, variables);
        let page = watch.wait(|event| event["event"] == "page");
        let link = page["link"].as_str().unwrap();
        let (host, token) = link.strip_prefix("http://").unwrap().split_once("/#").unwrap();
        Self { host: host.to_owned(), token: token.to_owned(), watch }
    }

    pub(crate) fn link(&self) -> String {
        format!("http://{}/#{}", self.host, self.token)
    }

    /// Sends a request with these headers and returns the head and the body of the answer.
    pub(crate) fn ask(&self, path: &str, headers: &[(&str, &str)]) -> (String, Vec<u8>) {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let headers = headers.iter().map(|(name, value)| format!("{name}: {value}\r\n"));
        let headers: String = headers.collect();
        write!(stream, "GET {path} HTTP/1.1\r\n{headers}Connection: close\r\n\r\n").unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let end = answer.windows(4).position(|four| four == b"\r\n\r\n").unwrap();
        (String::from_utf8(answer[..end].to_vec()).unwrap(), answer[end + 4..].to_vec())
    }

    fn status(&self, path: &str, headers: &[(&str, &str)]) -> u16 {
        let (head, _) = self.ask(path, headers);
        head.split(' ').nth(1).unwrap().parse().unwrap()
    }

    /// Opens the WebSocket of a page.
    fn page(&self) -> Page {
        let origin = format!("http://{}", self.host);
        self.socket(&self.host, &origin, &self.token).unwrap()
    }

    /// Opens a WebSocket with these headers, or returns the HTTP status of the refusal.
    fn socket(&self, host: &str, origin: &str, token: &str) -> Result<Page, u16> {
        let mut request = format!("ws://{}/socket", self.host).into_client_request().unwrap();
        fn set(name: &'static str, value: &str, request: &mut tungstenite::http::Request<()>) {
            request.headers_mut().insert(name, HeaderValue::from_str(value).unwrap());
        }
        set("Host", host, &mut request);
        set("Origin", origin, &mut request);
        set("Sec-WebSocket-Protocol", &format!("maquette, {token}"), &mut request);
        let stream = TcpStream::connect(&self.host).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        match tungstenite::client(request, Socket(stream)) {
            Ok((socket, answer)) => {
                assert_eq!(answer.headers()["sec-websocket-protocol"], "maquette");
                Ok(Page(socket))
            }
            Err(tungstenite::HandshakeError::Failure(tungstenite::Error::Http(answer))) => {
                Err(answer.status().as_u16())
            }
            Err(other) => panic!("{other}"),
        }
    }
}

struct Page(WebSocket<Socket>);

impl Page {
    fn next(&mut self) -> Json {
        loop {
            if let Message::Text(text) = self.0.read().unwrap() {
                return serde_json::from_str(&text).unwrap();
            }
        }
    }

    /// Waits for a message of this kind; messages before it are dropped.
    fn wait(&mut self, event: &str) -> Json {
        loop {
            let message = self.next();
            if message["event"] == event {
                return message;
            }
        }
    }

    fn say(&mut self, message: &Json) {
        self.0.send(Message::text(message.to_string())).unwrap();
    }

    fn drag(&mut self, name: &str, value: f64) {
        self.say(&json!({ "ask": "drag", "values": [[name, format!("{value:.1}")]] }));
    }

    fn set(&mut self, name: &str, value: f64) {
        self.say(&json!({ "ask": "set", "values": [[name, format!("{value:.1}")]] }));
    }

    /// Waits for a value with this hash. Returns true if the value was computed for a drag, and false if it belongs to the saved file.
    fn wait_live(&mut self, hash: &str) -> bool {
        loop {
            let value = self.wait("value");
            if value["hash"] == hash {
                return value["live"].as_bool().unwrap();
            }
        }
    }

    /// Sends the request `ask` about an output of a node and returns the answer.
    fn ask(&mut self, ask: &str, id: u64, node: &str, output: &str, more: &Json) -> Json {
        let mut question = json!({ "ask": ask, "id": id, "node": node, "output": output });
        question.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        self.say(&question);
        let answer = self.wait(ask);
        assert_eq!(answer["id"], id, "{answer}");
        answer
    }

    fn look_at(&mut self, node: &str, output: &str) {
        self.say(&json!({ "ask": "views", "views": [{ "node": node, "output": output }] }));
    }
}

#[test]
fn the_page_is_whole_and_may_do_nothing_but_what_it_brings() {
    let project = Project::doll();
    let served = Server::new(&project);
    let own = [("Host", &served.host[..])];
    let (head, body) = served.ask("/", &own);
    let (head, body) = (head.to_lowercase(), String::from_utf8(body).unwrap());
    assert!(head.starts_with("http/1.1 200"), "{head}");
    for header in [
        "content-security-policy: default-src 'none'",
        "cross-origin-opener-policy: same-origin",
        "cross-origin-embedder-policy: require-corp",
        "cross-origin-resource-policy: same-origin",
        "x-content-type-options: nosniff",
        "referrer-policy: no-referrer",
    ] {
        assert!(head.contains(header), "{header} is missing in\n{head}");
    }
    let named = body.split(['"', '\'']).filter(|text| text.starts_with('/') && text.len() > 1);
    let files = Vec::from_iter(named);
    assert!(files.len() >= 3, "{body}");
    for file in files {
        assert_eq!(served.status(file, &own), 200, "{file}");
    }
    let port = served.host.rsplit(':').next().unwrap();
    assert_eq!(served.status("/", &[("Host", &format!("localhost:{port}"))]), 200);
}

#[test]
fn no_other_site_is_told_anything() {
    let project = Project::doll();
    let served = Server::new(&project);
    let port = served.host.rsplit(':').next().unwrap().to_owned();
    for host in ["evil.example", &format!("evil.example:{port}"), "127.0.0.1", "127.0.0.1:1", ""] {
        assert_eq!(served.status("/", &[("Host", host)]), 403, "{host}");
        let (head, _) = served.ask("/page.js", &[("Host", host)]);
        assert!(head.starts_with("HTTP/1.1 403"), "{host}: {head}");
    }
    let own = format!("http://{}", served.host);
    fn connect_status(host: &str, origin: &str, token: &str, served: &Server) -> u16 {
        served.socket(host, origin, token).err().unwrap_or(101)
    }
    assert_eq!(connect_status(&served.host, &own, &served.token, &served), 101);
    let rebound = format!("evil.example:{port}");
    assert_eq!(connect_status(&rebound, &format!("http://{rebound}"), &served.token, &served), 403);
    for origin in ["http://evil.example", "null", "", "https://evil.example", "http://127.0.0.1:1"]
    {
        assert_eq!(connect_status(&served.host, origin, &served.token, &served), 403, "{origin}");
    }
    assert_eq!(connect_status(&served.host, &format!("{own}/"), &served.token, &served), 403);
    for token in ["none", &served.token[1..], &"0".repeat(32)] {
        assert_eq!(connect_status(&served.host, &own, token, &served), 403, "{token}");
    }
}

#[test]
fn nothing_but_the_page_is_served() {
    let project = Project::doll();
    let served = Server::new(&project);
    let own = [("Host", &served.host[..])];
    for path in [
        "/doll.ron",
        "/../doll.ron",
        "/%2e%2e/doll.ron",
        "/..%2fdoll.ron",
        "//etc/passwd",
        "/picture/..%2f..%2fdoll.ron?width=8&height=8&yaw=0&pitch=0&zoom=1&flat=true",
        "/picture/0?width=8&height=8&yaw=0&pitch=0&zoom=1&flat=true",
        "/page.js/",
        "/socket/x",
    ] {
        let status = served.status(path, &own);
        assert!((400..=404).contains(&status), "{path}: {status}");
    }
    // A request of the socket without an upgrade to WebSocket is refused, too.
    assert!((400..=426).contains(&served.status("/socket", &own)));
}

#[cfg(target_os = "linux")]
#[test]
fn this_machine_alone_is_listened_to() {
    let project = Project::doll();
    let served = Server::new(&project);
    let port: u16 = served.host.rsplit(':').next().unwrap().parse().unwrap();
    let tables = ["/proc/net/tcp", "/proc/net/tcp6"].map(std::fs::read_to_string);
    let lines = tables.iter().flatten().flat_map(|table| table.lines());
    // The fields are the local address and the state; 0A means listening.
    let listening = lines.filter_map(|line| {
        let words: Vec<_> = line.split_whitespace().collect();
        let here = words.get(1)?.strip_suffix(&format!(":{port:04X}"))?;
        (words.get(3)? == &"0A").then(|| here.to_owned())
    });
    assert_eq!(Vec::from_iter(listening), ["0100007F"]);
}

#[test]
fn a_page_is_told_what_is_true_and_then_what_happens() {
    let project = Project::doll();
    let mut served = Server::new(&project);
    served.watch.run_until_ok();
    let mut page = served.page();
    let hello = page.next();
    assert_eq!((&hello["event"], &hello["graph"]), (&json!("hello"), &json!("doll.ron")));
    let graph = page.wait("graph");
    let boxes = graph["boxes"].as_array().unwrap();
    let nose = boxes.iter().find(|block| block["name"] == "nose").unwrap();
    assert_eq!(nose["node"], "ExtractRegion");
    assert!(nose["place"].as_array().unwrap().iter().all(|x| x.as_f64().unwrap() > 0.0));
    assert_eq!(page.wait("problems")["problems"], json!([]));
    assert_eq!(page.wait("done")["ok"], true);
    project.save(&project.doll_text(20.0));
    let run = page.wait("run");
    assert_eq!(run["changed"].as_array().unwrap().len(), 1, "{run}");
    assert_eq!(page.wait("done")["run"], run["run"]);
    served.watch.end();
}

#[test]
fn values_are_looked_at_and_outlive_an_error() {
    let project = Project::doll();
    let mut served = Server::new(&project);
    served.watch.run_until_ok();
    let mut page = served.page();
    page.wait("done");
    page.look_at("raised", "net");
    let first = page.wait("value");
    assert_eq!((&first["type"], &first["picture"]), (&json!("ControlNet"), &Json::Null), "{first}");
    let hash = first["hash"].as_str().unwrap();
    let asked = format!("/picture/{hash}?width=64&height=48&yaw=30&pitch=10&zoom=1&flat=false");
    let (head, picture) = served.ask(&asked, &[("Host", &served.host)]);
    assert!(head.starts_with("HTTP/1.1 200") && picture.starts_with(b"\x89PNG"), "{head}");
    // An invalid size is refused.
    let silly = asked.replace("width=64", "width=-1");
    assert_eq!(served.status(&silly, &[("Host", &served.host)]), 400);
    let own = [("Host", &served.host[..])];
    let (_, facts) = served.ask(&format!("/facts/{hash}"), &own);
    let facts: Json = serde_json::from_slice(&facts).unwrap();
    assert!(facts.as_array().unwrap().iter().any(|fact| fact[0] == "net"), "{facts}");
    fn column(
        value: &Json,
        name: &str,
        served: &Server,
        own: &[(&str, &str); 1],
    ) -> (Vec<u8>, String) {
        let name = value["space"]["shapes"][0][name].as_str().unwrap().to_owned();
        (served.ask(&format!("/column/{name}"), own).1, name)
    }
    let (places, old_name) = column(&first, "position", &served, &own);
    assert!(places.len() > 1000 && places.len().is_multiple_of(12), "{}", places.len());
    assert_eq!(served.status("/column/0123456789abcdef0123456789abcdef", &own), 404);
    project.save(&project.doll_text(12.5));
    let second = page.wait("value");
    assert_ne!(second["hash"], first["hash"]);
    // A client that names the column which it already has gets only the changes, if they are smaller than the whole column.
    let (triangles, name) = column(&second, "triangle", &served, &own);
    assert_eq!(name, column(&first, "triangle", &served, &own).1);
    let same = format!("/column/{name}?from={name}");
    let (head, changes) = served.ask(&same, &own);
    assert!(head.contains("application/x-maquette-changes"), "{head}");
    assert!(changes.len() < 64 && changes.len() < triangles.len(), "{changes:?}");
    let (moved, name) = column(&second, "position", &served, &own);
    let (_, changes) = served.ask(&format!("/column/{name}?from={old_name}"), &own);
    assert!(name != old_name && moved.len() == places.len() && moved != places);
    assert!(changes == moved || changes.len() < moved.len());
    project.save(&project.doll_text(20.0).replace("Nurbs(", "Nurb("));
    while page.wait("problems")["problems"] == json!([]) {}
    // A page that is opened while the graph is invalid gets the error and the last valid value.
    let mut late = served.page();
    let problems = late.wait("problems");
    assert_eq!(problems["problems"][0]["severity"], "error", "{problems}");
    let value = late.wait("value");
    assert_eq!((&value["hash"], &value["run"]), (&second["hash"], &second["run"]));
    drop(late);
    project.save(&project.doll_text(12.0));
    let third = page.wait("value");
    assert_eq!(third["hash"], first["hash"]);
    assert!(third["run"].as_u64() > second["run"].as_u64());
    // No page views the value any more, so the server does not keep its picture.
    drop(page);
    let mut other = served.page();
    other.say(&json!({ "ask": "views", "views": [] }));
    project.save(&project.doll_text(13.0));
    other.wait("run");
    other.wait("done");
    assert_eq!(served.status(&asked, &[("Host", &served.host)]), 404);
    served.watch.end();
}

#[test]
fn looking_computes_what_no_output_needs_and_writes_nothing() {
    let text = "Graph(format: 1, nodes: { \"scan\": ReadCapture(color: \"doll/color.png\", range: \"doll/range.pcd\"), \
                \"red\": Threshold(image: \"scan.color\", select: Near(color: \"#c33923\", distance: 30.0)) }, \
                outputs: { \"color.png\": \"scan.color\" })";
    let project = Project::doll();
    project.save(text);
    let mut served = Server::new(&project);
    let run = served.watch.run_until_ok();
    assert_eq!(run.state("red"), "", "it was computed before anybody looked");
    let before = project.output_times();
    let mut page = served.page();
    page.look_at("red", "mask");
    let value = page.wait("value");
    assert_eq!((&value["type"], &value["space"]), (&json!("Mask"), &Json::Null));
    assert_eq!(value["picture"]["size"], json!([400, 400]), "it lies on the picture: {value}");
    assert_eq!(value["run"].as_u64(), Some(run.number()));
    assert_eq!(project.output_times(), before);
    // Requests for missing nodes and invalid messages do not end the watch.
    page.look_at("blue", "mask");
    page.say(&json!({ "ask": "something newer" }));
    page.0.send(Message::text("no JSON at all")).unwrap();
    page.look_at("scan", "color");
    assert_eq!(page.wait("value")["type"], "Image");
    served.watch.end();
}

#[test]
fn eight_pages_are_told_and_one_that_says_too_much_is_left() {
    let project = Project::doll();
    let mut served = Server::new(&project);
    served.watch.run_until_ok();
    let mut pages: Vec<_> = (0..8).map(|_| served.page()).collect();
    pages.iter_mut().for_each(|page| drop(page.wait("done")));
    let mut loud = served.page();
    let _ = loud.0.send(Message::text("x".repeat(3 << 20)));
    let end = loop {
        match loud.0.read() {
            Ok(Message::Close(_)) | Err(_) => break true,
            Ok(_) => {}
        }
    };
    assert!(end);
    project.save(&project.doll_text(21.0));
    for page in &mut pages {
        assert_eq!(page.wait("done")["ok"], true);
    }
    served.watch.end();
}

#[test]
fn a_page_that_did_not_listen_comes_to_what_is_true() {
    let project = Project::doll();
    let mut served = Server::new(&project);
    served.watch.run_until_ok();
    let mut slow = served.page();
    let mut last = 0;
    for growth in 0..12 {
        project.save(&project.doll_text(20.0 + f64::from(growth)));
        last = served.watch.run_until_ok().number();
    }
    while slow.wait("done")["run"].as_u64() != Some(last) {}
    served.watch.end();
}

#[test]
fn a_value_is_put_into_the_file_and_taken_back_byte_by_byte() {
    let project = Project::doll();
    let mut served = Server::new(&project);
    served.watch.run_until_ok();
    let mut page = served.page();
    let graph = page.wait("graph");
    assert_eq!(graph["schema"]["properties"]["growth"]["default"], 12.0, "{graph}");
    page.wait("done");
    let before = std::fs::read_to_string(project.graph()).unwrap();
    page.say(&json!({ "ask": "set", "values": [["growth", "20.5"]] }));
    assert_eq!(page.wait("graph")["schema"]["properties"]["growth"]["default"], 20.5);
    let after = std::fs::read_to_string(project.graph()).unwrap();
    assert_eq!(after, before.replace("default: 12.0", "default: 20.5"));
    assert_eq!(page.wait("done")["ok"], true);
    page.say(&json!({ "ask": "undo" }));
    assert_eq!(page.wait("done")["ok"], true);
    assert_eq!(std::fs::read_to_string(project.graph()).unwrap(), before);
    // Invalid values and unknown parameters are refused, and the file does not change.
    for (name, value) in [("growth", "100.0"), ("growth", "[1"), ("girth", "1.0")] {
        page.say(&json!({ "ask": "set", "values": [[name, value]] }));
        let refused = page.wait("refused");
        assert!(!refused["why"].as_str().unwrap().is_empty(), "{refused}");
    }
    assert_eq!(std::fs::read_to_string(project.graph()).unwrap(), before);
    // A change that was made later by another program is not undone.
    page.say(&json!({ "ask": "set", "values": [["growth", "20.5"]] }));
    page.wait("done");
    project.save(&before.replace("default: 12.0", "default: 30.0"));
    page.wait("done");
    page.say(&json!({ "ask": "undo" }));
    assert!(page.wait("refused")["why"].as_str().unwrap().contains("since"));
    assert_eq!(std::fs::read_to_string(project.graph()).unwrap(), before.replace("12.0", "30.0"));
    served.watch.end();
}

/// Returns the resident memory of a process in bytes.
#[cfg(target_os = "linux")]
fn memory(process: u32) -> usize {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    line.split_whitespace().next().unwrap().parse::<usize>().unwrap() << 10
}

#[cfg(target_os = "linux")]
#[test]
fn a_page_that_never_reads_stalls_nobody_and_fills_no_memory() {
    let project = Project::doll();
    // A long description of the graph, which is sent at each change, makes the messages to the page large. Large values would do this, too,
    // but the server keeps results (7 MB for each change), which would count as memory of the page.
    let words = "many words. ".repeat(1 << 17);
    fn save(index: usize, project: &Project, words: &str) {
        let text = project.doll_text(12.0).replacen("doc: \"", &format!("doc: \"{words}"), 1);
        project.save(&format!("// {index}\n{text}"));
    }
    save(0, &project, &words);
    let mut served = Server::new(&project);
    served.watch.run_until_ok();
    let mut slow = served.page();
    let mut other = served.page();
    other.wait("done");
    let last = Arc::new(AtomicU64::new(u64::MAX));
    let reader = std::thread::spawn({
        let last = last.clone();
        move || {
            let mut told = 0;
            loop {
                let message = other.next();
                told += message.to_string().len();
                let run = message["run"].as_u64().filter(|_| message["event"] == "done");
                if run >= Some(last.load(Ordering::SeqCst)) {
                    return told;
                }
            }
        }
    });
    let before = memory(served.watch.id());
    let (mut most, mut run) = (0, 0);
    for index in 1..100 {
        save(index, &project, &words);
        run = served.watch.run_until_ok().number();
        most = most.max(memory(served.watch.id()));
    }
    last.store(run + 1, Ordering::SeqCst);
    save(100, &project, &words);
    served.watch.run_until_ok();
    let told = reader.join().unwrap();
    assert!(told > 100 << 20, "only {told} bytes were told: nobody was under pressure");
    assert!(most < before + (48 << 20), "{before} bytes became {most}");
    // A client that reads slowly gets the current state or is disconnected.
    loop {
        match slow.0.read() {
            Ok(Message::Text(text)) => {
                let message: Json = serde_json::from_str(&text).unwrap();
                if message["event"] == "done" && message["run"].as_u64() > Some(run) {
                    break;
                }
            }
            Ok(_) => {}
            Err(_) => break,
        }
    }
    served.watch.end();
}
