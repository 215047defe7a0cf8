//! A real browser without a window, controlled through the DevTools protocol.

use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value as Json, json};
use tungstenite::{Message, WebSocket};

/// Timeout for answers; only a failing test waits this long.
const PATIENCE: Duration = Duration::from_secs(60);

/// Names of the browsers that support the DevTools protocol.
const BROWSERS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];

/// Arguments that provide WebGL on any machine, with the same colors everywhere. WebGL is drawn by software, because Debian's Chromium
/// would otherwise require a graphics card. Everything else is drawn as on a machine without a graphics card.
const DRAWN: [&str; 4] = [
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-rasterization",
    "--force-color-profile=srgb",
];

/// A tab of the browser, by the id of its session.
pub(crate) struct Tab(String);

/// A browser, which begins with one tab. It is killed when this value is dropped.
pub(crate) struct Browser {
    process: Child,
    socket: WebSocket<Socket>,
    session: String,
    last: u64,
    /// The errors that pages have written to the browser's console.
    pub(crate) complaints: Vec<String>,
    _profile: tempfile::TempDir,
}

impl Browser {
    /// Starts a browser that draws with WebGL, without a graphics card. If no browser is installed, prints a line and returns `None`, or
    /// fails in CI.
    pub(crate) fn start() -> Option<Self> {
        Self::start_with(&[])
    }

    /// Starts a browser with these additional arguments.
    pub(crate) fn start_with(more: &[&str]) -> Option<Self> {
        Self::start_only(&[&DRAWN[..], more].concat())
    }

    /// Starts a browser without WebGL.
    pub(crate) fn without_webgl() -> Option<Self> {
        Self::start_only(&["--disable-gpu", "--disable-3d-apis"])
    }

    #[expect(clippy::print_stdout, reason = "says what is not there to be tested")]
    fn start_only(more: &[&str]) -> Option<Self> {
        let profile = tempfile::tempdir().unwrap();
        let Some(mut process) = BROWSERS.iter().find_map(|name| launch(name, profile.path(), more))
        else {
            assert!(std::env::var_os("CI").is_none(), "there is no browser; install Chromium");
            println!("skipped: there is no Chromium to show the page");
            return None;
        };
        let lines = BufReader::new(process.stderr.take().unwrap()).lines();
        let address = lines
            .map_while(Result::ok)
            .find_map(|line| line.strip_prefix("DevTools listening on ").map(str::to_owned));
        let address = address.expect("the browser listens");
        let host = address.strip_prefix("ws://").unwrap().split('/').next().unwrap();
        let stream = TcpStream::connect(host).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let (socket, _) = tungstenite::client(&address, Socket(stream)).unwrap();
        let (session, complaints) = (String::new(), Vec::new());
        let mut browser = Self { process, socket, session, last: 0, complaints, _profile: profile };
        browser.add_tab();
        Some(browser)
    }

    /// Opens another tab in its own window and switches to it.
    pub(crate) fn add_tab(&mut self) -> Tab {
        self.session.clear();
        let wanted = json!({ "url": "about:blank", "newWindow": true });
        let target = self.call("Target.createTarget", wanted);
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let attached = self.call("Target.attachToTarget", attach);
        attached["sessionId"].as_str().unwrap().clone_into(&mut self.session);
        self.call("Runtime.enable", json!({}));
        self.call("Log.enable", json!({}));
        Tab(self.session.clone())
    }

    /// Switches to this tab.
    pub(crate) fn go_to(&mut self, Tab(session): &Tab) {
        self.session.clone_from(session);
    }

    /// Sends a command to the browser and returns the answer.
    pub(crate) fn call(&mut self, method: &str, parameters: Json) -> Json {
        self.try_call(method, parameters).unwrap_or_else(|error| panic!("{method}: {error}"))
    }

    /// Sends a command to the browser and returns the answer, or the browser's error.
    fn try_call(&mut self, method: &str, parameters: Json) -> Result<Json, Json> {
        self.last += 1;
        let mut command = json!({ "id": self.last, "method": method, "params": parameters });
        if !self.session.is_empty() {
            command["sessionId"] = self.session.clone().into();
        }
        self.socket.send(Message::text(command.to_string())).unwrap();
        loop {
            let Message::Text(text) = self.socket.read().unwrap() else { continue };
            let mut message: Json = serde_json::from_str(&text).unwrap();
            if message["id"] == self.last {
                let error = message["error"].take();
                return if error.is_null() { Ok(message["result"].take()) } else { Err(error) };
            }
            let is_error = message["params"]["type"] == "error"
                || message["params"]["entry"]["level"] == "error"
                || message["method"] == "Runtime.exceptionThrown";
            if is_error {
                self.complaints.push(message.to_string());
            }
        }
    }

    pub(crate) fn open(&mut self, link: &str) {
        self.call("Page.navigate", json!({ "url": link }));
    }

    /// Reloads the page and waits until the new page is loaded.
    pub(crate) fn reload(&mut self) {
        self.ask("window.before = 1");
        self.call("Page.reload", json!({}));
        self.wait("window.before === undefined && document.readyState === 'complete'");
    }

    /// Returns the value of a JavaScript expression in the page.
    pub(crate) fn ask(&mut self, expression: &str) -> Json {
        self.try_ask(expression).unwrap_or_else(|error| panic!("{expression}: {error}"))
    }

    /// Returns the value of a JavaScript expression, or an error if the page was left meanwhile.
    fn try_ask(&mut self, expression: &str) -> Result<Json, Json> {
        let asked =
            json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let mut answer = self.try_call("Runtime.evaluate", asked)?;
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {answer}");
        Ok(answer["result"]["value"].take())
    }

    /// Waits until an expression is true, even if another page is loaded meanwhile; returns the waiting time.
    #[track_caller]
    pub(crate) fn wait(&mut self, expression: &str) -> Duration {
        let start = Instant::now();
        let wanted = format!("Boolean({expression})");
        while !self.try_ask(&wanted).is_ok_and(|answer| answer == true) {
            assert!(start.elapsed() < PATIENCE, "this never came true: {expression}");
            std::thread::sleep(Duration::from_millis(20));
        }
        start.elapsed()
    }

    /// Presses a key at the focused element. `modifiers` is the bit field of the DevTools protocol; 2 is Ctrl.
    pub(crate) fn press(&mut self, key: &str, modifiers: u32) {
        let code = match key {
            "Enter" => 13,
            "Tab" => 9,
            "ArrowRight" => 39,
            _ => 0,
        };
        let text = match key {
            "Enter" => "\r",
            _ if key.chars().count() == 1 && modifiers == 0 => key,
            _ => "",
        };
        for kind in ["keyDown", "keyUp"] {
            let mut event = json!({ "type": kind, "key": key, "modifiers": modifiers, "windowsVirtualKeyCode": code });
            if kind == "keyDown" && !text.is_empty() {
                event["text"] = text.into();
            }
            self.call("Input.dispatchKeyEvent", event);
        }
    }

    /// Selects the content of a field and types a text in its place.
    pub(crate) fn write(&mut self, field: &str, text: &str) {
        self.ask(&format!(
            "document.querySelector('{field}').focus(), document.querySelector('{field}').select()"
        ));
        self.call("Input.insertText", json!({ "text": text }));
    }
}

/// Starts the process of a browser that accepts commands; returns `None` if the browser is not installed.
fn launch(name: &str, profile: &std::path::Path, more: &[&str]) -> Option<Child> {
    let mut command = Command::new(name);
    command.args(["--headless=new", "--no-sandbox", "--remote-debugging-port=0"]);
    command.args([
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
    ]);
    command.args(["--disable-sync", "--hide-scrollbars", "--force-device-scale-factor=1"]);
    command.arg(format!("--user-data-dir={}", profile.display())).arg("--window-size=1400,900");
    command.args(more);
    // Files that a killed browser leaves behind are removed with the profile's folder.
    command.env("TMPDIR", profile);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().ok()
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A TCP connection that repeats a read or write that a signal has interrupted. For example, stopping and continuing the process interrupts
/// a read with a timeout.
pub(crate) struct Socket(pub(crate) TcpStream);

impl Read for Socket {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        retry_interrupted(|| self.0.read(into))
    }
}

impl Write for Socket {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        retry_interrupted(|| self.0.write(bytes))
    }

    fn flush(&mut self) -> std::io::Result<()> {
        retry_interrupted(|| self.0.flush())
    }
}

fn retry_interrupted<T>(mut act: impl FnMut() -> std::io::Result<T>) -> std::io::Result<T> {
    loop {
        match act() {
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            done => return done,
        }
    }
}
