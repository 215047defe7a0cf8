//! Measures the speed and the memory of the live page, in a real Chromium that draws without a graphics card. The limits in parentheses
//! must be met on a quiet machine:
//!
//! - the time from a save of the graph until the picture changes, with 20 000 triangles,
//! - the time from a move of a slider until its picture is drawn, with 20 000 triangles,
//! - the time from the message of a value until 1.5 million moved triangles are in the buffers of the graphics card (150 ms),
//! - the fraction of a value's bytes that is sent after a local edit (a tenth),
//! - the time until the page is told of a local edit of 10.8 million triangles, after a save (800 ms) or a move of a slider (300 ms),
//! - for the same edit, the time until it is in the buffers (300 ms), and the amount of data that is sent (10 MB),
//! - the additional memory after 500 edits (none),
//! - the time until eight open pages show a save.
//!
//! `cargo bench -p maquette-program --bench page` needs Chromium and takes about eight minutes. Four of these are for drawing large values
//! without a graphics card. Arguments select single measurements: `told`, `small`, `large`, `local`, `ten-million`, `tabs`.
//!
//! Results on two cores without a graphics card: with 20 000 triangles, a save is visible after 130 ms, and a move of a slider after 76 ms.
//! 1.5 million moved triangles take 12 MB and are in the buffers after 50 ms. When the nose of the doll changes, 3 % of the value's bytes
//! are sent. After 500 edits the page needs as much memory as before. Eight pages show a save after 95 ms. A page is told of ten million
//! changed triangles 130 ms after a save or a move of a slider. `told` measures this without drawing, because drawing without a graphics
//! card occupies all cores for seconds.

use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde_json::{Value as Json, json};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

#[path = "../tests/page/browser.rs"]
#[expect(dead_code, reason = "tests press keys, too")]
mod browser;

use browser::Browser;

const GRAPHS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../graphs");

fn main() {
    let wanted: Vec<_> = std::env::args().skip(1).filter(|word| !word.starts_with("--")).collect();
    fn is_wanted(name: &str, wanted: &[String]) -> bool {
        wanted.is_empty() || wanted.iter().any(|word| word == name)
    }
    if is_wanted("told", &wanted) {
        measure_messages();
    }
    let Some(mut browser) = Browser::start() else { return };
    for (name, measure) in [
        ("small", small as fn(&mut Browser)),
        ("large", large),
        ("local", local),
        ("ten-million", ten_million),
        ("tabs", tabs),
    ] {
        if is_wanted(name, &wanted) {
            measure(&mut browser);
        }
    }
}

fn say(line: &str) {
    writeln!(std::io::stdout(), "{line}").expect("stdout is open");
}

fn say_times(what: &str, mut times: Vec<f64>) {
    times.sort_by(f64::total_cmp);
    fn percentile(share: usize, times: &[f64]) -> f64 {
        times[(times.len() - 1) * share / 100]
    }
    say(&format!(
        "{what}: {:.0} ms in half, {:.0} ms in 95 of 100",
        percentile(50, &times),
        percentile(95, &times)
    ));
}

/// Starts a watch of a graph with a wavy sheet of `side` x `side` points, which a parameter rotates.
fn sheet(side: usize) -> Watch {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut file = String::from("ply\nformat ascii 1.0\n");
    let faces = 2 * (side - 1) * (side - 1);
    file += &format!("element vertex {}\n", side * side);
    file += "property double x\nproperty double y\nproperty double z\n";
    file += &format!("element face {faces}\nproperty list uchar int vertex_indices\nend_header\n");
    for k in 0..side * side {
        let [x, y] = [k % side, k / side].map(|at| 100.0 * at as f64 / side as f64);
        file += &format!("{x:.3} {y:.3} {:.3}\n", 5.0 * libm::sin(0.3 * x) * libm::cos(0.2 * y));
    }
    for k in (0..side * (side - 1)).filter(|k| k % side < side - 1) {
        file += &format!("3 {} {} {}\n", k, k + 1, k + side + 1);
        file += &format!("3 {} {} {}\n", k, k + side + 1, k + side);
    }
    std::fs::write(folder.path().join("sheet.ply"), file).expect("a file");
    let text = r#"Graph(
    format: 1,
    params: { "turn": Number(default: 12.0, min: 0.0, max: 1000.0, doc: "How far it is turned.") },
    nodes: {
        "sheet": ReadMesh(path: "sheet.ply"),
        "turned": Transform(mesh: "sheet", rotate: (0, Param("turn"), 0)),
    },
    outputs: {},
)
"#;
    Watch::start(folder, text)
}

/// Starts a watch of the example graph `doll.ron` with this number of subdivision levels.
fn doll(levels: usize) -> Watch {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::create_dir(folder.path().join("doll")).expect("a folder");
    for name in ["doll/color.png", "doll/range.pcd", "doll/camera.json"] {
        std::fs::copy(Path::new(GRAPHS).join(name), folder.path().join(name)).expect("a copy");
    }
    let text = std::fs::read_to_string(Path::new(GRAPHS).join("doll.ron")).expect("the graph");
    let levels = format!("\"levels\": Integer(default: {levels}");
    Watch::start(folder, &text.replace("\"levels\": Integer(default: 1", &levels))
}

/// Returns the milliseconds since 1970. The clock of the page has the same origin.
fn now() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).expect("a clock");
    since.as_secs_f64() * 1e3
}

/// Opens the page of a watch, selects a node in it, and installs an observer that records when each value is drawn.
fn open(browser: &mut Browser, watch: &Watch, node: &str) {
    browser.open("about:blank");
    browser.open(&watch.link);
    browser.wait("document.querySelector('canvas[tabindex]')?.dataset.shown");
    browser.ask(&format!(
        "document.querySelector('svg .node[aria-label^=\"{node},\"]').dispatchEvent(new MouseEvent('click'))"
    ));
    let value = format!("document.querySelector('.caption').textContent.startsWith('{node}.')");
    browser.wait(&value);
    browser.wait("performance.getEntriesByName('value').length > 0");
    browser.ask(
        "(() => { const canvas = document.querySelector('canvas[tabindex]'); window.drawn = []; \
         let last = canvas.dataset.shown; new MutationObserver(() => { if (canvas.dataset.shown === last) return; \
         last = canvas.dataset.shown; requestAnimationFrame(() => drawn.push([performance.timeOrigin + performance.now(), \
         last])); }).observe(canvas, { attributeFilter: ['data-shown'] }); })()",
    );
}

/// Waits until more than `before` values have been drawn, and returns the time at which the next one was drawn.
fn next_drawn(browser: &mut Browser, before: usize) -> f64 {
    browser.wait(&format!("drawn.length > {before}"));
    browser.ask(&format!("drawn[{before}][0]")).as_f64().expect("a time")
}

fn count_drawn(browser: &mut Browser) -> usize {
    browser.ask("drawn.length").as_u64().expect("a number") as usize
}

fn small(browser: &mut Browser) {
    let mut watch = sheet(101);
    open(browser, &watch, "turned");
    let mut saves = Vec::new();
    for k in 0..40 {
        let before = count_drawn(browser);
        let saved = now();
        watch.save(&watch.with_default(f64::from(k) + 0.5));
        saves.push(next_drawn(browser, before) - saved);
    }
    say_times("from a save to other pixels, 20 000 triangles", saves);
    let mut drags = Vec::new();
    for k in 0..40 {
        let before = count_drawn(browser);
        let moved = slide(browser, 100 + 5 * k);
        drags.push(next_drawn(browser, before) - moved);
    }
    say_times("from a move of a slider to its picture, 20 000 triangles", drags);
    browser.ask("document.querySelector('.parameter input[type=range]').dispatchEvent(new KeyboardEvent('keydown', { key: 'Escape' }))");
    memory(browser, &mut watch);
}

/// Moves the slider of the first parameter, and returns the time at which it was moved.
fn slide(browser: &mut Browser, value: u32) -> f64 {
    let moved = browser.ask(&format!(
        "(() => {{ const slider = document.querySelector('.parameter input[type=range]'); \
         slider.value = {value}; slider.dispatchEvent(new Event('input')); \
         return performance.timeOrigin + performance.now(); }})()"
    ));
    moved.as_f64().expect("a time")
}

/// Measures the memory before and after 500 edits. 300 edits come first, so that the page already keeps as much data as it may. The program
/// itself reaches its limit a little later.
fn memory(browser: &mut Browser, watch: &mut Watch) {
    fn heap_size(browser: &mut Browser) -> [f64; 2] {
        browser.call("HeapProfiler.collectGarbage", json!({}));
        let page = browser.call("Runtime.getHeapUsage", json!({}));
        ["usedSize", "backingStorageSize"].map(|part| page[part].as_f64().unwrap_or_default() / 1e6)
    }
    fn edits(browser: &mut Browser, watch: &mut Watch, from: usize, to: usize) {
        for k in from..to {
            let before = count_drawn(browser);
            watch.save(&watch.with_default(100.0 + k as f64));
            next_drawn(browser, before);
        }
    }
    edits(browser, watch, 0, 300);
    let (page, program) = (heap_size(browser), watch.memory());
    edits(browser, watch, 300, 800);
    let (page_after, program_after) = (heap_size(browser), watch.memory());
    say(&format!(
        "memory before and after 500 edits: page {:.1} and {:.1} MB of objects, {:.1} and {:.1} MB of buffers, program {program:.0} and \
         {program_after:.0} MB",
        page[0], page_after[0], page[1], page_after[1]
    ));
}

fn large(browser: &mut Browser) {
    let watch = sheet(867);
    open(browser, &watch, "turned");
    let mut times = Vec::new();
    let mut bytes = 0.0;
    for k in 0..12 {
        wait_for_drawing(browser);
        let before = count_drawn(browser);
        watch.save(&watch.with_default(f64::from(k) + 0.5));
        next_drawn(browser, before);
        let [duration, sent] = last_value(browser);
        times.push(duration);
        bytes = sent;
    }
    say_times("from the message to the buffers, 1.5 million triangles that moved", times);
    say(&format!("for which {:.1} MB were sent", bytes / 1e6));
}

/// Waits until drawing has finished. Without a graphics card that takes seconds for large values, which the measurement must not include.
fn wait_for_drawing(browser: &mut Browser) {
    browser.ask(
        "document.querySelector('canvas[tabindex]').getContext('webgl2').readPixels(0, 0, 1, 1, 6408, 5121, new Uint8Array(4))",
    );
}

fn local(browser: &mut Browser) {
    let watch = doll(1);
    open(browser, &watch, "model");
    let bytes = "performance.getEntriesByName('value')[0].detail.bytes";
    let all = "performance.getEntriesByType('resource').filter((it) => it.name.includes('/column/')).reduce((sum, it) => sum + \
               it.encodedBodySize, 0)";
    let all = browser.ask(all).as_f64().expect("a number");
    let before = count_drawn(browser);
    watch.save(&watch.with_default(13.0));
    next_drawn(browser, before);
    let moved = browser.ask(bytes).as_f64().expect("a number");
    let share = 100.0 * moved / all;
    say(&format!(
        "another nose of the doll: {:.2} of {:.2} MB, {share:.1} %",
        moved / 1e6,
        all / 1e6
    ));
}

/// Returns two numbers about the last drawn value: the milliseconds from its message until its data is in the buffers of the graphics card,
/// and the number of received bytes.
fn last_value(browser: &mut Browser) -> [f64; 2] {
    let measure = "(() => { const [it] = performance.getEntriesByName('value'); \
                   return [it.duration, it.detail.bytes]; })()";
    let measured = browser.ask(measure);
    [0, 1].map(|k| measured[k].as_f64().expect("a number"))
}

/// Measures when a page is told that the nose of the example doll grows, under four levels of subdivision. The page does not draw, because
/// drawing without a graphics card would occupy all cores.
fn measure_messages() {
    let watch = doll(4);
    let mut page = Page::open(&watch);
    page.say(&json!({ "ask": "views", "views": [{ "node": "model", "output": "mesh" }] }));
    page.next_value();
    let saves = page
        .times(|_: &mut Page, k: u32| watch.save(&watch.with_default(13.0 + 0.5 * f64::from(k))));
    say_times("another nose of 10.8 million triangles, from the save to the message", saves);
    let drags = page.times(|page, k| {
        let value = format!("{:.2}", 20.25 + 0.5 * f64::from(k));
        page.say(&json!({ "ask": "drag", "values": [["growth", value]] }));
    });
    say_times("from a move of a slider to its message", drags);
}

/// Measures the growing nose of the doll, with 10.8 million triangles, in a browser that draws it.
fn ten_million(browser: &mut Browser) {
    let watch = doll(4);
    let start = now();
    open(browser, &watch, "model");
    say(&format!("10.8 million triangles opened after {:.1} s", (now() - start) / 1e3));
    let (mut copied, mut bytes) = (Vec::new(), 0.0);
    for k in 0..3 {
        wait_for_drawing(browser);
        let before = count_drawn(browser);
        watch.save(&watch.with_default(13.0 + f64::from(k)));
        next_drawn(browser, before);
        let [duration, sent] = last_value(browser);
        copied.push(duration);
        bytes = sent;
    }
    say_times("from that message to the buffers", copied);
    let (moved, held) = (bytes / 1e6, watch.memory());
    say(&format!("for which {moved:.1} MB were sent; the program holds {held:.0} MB"));
}

fn tabs(browser: &mut Browser) {
    let watch = doll(1);
    let tabs: Vec<_> = (0..8)
        .map(|_| {
            let tab = browser.add_tab();
            open(browser, &watch, "raised");
            (tab, count_drawn(browser))
        })
        .collect();
    let saved = now();
    watch.save(&watch.with_default(14.0));
    let shown = tabs.iter().map(|(tab, before)| {
        browser.go_to(tab);
        next_drawn(browser, *before)
    });
    let last = shown.fold(0.0, f64::max);
    say(&format!("from a save to the pixels of eight pages: {:.0} ms", last - saved));
}

/// The WebSocket of a page, without a browser.
struct Page(WebSocket<TcpStream>);

impl Page {
    fn open(watch: &Watch) -> Self {
        let place = watch.link.strip_prefix("http://").expect("a link");
        let (host, token) = place.split_once("/#").expect("a token");
        let mut request = format!("ws://{host}/socket").into_client_request().expect("an address");
        for (name, value) in [
            ("Origin", format!("http://{host}")),
            ("Sec-WebSocket-Protocol", format!("maquette, {token}")),
        ] {
            request.headers_mut().insert(name, value.parse().expect("visible letters"));
        }
        let stream = TcpStream::connect(host).expect("a connection");
        Self(tungstenite::client(request, stream).expect("a socket").0)
    }

    fn say(&mut self, wish: &Json) {
        self.0.send(Message::Text(wish.to_string().into())).expect("somebody hears it");
    }

    /// Calls `change` several times. Returns the milliseconds from each change to the next message with a value.
    fn times(&mut self, change: impl Fn(&mut Self, u32)) -> Vec<f64> {
        (0..11)
            .map(|k| {
                // Wait until nothing of the last edit is being written.
                std::thread::sleep(Duration::from_secs(1));
                let start = now();
                change(self, k);
                self.next_value();
                now() - start
            })
            .collect::<Vec<_>>()
    }

    /// Waits for the next message with a value.
    fn next_value(&mut self) {
        loop {
            if let Message::Text(text) = self.0.read().expect("a message")
                && text.contains("\"event\":\"value\"")
            {
                return;
            }
        }
    }
}

/// A running watch that serves a live page.
struct Watch {
    folder: tempfile::TempDir,
    text: String,
    process: Child,
    link: String,
}

impl Watch {
    fn start(folder: tempfile::TempDir, text: &str) -> Self {
        std::fs::write(folder.path().join("graph.ron"), text).expect("a file");
        let mut process = Command::new(env!("CARGO_BIN_EXE_maquette"))
            .args(["watch", "graph.ron", "--events", "--threads", "2", "--preview"])
            .current_dir(folder.path())
            .env("MAQUETTE_CACHE", folder.path().join("cache"))
            .env("XDG_STATE_HOME", folder.path().join("state"))
            .stdout(Stdio::piped())
            .spawn()
            .expect("the program runs");
        let mut events = BufReader::new(process.stdout.take().expect("its stdout")).lines();
        let mut link = String::new();
        for line in events.by_ref().map_while(Result::ok) {
            let event: Json = serde_json::from_str(&line).expect("an event");
            if event["event"] == "page" {
                event["link"].as_str().expect("a link").clone_into(&mut link);
            }
            if event["event"] == "done" {
                break;
            }
        }
        std::thread::spawn(move || events.for_each(drop));
        Self { folder, text: text.to_owned(), process, link }
    }

    /// Saves the graph as most editors do: writes a new file and renames it.
    fn save(&self, text: &str) {
        let graph = self.folder.path().join("graph.ron");
        let temporary = graph.with_extension("new");
        std::fs::write(&temporary, text).expect("a file");
        std::fs::rename(temporary, graph).expect("a save");
    }

    /// Returns the text of the graph in which the parameter has this default value.
    fn with_default(&self, value: f64) -> String {
        self.text.replace("default: 12.0", &format!("default: {value:.2}"))
    }

    /// Returns the resident memory of the program in megabytes.
    fn memory(&self) -> f64 {
        let path = format!("/proc/{}/status", self.process.id());
        let status = std::fs::read_to_string(path).unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap_or_default();
        let number = line.split_whitespace().next().and_then(|number| number.parse().ok());
        number.map_or(f64::NAN, |kilobytes: f64| kilobytes / 1e3)
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
