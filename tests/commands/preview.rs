//! The live page's server as browsers and others meet it: what it tells, and whom it tells nothing.

use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use maquette::value::Mesh;
use maquette::{Options, Run, Session, Settings, Wanted};
use nalgebra::{Matrix3, Point3, Vector3};
use serde_json::{Value as Json, json};
use tungstenite::client::IntoClientRequest;
use tungstenite::http::HeaderValue;
use tungstenite::{Message, WebSocket};

use crate::project::{Project, Watch};

/// Longer than anything takes on a busy machine; only a failing test waits that long.
const PATIENCE: Duration = Duration::from_secs(60);

/// A watch with a live page.
pub(crate) struct Served {
    pub(crate) watch: Watch,
    /// 127.0.0.1 and the port.
    pub(crate) host: String,
    pub(crate) token: String,
}

impl Served {
    pub(crate) fn new(project: &Project) -> Self {
        Self::with(project, &["--preview"], &[])
    }

    /// The same with these arguments and variables.
    pub(crate) fn with(project: &Project, more: &[&str], variables: &[(&str, &OsStr)]) -> Self {
        let mut watch = project.start_with(more, variables);
        let page = watch.wait(|event| event["event"] == "page");
        let link = page["link"].as_str().unwrap();
        let (host, token) = link.strip_prefix("http://").unwrap().split_once("/#").unwrap();
        Self { host: host.to_owned(), token: token.to_owned(), watch }
    }

    pub(crate) fn link(&self) -> String {
        format!("http://{}/#{}", self.host, self.token)
    }

    /// The head and the body of the answer to a request with these headers.
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

    /// A page: its socket.
    fn page(&self) -> Page {
        let origin = format!("http://{}", self.host);
        self.socket(&self.host, &origin, &self.token).unwrap()
    }

    /// The same of whoever says so; or the status of the refusal.
    fn socket(&self, host: &str, origin: &str, token: &str) -> Result<Page, u16> {
        let mut request = format!("ws://{}/socket", self.host).into_client_request().unwrap();
        let mut set = |name: &'static str, value: &str| {
            request.headers_mut().insert(name, HeaderValue::from_str(value).unwrap());
        };
        set("Host", host);
        set("Origin", origin);
        set("Sec-WebSocket-Protocol", &format!("maquette, {token}"));
        let stream = TcpStream::connect(&self.host).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        match tungstenite::client(request, stream) {
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

struct Page(WebSocket<TcpStream>);

impl Page {
    fn next(&mut self) -> Json {
        loop {
            if let Message::Text(text) = self.0.read().unwrap() {
                return serde_json::from_str(&text).unwrap();
            }
        }
    }

    /// The next message of a kind; those before it are dropped.
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

    /// The next value of this hash; whether it is of a drag.
    fn wait_live(&mut self, hash: &str) -> bool {
        loop {
            let value = self.wait("value");
            if value["hash"] == hash {
                return value["live"].as_bool().unwrap();
            }
        }
    }

    /// What is answered to a question about a value.
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
    let served = Served::new(&project);
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
    let served = Served::new(&project);
    let port = served.host.rsplit(':').next().unwrap().to_owned();
    for host in ["evil.example", &format!("evil.example:{port}"), "127.0.0.1", "127.0.0.1:1", ""] {
        assert_eq!(served.status("/", &[("Host", host)]), 403, "{host}");
        let (head, _) = served.ask("/page.js", &[("Host", host)]);
        assert!(head.starts_with("HTTP/1.1 403"), "{host}: {head}");
    }
    let own = format!("http://{}", served.host);
    let refused = |host: &str, origin: &str, token: &str| {
        served.socket(host, origin, token).err().unwrap_or(101)
    };
    assert_eq!(refused(&served.host, &own, &served.token), 101);
    let rebound = format!("evil.example:{port}");
    assert_eq!(refused(&rebound, &format!("http://{rebound}"), &served.token), 403);
    for origin in ["http://evil.example", "null", "", "https://evil.example", "http://127.0.0.1:1"]
    {
        assert_eq!(refused(&served.host, origin, &served.token), 403, "{origin}");
    }
    assert_eq!(refused(&served.host, &format!("{own}/"), &served.token), 403);
    for token in ["none", &served.token[1..], &"0".repeat(32)] {
        assert_eq!(refused(&served.host, &own, token), 403, "{token}");
    }
}

#[test]
fn nothing_but_the_page_is_served() {
    let project = Project::doll();
    let served = Served::new(&project);
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
    // Without an upgrade the socket is no page either.
    assert!((400..=426).contains(&served.status("/socket", &own)));
}

#[cfg(target_os = "linux")]
#[test]
fn this_machine_alone_is_listened_to() {
    let project = Project::doll();
    let served = Served::new(&project);
    let port: u16 = served.host.rsplit(':').next().unwrap().parse().unwrap();
    let tables = ["/proc/net/tcp", "/proc/net/tcp6"].map(std::fs::read_to_string);
    let lines = tables.iter().flatten().flat_map(|table| table.lines());
    // Local address and state; 0A listens.
    let listening = lines.filter_map(|line| {
        let words = Vec::from_iter(line.split_whitespace());
        let here = words.get(1)?.strip_suffix(&format!(":{port:04X}"))?;
        (words.get(3)? == &"0A").then(|| here.to_owned())
    });
    assert_eq!(Vec::from_iter(listening), ["0100007F"]);
}

#[test]
fn a_page_is_told_what_is_true_and_then_what_happens() {
    let project = Project::doll();
    let mut served = Served::new(&project);
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
    let mut served = Served::new(&project);
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
    // Huge sides are cut off, and what is no number is refused.
    let silly = asked.replace("width=64", "width=-1");
    assert_eq!(served.status(&silly, &[("Host", &served.host)]), 400);
    let own = [("Host", &served.host[..])];
    let (_, facts) = served.ask(&format!("/facts/{hash}"), &own);
    let facts: Json = serde_json::from_slice(&facts).unwrap();
    assert!(facts.as_array().unwrap().iter().any(|fact| fact[0] == "net"), "{facts}");
    let column = |value: &Json, name: &str| {
        let name = value["space"]["shapes"][0][name].as_str().unwrap().to_owned();
        (served.ask(&format!("/column/{name}"), &own).1, name)
    };
    let (places, old_name) = column(&first, "position");
    assert!(places.len() > 1000 && places.len().is_multiple_of(12), "{}", places.len());
    assert_eq!(served.status("/column/0123456789abcdef0123456789abcdef", &own), 404);
    project.save(&project.doll_text(12.5));
    let second = page.wait("value");
    assert_ne!(second["hash"], first["hash"]);
    // Who has the old column is told what has changed, if that is less.
    let (triangles, name) = column(&second, "triangle");
    assert_eq!(name, column(&first, "triangle").1);
    let same = format!("/column/{name}?from={name}");
    let (head, changes) = served.ask(&same, &own);
    assert!(head.contains("application/x-maquette-changes"), "{head}");
    assert!(changes.len() < 64 && changes.len() < triangles.len(), "{changes:?}");
    let (moved, name) = column(&second, "position");
    let (_, changes) = served.ask(&format!("/column/{name}?from={old_name}"), &own);
    assert!(name != old_name && moved.len() == places.len() && moved != places);
    assert!(changes == moved || changes.len() < moved.len());
    project.save(&project.doll_text(20.0).replace("Nurbs(", "Nurb("));
    while page.wait("problems")["problems"] == json!([]) {}
    // A page that is opened now knows the error and the last good value.
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
    // Nobody looks any more: nothing is kept for it.
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
    let mut served = Served::new(&project);
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
    // What is not there is no reason to stop.
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
    let mut served = Served::new(&project);
    served.watch.run_until_ok();
    let mut pages = Vec::from_iter((0..8).map(|_| served.page()));
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
    let mut served = Served::new(&project);
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
    let mut served = Served::new(&project);
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
    // What is out of range or not there is refused, and the file stays.
    for (name, value) in [("growth", "100.0"), ("growth", "[1"), ("girth", "1.0")] {
        page.say(&json!({ "ask": "set", "values": [[name, value]] }));
        let refused = page.wait("refused");
        assert!(!refused["why"].as_str().unwrap().is_empty(), "{refused}");
    }
    assert_eq!(std::fs::read_to_string(project.graph()).unwrap(), before);
    // Nobody's later change is taken back.
    page.say(&json!({ "ask": "set", "values": [["growth", "20.5"]] }));
    page.wait("done");
    project.save(&before.replace("default: 12.0", "default: 30.0"));
    page.wait("done");
    page.say(&json!({ "ask": "undo" }));
    assert!(page.wait("refused")["why"].as_str().unwrap().contains("since"));
    assert_eq!(std::fs::read_to_string(project.graph()).unwrap(), before.replace("12.0", "30.0"));
    served.watch.end();
}

#[test]
fn the_link_of_a_graph_stays_the_same() {
    let project = Project::doll();
    let mut first = Served::new(&project);
    let link = first.link();
    // Another watch of the same graph has a link of its own, and leaves the first one as it is.
    let mut second = Served::new(&project);
    assert_ne!(second.host, first.host);
    second.page().wait("hello");
    first.watch.end();
    let mut again = Served::new(&project);
    assert_eq!(again.link(), link);
    again.page().wait("hello");
    second.watch.end();
    again.watch.end();
    let mut last = Served::new(&project);
    assert_eq!(last.link(), link);
    last.watch.end();
}

#[test]
fn what_is_kept_of_a_link_is_a_secret_and_can_be_lost() {
    let project = Project::doll();
    let link = || {
        let mut served = Served::new(&project);
        served.page().wait("hello");
        served.watch.end();
        served.link()
    };
    let first = link();
    let kept = || {
        let mut entries = std::fs::read_dir(project.pages()).unwrap();
        let path = entries.next().unwrap().unwrap().path();
        assert!(entries.next().is_none());
        path
    };
    let text = std::fs::read_to_string(kept()).unwrap();
    let token = first.split('#').nth(1).unwrap();
    assert!(text.contains(token) && !kept().display().to_string().contains("doll"), "{text}");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
        assert_eq!((mode(&kept()), mode(&project.pages())), (0o600, 0o700));
        // Others could have read it.
        std::fs::set_permissions(kept(), std::fs::Permissions::from_mode(0o644)).unwrap();
        assert!(!link().ends_with(token));
        assert_eq!(mode(&kept()), 0o600);
    }
    std::fs::write(kept(), "nothing of the kind").unwrap();
    let other = link();
    assert!(!other.ends_with(token));
    assert_eq!(link(), other);
    // Where nothing can be kept each link is a new one.
    std::fs::remove_dir_all(project.pages()).unwrap();
    std::fs::write(project.pages(), "").unwrap();
    assert_ne!(link(), link());
}

/// A program of this text, which `sh` runs.
#[cfg(target_os = "linux")]
pub(crate) fn script(project: &Project, name: &str, text: &str) -> PathBuf {
    use std::os::unix::fs::PermissionsExt;
    let path = project.folder().join(name);
    std::fs::write(&path, format!("#!/bin/sh\n{text}")).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    path
}

/// The text of a file, once it is there.
#[cfg(target_os = "linux")]
pub(crate) fn written(path: &Path) -> String {
    let start = Instant::now();
    loop {
        if let Ok(text) = std::fs::read_to_string(path) {
            return text;
        }
        assert!(start.elapsed() < PATIENCE, "{} was never written", path.display());
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_browser_is_given_a_file_that_leads_to_the_page() {
    use std::os::unix::fs::PermissionsExt;
    let project = Project::doll();
    let told = project.folder().join("told");
    let seen = "tr '\\0' ' ' < /proc/$$/cmdline > told.new; tr '\\0' ' ' < /proc/$PPID/cmdline >> told.new; mv told.new told\n";
    let browser = script(&project, "browser", seen);
    let browser = format!("no-such-browser:{} --new %s", browser.display());
    let mut served = Served::with(&project, &["--open"], &[("BROWSER", OsStr::new(&browser))]);
    let told = written(&told);
    assert!(told.contains("--open") && !told.contains(&served.token), "{told}");
    let given = told.split_whitespace().find(|word| word.ends_with(".html")).unwrap();
    let given = Path::new(given);
    assert!(given.starts_with(project.pages()), "{given:?}");
    assert_eq!(std::fs::metadata(given).unwrap().permissions().mode() & 0o777, 0o600);
    let page = std::fs::read_to_string(given).unwrap();
    let url = page.split("url=").nth(1).unwrap().split('"').next().unwrap();
    assert_eq!(url, served.link());
    served.page().wait("hello");
    served.watch.end();
    assert!(!given.exists());
}

#[cfg(target_os = "linux")]
#[test]
fn without_a_browser_the_link_is_told_and_the_watch_goes_on() {
    let project = Project::doll();
    let failing = script(&project, "browser", "exit 3\n");
    for browser in ["", "no-such-browser", failing.to_str().unwrap()] {
        let mut command = project.command(&["watch", "doll.ron", "--open", "--out", "out"]);
        command.env("BROWSER", browser).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut process = command.spawn().unwrap();
        let said = BufReader::new(process.stderr.take().unwrap()).lines().map_while(Result::ok);
        let words = said.into_iter().find(|line| line.contains("no browser was opened")).unwrap();
        assert!(words.contains("http://127.0.0.1:"), "{words}");
        let runs = BufReader::new(process.stdout.take().unwrap()).lines().map_while(Result::ok);
        assert!(runs.into_iter().any(|line| line.starts_with("run 1: ")));
        process.kill().unwrap();
        process.wait().unwrap();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn the_editor_is_opened_where_pages_were_told_and_nowhere_else() {
    let project = Project::doll();
    let told = project.folder().join("told");
    let editor = "for word; do echo \"$word\"; done > told.new; mv told.new told\n";
    let editor = script(&project, "code", editor);
    let text = std::fs::read_to_string(project.graph()).unwrap();
    let mut served =
        Served::with(&project, &["--preview"], &[("MAQUETTE_EDITOR", editor.as_os_str())]);
    served.watch.run_until_ok();
    let mut page = served.page();
    page.wait("done");
    let opened = |page: &mut Page, what: Json| {
        let _ = std::fs::remove_file(&told);
        page.say(&what);
        let told = written(&told);
        let (option, place) = told.trim_end().split_once('\n').unwrap();
        assert_eq!(option, "-g");
        let place = place.strip_prefix(&format!("{}:", project.graph().display()));
        let (line, column) = place.unwrap().split_once(':').unwrap();
        (line.parse::<usize>().unwrap(), column.parse::<usize>().unwrap())
    };
    let place_of = |text: &str, words: &str| {
        let (line, row) = text.lines().enumerate().find(|(_, row)| row.contains(words)).unwrap();
        (line + 1, row.find(words).unwrap() + 1)
    };
    let at = opened(&mut page, json!({ "ask": "open", "node": "nose" }));
    assert_eq!(at, place_of(&text, "ExtractRegion("));
    let (line, _) = opened(&mut page, json!({ "ask": "open", "node": "nose-mask.png" }));
    assert_eq!(line, place_of(&text, "\"nose-mask.png\"").0);
    let broken = text.replace("Nurbs(", "Nurb(");
    project.save(&broken);
    let problem = loop {
        let told = page.wait("problems");
        if told["problems"] != json!([]) {
            break told["problems"][0].clone();
        }
    };
    let place =
        json!({ "file": problem["file"], "line": problem["line"], "column": problem["column"] });
    let at = opened(&mut page, json!({ "ask": "open", "problem": place }));
    assert_eq!(at, place_of(&broken, "Nurb("));
    let _ = std::fs::remove_file(&told);
    for what in [
        json!({ "problem": { "file": "/etc/passwd", "line": 1, "column": 1 } }),
        json!({ "problem": { "file": "doll.ron", "line": 1, "column": 1 } }),
        json!({ "node": "../../etc/passwd" }),
        json!({}),
    ] {
        let mut asked = what.clone();
        asked["ask"] = "open".into();
        page.say(&asked);
        let why = page.wait("refused")["why"].as_str().unwrap().to_owned();
        assert!(why.contains("no such place"), "{what}: {why}");
    }
    assert!(!told.exists());
    served.watch.end();
}

#[cfg(target_os = "linux")]
#[test]
fn an_editor_that_cannot_be_opened_is_told_of() {
    let project = Project::doll();
    let failing = script(&project, "failing", "exit 3\n");
    for (variable, editor, expected) in [
        ("VISUAL", "vim", "MAQUETTE_EDITOR"),
        ("MAQUETTE_EDITOR", "no-such-editor", "there is no program no-such-editor"),
        ("MAQUETTE_EDITOR", failing.to_str().unwrap(), "exit status: 3"),
    ] {
        let mut served = Served::with(&project, &["--preview"], &[(variable, OsStr::new(editor))]);
        served.watch.run_until_ok();
        let mut page = served.page();
        page.say(&json!({ "ask": "open", "node": "nose" }));
        let why = page.wait("refused")["why"].as_str().unwrap().to_owned();
        assert!(why.contains(expected), "{why}");
        served.watch.end();
    }
}

/// How much memory a process holds.
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
    // Each change of the graph is told with these words.
    let words = "many words. ".repeat(1 << 17);
    let save = |index: usize| {
        let growth = 12.0 + (index / 20) as f64;
        let text = project.doll_text(growth).replacen("doc: \"", &format!("doc: \"{words}"), 1);
        project.save(&format!("// {index}\n{text}"));
    };
    save(0);
    let mut served = Served::new(&project);
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
        save(index);
        run = served.watch.run_until_ok().number();
        most = most.max(memory(served.watch.id()));
    }
    last.store(run + 1, Ordering::SeqCst);
    save(100);
    served.watch.run_until_ok();
    let told = reader.join().unwrap();
    assert!(told > 100 << 20, "only {told} bytes were told: nobody was under pressure");
    assert!(most < before + (64 << 20), "{before} bytes became {most}");
    // Whoever begins to read comes to what is true, or is gone.
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

/// A doll of which everything is known already, a page that looks at a value, and that value's hash.
fn looking_at(node: &str, output: &str) -> (Project, Served, Page, String) {
    let project = Project::doll();
    assert!(project.maquette(&["run", "doll.ron", "--out", "out"]).status.success());
    let mut served = Served::new(&project);
    served.watch.run_until_ok();
    let mut page = served.page();
    page.wait("done");
    page.look_at(node, output);
    let value = page.wait("value");
    assert_eq!(value["live"], false, "{value}");
    let hash = value["hash"].as_str().unwrap().to_owned();
    (project, served, page, hash)
}

#[test]
fn a_drag_evaluates_what_is_looked_at_and_writes_nothing() {
    let (project, mut served, mut page, first) = looking_at("raised", "net");
    let last = project.hash("raised.net", &["growth=31.5"]);
    let text = std::fs::read_to_string(project.graph()).unwrap();
    let (outputs, remembered) = (project.output_times(), project.remembered());
    for k in 0..20 {
        page.drag("growth", 12.5 + f64::from(k));
        std::thread::sleep(Duration::from_millis(16));
    }
    assert!(page.wait_live(&last));
    assert_eq!(std::fs::read_to_string(project.graph()).unwrap(), text);
    assert_eq!(project.output_times(), outputs);
    assert!(project.remembered() == remembered, "something was kept on disk");
    // It is given up: what is in the file comes back.
    page.say(&json!({ "ask": "drop" }));
    assert!(!page.wait_live(&first));
    page.drag("growth", 31.5);
    assert!(page.wait_live(&last));
    page.set("growth", 31.5);
    assert!(!page.wait_live(&last));
    let events = served.watch.until("run");
    let mut nodes = events.iter().filter_map(|event| event["node"].as_str());
    assert!(nodes.all(|node| node == "raised"), "{events:?}");
    let started = events.iter().filter(|event| event["event"] == "started").count();
    assert!((1..=20).contains(&started), "{events:?}");
    // Only what the view did not need has to be computed for the outputs.
    let run = served.watch.run_until_ok();
    assert_eq!((run.state("raised"), run.state("blended")), ("cached", "computed"));
    page.wait("done");
    page.say(&json!({ "ask": "undo" }));
    assert!(!page.wait_live(&first));
    assert_eq!(std::fs::read_to_string(project.graph()).unwrap(), text);
    served.watch.end();
}

#[test]
fn a_run_after_a_drag_computes_nothing_again_in_this_process_and_in_the_next() {
    let (project, mut served, mut page, first) = looking_at("model", "mesh");
    // The hand goes on until it has seen something on its way, though each value takes longer than the next one needs to come.
    let (mut growth, mut seen) = (12.0, Vec::new());
    page.0.get_mut().set_read_timeout(Some(Duration::from_millis(10))).unwrap();
    while seen.len() < 3 {
        growth = if growth < 39.0 { growth + 0.1 } else { 12.0 };
        page.drag("growth", growth);
        match page.0.read() {
            Ok(Message::Text(text)) => {
                let message: Json = serde_json::from_str(&text).unwrap();
                seen.extend((message["event"] == "value").then_some(message));
            }
            Ok(_) => {}
            Err(tungstenite::Error::Io(_)) => {}
            Err(other) => panic!("{other}"),
        }
    }
    page.0.get_mut().set_read_timeout(Some(PATIENCE)).unwrap();
    assert!(seen.iter().all(|value| value["live"] == true), "{seen:?}");
    page.drag("growth", 20.5);
    let last = project.hash("model.mesh", &["growth=20.5"]);
    assert!(page.wait_live(&last));
    page.set("growth", 20.5);
    let run = served.watch.run_until_ok();
    assert_eq!((&run.done["computed"], run.state("model")), (&json!(0), "cached"), "{run:?}");
    assert!(!page.wait_live(&last));
    assert_ne!(first, last);
    project.remembered();
    served.watch.end();
    let next = project.maquette(&["run", "doll.ron", "--out", "out", "--json"]);
    let next: Json = serde_json::from_slice(&next.stdout).unwrap();
    let states = next["nodes"].as_array().unwrap().iter().map(|node| &node["state"]);
    assert!(states.clone().count() > 5 && states.clone().all(|state| state == "cached"), "{next}");
}

#[test]
fn a_hand_that_rests_gives_up_the_value_before() {
    let (project, mut served, mut page, _) = looking_at("skin", "mesh");
    let last = project.hash("skin.mesh", &["levels=0"]);
    let levels = |levels: &str| json!({ "ask": "drag", "values": [["levels", levels.to_owned()]] });
    page.say(&levels("4"));
    served.watch.wait(|event| event["event"] == "started" && event["node"] == "skin");
    let moved = Instant::now();
    page.say(&levels("0"));
    served.watch.wait(|event| event["event"] == "started" && event["node"] == "skin");
    let took = moved.elapsed();
    // Alone it takes seconds. While values come it is let go on.
    let sensible = Duration::from_millis(120)..Duration::from_millis(2000);
    assert!(sensible.contains(&took), "{took:?}");
    let value = page.wait("value");
    assert_eq!((&value["hash"], &value["live"]), (&json!(last), &json!(true)));
    served.watch.end();
}

#[test]
fn values_of_a_drag_that_do_not_do_are_told_once_and_the_picture_stays() {
    let (project, mut served, mut page, _) = looking_at("raised", "net");
    page.drag("growth", 100.0);
    let refused = page.wait("refused");
    assert!(refused["why"].as_str().unwrap().contains("growth"), "{refused}");
    for growth in [101.0, 102.0, 103.0] {
        page.drag("growth", growth);
        std::thread::sleep(Duration::from_millis(30));
    }
    page.say(&json!({ "ask": "drag", "values": [["girth", "1.0"], ["growth", "[1"]] }));
    page.drag("growth", 20.0);
    let message = page.next();
    let message = if message["event"] == "started" { page.next() } else { message };
    let message = if message["event"] == "finished" { page.next() } else { message };
    let hash = project.hash("raised.net", &["growth=20.0"]);
    assert_eq!((&message["hash"], &message["live"]), (&json!(hash), &json!(true)), "{message}");
    page.drag("growth", 100.0);
    page.wait("refused");
    served.watch.end();
}

#[test]
fn a_drag_ends_when_somebody_saves_the_file_and_when_its_page_is_gone() {
    let (project, mut served, mut page, _) = looking_at("raised", "net");
    let hash = |growth: f64| project.hash("raised.net", &[&format!("growth={growth:.1}")]);
    let [of_25, of_27, of_30] = [25.0, 27.0, 30.0].map(hash);
    page.drag("growth", 25.0);
    assert!(page.wait_live(&of_25));
    project.save(&project.doll_text(30.0));
    assert!(page.wait("refused")["why"].as_str().unwrap().contains("changed"));
    let value = page.wait("value");
    assert_eq!((&value["hash"], &value["live"]), (&json!(of_30), &json!(false)));
    // Until the hand lets go it is still the old drag.
    page.drag("growth", 26.0);
    page.say(&json!({ "ask": "drop" }));
    page.drag("growth", 27.0);
    let value = page.wait("value");
    assert_eq!((&value["hash"], &value["live"]), (&json!(of_27), &json!(true)));
    // Its own change of the file is no other's: a hand that moves on at once drags on.
    page.set("growth", 27.0);
    page.drag("growth", 25.0);
    assert!(page.wait_live(&of_25));
    let mut other = served.page();
    other.look_at("raised", "net");
    assert!(other.wait_live(&of_25));
    drop(page);
    assert!(!other.wait_live(&of_27));
    served.watch.run_until_ok();
    assert!(project.doll_text(27.0) == std::fs::read_to_string(project.graph()).unwrap());
    project.assert_outputs_are_right();
    served.watch.end();
}

#[test]
fn a_probe_says_what_inspect_says() {
    let project = Project::doll();
    let mut served = Served::new(&project);
    served.watch.run_until_ok();
    let (mut page, mut other) = (served.page(), served.page());
    let values = [("scan", "color"), ("scan", "range"), ("red", "mask"), ("spots", "labels")];
    let views = values.map(|(node, output)| json!({ "node": node, "output": output }));
    page.say(&json!({ "ask": "views", "views": views }));
    values.iter().for_each(|_| drop(page.wait("value")));
    let mut told = 0;
    for (id, (node, output)) in values.into_iter().enumerate() {
        for [column, row] in [[200, 210], [120, 133], [3, 399], [400, 0], [0, usize::MAX]] {
            let at = json!({ "at": [column, row] });
            let answer = page.ask("probe", id as u64, node, output, &at);
            let (name, at) = (format!("{node}.{output}"), format!("{column},{row}"));
            let inspected =
                project.maquette(&["inspect", "doll.ron", &name, "--at", &at, "--json"]);
            match serde_json::from_slice::<Json>(&inspected.stdout) {
                Ok(inspected) => {
                    assert_eq!(answer["facts"], inspected["outputs"][0]["facts"], "{name} {at}");
                    told += 1;
                }
                Err(_) => {
                    let why = answer["why"].as_str().unwrap();
                    assert!(String::from_utf8_lossy(&inspected.stderr).contains(why), "{answer}");
                }
            }
        }
    }
    assert!((9..16).contains(&told), "{told}");
    let nobody = page.ask("probe", 7, "whole", "range", &json!({ "at": [1, 1] }));
    assert!(nobody["why"].as_str().unwrap().contains("nobody"), "{nobody}");
    // Bad numbers and names harm nothing, nor does a page that asks without end: the latest question is answered.
    for at in [json!([-1, 0]), json!([0.5, 1]), json!([1]), json!("1,1"), json!(null)] {
        page.say(&json!({ "ask": "probe", "id": 8, "node": "red", "output": "mask", "at": at }));
    }
    page.ask("probe", 9, "../doll.ron", "\u{0}", &json!({ "at": [1, 1] }));
    for id in 10..2000 {
        page.say(&json!({ "ask": "probe", "id": id, "node": "red", "output": "mask", "at": [id % 400, 7] }));
    }
    let (mut answered, mut last) = (0, 0);
    while last < 1999 {
        let id = page.wait("probe")["id"].as_u64().unwrap();
        assert!(last < id && 10 <= id);
        (answered, last) = (answered + 1, id);
    }
    assert!(answered < 1990, "every question was answered");
    // Nobody else was told.
    other.say(&json!({ "ask": "views", "views": [{ "node": "normal", "output": "normal" }] }));
    loop {
        let message = other.next();
        assert_ne!(message["event"], "probe");
        if message["event"] == "value" && message["node"] == "normal" {
            break;
        }
    }
    served.watch.end();
}

/// The doll's mesh of this node, computed here.
pub(crate) fn mesh_of(project: &Project, node: &str) -> Mesh {
    let mut session = Session::new(maquette_nodes::PACKS, &Settings::in_memory()).unwrap();
    let graph = session.load(&project.graph(), &Options::default()).graph.unwrap();
    let wanted = Wanted::Named(vec![node.to_owned()]);
    let Ok(done) = session.run(&graph, &Run { wanted, ..Run::default() }) else { panic!() };
    done.get::<Mesh>(node).unwrap().clone()
}

/// The first triangle that a ray meets, and where: Cramer's rule for each of them.
fn met(mesh: &Mesh, origin: Point3<f64>, to: Vector3<f64>) -> Option<(usize, Point3<f64>)> {
    let faces = mesh.faces().as_triangles().unwrap().iter().enumerate();
    let hits = faces.filter_map(|(face, corners)| {
        let [a, b, c] = corners.map(|corner| mesh.positions()[corner as usize]);
        let solved = Matrix3::from_columns(&[b - a, c - a, -to]).try_inverse()? * (origin - a);
        let is_met = solved.min() >= 0.0 && solved.x + solved.y <= 1.0;
        is_met.then_some((solved.z, face))
    });
    let (along, face) = hits.min_by(|a, b| a.0.total_cmp(&b.0))?;
    Some((face, origin + to * along))
}

#[test]
fn a_pick_meets_the_face_and_vertex_that_a_look_at_all_of_them_meets() {
    let project = Project::doll();
    let mut served = Served::new(&project);
    served.watch.run_until_ok();
    let mut page = served.page();
    page.look_at("model", "mesh");
    page.wait("value");
    let mesh = mesh_of(&project, "model");
    let faces = mesh.faces().as_triangles().unwrap();
    let mut hits = 0;
    for k in 0..40_usize {
        let [a, b, c] = faces[k * 997 % faces.len()].map(|v| mesh.positions()[v as usize].coords);
        let aim = Point3::from(a * 0.5 + b * 0.3 + c * 0.2);
        let turn = k as f64;
        let origin = aim + Vector3::new(libm::sin(turn) * 40.0, libm::cos(turn) * 30.0, -300.0);
        // Some go far past it.
        let to = if k % 8 == 7 { Vector3::new(1.0, 0.2, 0.0) } else { (aim - origin) * 0.01 };
        let ray = json!({ "origin": origin.coords.as_slice(), "direction": to.as_slice() });
        let answer = page.ask("pick", k as u64, "model", "mesh", &ray);
        let Some((face, place)) = met(&mesh, origin, to) else {
            assert_eq!(answer["nothing"], true, "{answer}");
            continue;
        };
        hits += 1;
        assert_eq!((&answer["kind"], &answer["face"]), (&json!("triangles"), &json!(face)));
        let at = |name: &str| {
            Point3::from(serde_json::from_value::<[f64; 3]>(answer[name].clone()).unwrap())
        };
        assert!((at("at") - place).norm() < 1e-6, "{answer} {place}");
        let far = |v: &u32| (mesh.positions()[*v as usize] - place).norm();
        let nearest = *faces[face].iter().min_by(|a, b| far(a).total_cmp(&far(b))).unwrap();
        assert_eq!(answer["vertex"], nearest, "{answer}");
        assert_eq!(at("vertex_at"), mesh.positions()[nearest as usize]);
        let told = mesh.vertex().iter().chain(mesh.corner().iter()).map(|(name, _)| name);
        let (of_vertex, of_corner) = (&answer["attributes"], &answer["corner_attributes"]);
        assert!(
            told.count() > 0 && (of_vertex.get("uv").or(of_corner.get("uv"))).is_some(),
            "{answer}"
        );
    }
    assert!((20..40).contains(&hits), "{hits}");
    // What is no ray, or of nothing that is looked at, harms nothing.
    let ray = json!({ "origin": [0.0, 0.0, 0.0], "direction": [0.0, 0.0, 1.0] });
    for (node, output) in [("scan", "color"), ("", ""), ("model", "color")] {
        assert_eq!(page.ask("pick", 50, node, output, &ray)["nothing"], true);
    }
    for direction in [json!([0.0, 0.0, 0.0]), json!([1e308, 1e308, 1e308])] {
        let ray = json!({ "origin": [0.0, 0.0, 0.0], "direction": direction });
        assert_eq!(page.ask("pick", 51, "model", "mesh", &ray)["nothing"], true, "{direction}");
    }
    for origin in ["[1e999, 0, 0]", "[0, 0]", "[null, 0, 0]", "\"0,0,0\"", "[NaN, 0, 0]"] {
        let question = format!(
            r#"{{"ask": "pick", "id": 52, "node": "model", "output": "mesh", "origin": {origin}, "direction": [0, 0, 1]}}"#
        );
        page.0.send(Message::text(question)).unwrap();
    }
    let mut ray = ray;
    ray["radius"] = json!(-5.0);
    assert_eq!(page.ask("pick", 53, "model", "mesh", &ray)["id"], 53);
    // A net has no faces: its nearest corner is found.
    page.look_at("raised", "net");
    page.wait("value");
    let ray = json!({ "origin": [0.0, 0.0, -10.0], "direction": [0.0, 0.0, 1.0], "radius": 0.9 });
    let found = page.ask("pick", 54, "raised", "net", &ray);
    assert!(found["kind"].is_string() && found["vertex"].is_u64(), "{found}");
    served.watch.end();
}
