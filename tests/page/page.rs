//! Tests of the live page in a real browser.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

use serde_json::json;

use crate::browser::Browser;
use crate::preview::Server;
use crate::project::Project;

/// Opens a page of the example graph `doll.ron` and waits until it shows a value. Returns `None` without a browser.
fn doll() -> Option<(Project, Server, Browser)> {
    let mut browser = Browser::start()?;
    let project = Project::doll();
    let mut served = Server::new(&project);
    served.watch.run_until_ok();
    browser.open(&served.link());
    browser.wait(SEEN);
    Some((project, served, browser))
}

/// A JavaScript expression for the hash of the value that the page draws; undefined if it draws none.
const SEEN: &str = "document.querySelector('.frame canvas')?.dataset.shown";

const CAPTION: &str = "document.querySelector('.caption').textContent";

#[test]
fn a_page_shows_the_graph_and_its_last_node_and_keeps_to_itself() {
    let Some((_project, served, mut browser)) = doll() else { return };
    assert_eq!(browser.ask("document.title"), "doll.ron - maquette");
    assert_eq!(browser.ask("document.querySelector('#link').textContent"), "live");
    let boxes = browser.ask("document.querySelectorAll('svg .node').length").as_u64().unwrap();
    assert!(boxes > 15, "{boxes}");
    let address = browser.ask("location.href");
    let address = address.as_str().unwrap().to_owned();
    assert!(!address.contains(&served.token) && address.contains("view=model"), "{address}");
    let asked = "performance.getEntriesByType('resource').every((it) => new URL(it.name).origin === location.origin)";
    assert_eq!(browser.ask(asked), true);
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

#[test]
fn a_value_is_typed_seen_and_taken_back() {
    let Some((project, mut served, mut browser)) = doll() else { return };
    let before = std::fs::read_to_string(project.graph()).unwrap();
    let old = browser.ask(SEEN);
    browser.write("#parameter-growth", "20");
    // The wheel over a focused field scrolls the page and does not change the number.
    let wheel = "(() => { const field = document.querySelector('#parameter-growth'); const event = \
                 new WheelEvent('wheel', { deltaY: 100, cancelable: true, bubbles: true }); field.dispatchEvent(event); \
                 return [field.value, event.defaultPrevented].join(); })()";
    assert_eq!(browser.ask(wheel), "20,true");
    browser.press("Enter", 0);
    browser.wait(&format!("{SEEN} !== {old}"));
    let after = std::fs::read_to_string(project.graph()).unwrap();
    assert_eq!(after, before.replace("default: 12.0", "default: 20"));
    browser.wait("document.querySelector('.parameter input[type=range]').value === '20'");
    browser.ask("document.activeElement.blur()");
    browser.press("z", 2);
    browser.wait("document.querySelector('#parameter-growth').value === '12'");
    assert_eq!(std::fs::read_to_string(project.graph()).unwrap(), before);
    browser.wait(&format!("{SEEN} === {old}"));
    // Text that is being typed stays while the file changes, and Escape can still discard it.
    browser.write("#parameter-growth", "33");
    project.save(&project.doll_text(14.0));
    browser.wait("document.querySelector('.caption').textContent.endsWith('run 4')");
    assert_eq!(browser.ask("document.querySelector('#parameter-growth').value"), "33");
    browser.press("Escape", 0);
    assert_eq!(browser.ask("document.querySelector('#parameter-growth').value"), "14");
    served.watch.end();
}

#[test]
fn a_page_opened_during_an_error_shows_it_and_the_last_good_value() {
    let Some((project, served, mut browser)) = doll() else { return };
    project.save(&project.doll_text(12.0).replace("Nurbs(", "Nurb("));
    browser.wait("document.querySelector('#problems [data-severity=error]')");
    browser.wait(&format!("{CAPTION}.includes('behind')"));
    let first = browser.ask(SEEN);
    browser.open("about:blank");
    browser.open(&served.link());
    browser.wait("document.querySelector('#problems [data-severity=error]')");
    assert_eq!(browser.ask("document.querySelector('#run').dataset.state"), "failed");
    let text = browser.ask("document.querySelector('#problems').textContent");
    assert!(text.as_str().unwrap().contains("doll.ron:"), "{text}");
    browser.wait(&format!("{SEEN} === {first}"));
}

#[test]
fn the_camera_stays_and_the_address_brings_it_back() {
    let Some((project, mut served, mut browser)) = doll() else { return };
    browser.ask("document.querySelector('.frame canvas').focus()");
    browser.press("ArrowRight", 0);
    browser.press("ArrowRight", 0);
    browser.wait("location.hash.includes('camera=30,0,1')");
    project.save(&project.doll_text(16.0));
    browser.wait(&format!("{CAPTION}.endsWith('run 2')"));
    let address = browser.ask("location.href");
    browser.reload();
    browser.wait(SEEN);
    assert_eq!(browser.ask("location.href"), address);
    served.watch.end();
}

#[test]
fn all_is_there_without_a_mouse() {
    let Some((_project, _served, mut browser)) = doll() else { return };
    browser.ask("document.querySelector('svg .node[aria-label^=\"nose,\"]').focus()");
    browser.press("Enter", 0);
    browser.wait(&format!("{CAPTION}.startsWith('nose.region of')"));
    let is_box = "document.activeElement.getAttribute('role') === 'button'";
    browser.press("Tab", 0);
    assert_eq!(browser.ask(is_box), true);
    browser.press("?", 0);
    browser.wait("document.querySelector('#help').open");
    for output in ["range", "color"] {
        browser.ask("document.querySelector('#help').close()");
        browser.ask("document.querySelector('svg .node[aria-label^=\"scan,\"]').focus()");
        browser.press("Enter", 0);
        let tab = format!(
            "[...document.querySelectorAll('.tabs button')].find((tab) => tab.textContent.startsWith('{output}:'))"
        );
        browser.wait(&tab);
        browser.ask(&format!("{tab}.click()"));
        browser.wait(&format!("{CAPTION}.startsWith('scan.{output} of')"));
        browser.wait(SEEN);
    }
}

const LIVE: &str = "document.querySelector('#link').dataset.state === 'live'";
const LOST: &str = "document.querySelector('#link').dataset.state === 'lost'";

#[test]
fn an_open_page_finds_a_watch_that_is_started_again() {
    let Some((project, mut served, mut browser)) = doll() else { return };
    browser.ask("document.querySelector('.frame [tabindex]').focus()");
    browser.press("ArrowRight", 0);
    browser.wait("location.hash.includes('camera=15,')");
    let address = browser.ask("location.href");
    browser.ask("window.before = 1");
    served.watch.end();
    browser.wait(LOST);
    let mut served = Server::new(&project);
    let back = browser.wait(LIVE);
    assert!(back < Duration::from_secs(2), "{back:?}");
    project.save(&project.doll_text(16.0));
    served.watch.run_until_ok();
    browser.wait(&format!("{CAPTION}.endsWith('run 2')"));
    assert_eq!(browser.ask("window.before"), 1);
    assert_eq!(browser.ask("location.href"), address);
    served.watch.end();
}

#[test]
fn a_page_that_is_looked_at_again_asks_at_once() {
    let Some((project, mut served, mut browser)) = doll() else { return };
    for event in ["new Event('online')", "new Event('visibilitychange', { bubbles: true })"] {
        // Without timers, only the event can make the page reconnect.
        browser.ask("window.setTimeout = () => 0");
        served.watch.end();
        browser.wait(LOST);
        served = Server::new(&project);
        std::thread::sleep(Duration::from_millis(1500));
        assert_eq!(browser.ask(LOST), true);
        browser.ask(&format!("document.dispatchEvent({event}), window.dispatchEvent({event}), 0"));
        let back = browser.wait(LIVE);
        assert!(back < Duration::from_secs(1), "{event}: {back:?}");
    }
}

#[test]
fn the_page_of_another_program_is_loaded_anew_once() {
    let Some((project, mut served, mut browser)) = doll() else { return };
    browser.ask("document.querySelector('.frame [tabindex]').focus()");
    browser.press("ArrowRight", 0);
    browser.wait("location.hash.includes('camera=15,')");
    let address = browser.ask("location.href");
    // Every newly loaded page claims to be from another program than the server, and counts how often it is loaded.
    let other = "document.addEventListener('readystatechange', () => { \
                 document.querySelector('meta[name=page]').content = 'other'; }, { once: true }); \
                 sessionStorage.loads = Number(sessionStorage.loads ?? 0) + 1;";
    browser.call("Page.enable", json!({}));
    browser.call("Page.addScriptToEvaluateOnNewDocument", json!({ "source": other }));
    browser.ask("document.querySelector('meta[name=page]').content = 'other', window.before = 1");
    served.watch.end();
    browser.wait(LOST);
    let mut served = Server::new(&project);
    browser.wait("window.before === undefined && document.readyState === 'complete'");
    browser.wait(SEEN);
    browser.wait(LIVE);
    assert_eq!(browser.ask("document.querySelector('meta[name=page]').content"), "other");
    assert_eq!(browser.ask("location.href"), address);
    // The server announces its program again, but the page is not loaded again.
    served.watch.end();
    browser.wait(LOST);
    let _served = Server::new(&project);
    browser.wait(LIVE);
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!(browser.ask("sessionStorage.loads"), "1");
}

#[cfg(target_os = "linux")]
#[test]
fn nodes_and_problems_are_opened_in_the_editor() {
    use crate::preview::link::{read_when_written, script};
    let Some(mut browser) = Browser::start() else { return };
    let project = Project::doll();
    let told = project.folder().join("told");
    let editor = script(&project, "code", "echo \"$2\" > told.new; mv told.new told\n");
    let text = std::fs::read_to_string(project.graph()).unwrap();
    let variable = [("MAQUETTE_EDITOR", editor.as_os_str())];
    let mut served = Server::start_with(&project, &["--preview"], &variable);
    served.watch.run_until_ok();
    browser.open(&served.link());
    browser.wait(SEEN);
    let line =
        |text: &str, words: &str| text.lines().position(|line| line.contains(words)).unwrap() + 1;
    fn assert_opened(line: usize, told: &std::path::Path, project: &Project) {
        let place = read_when_written(told);
        std::fs::remove_file(told).unwrap();
        let expected = format!("{}:{line}:", project.graph().display());
        assert!(place.starts_with(&expected), "{place} is not {expected}");
    }
    browser.ask("document.querySelector('svg .node[data-name=nose]').focus()");
    browser.press("e", 0);
    assert_opened(line(&text, "ExtractRegion("), &told, &project);
    browser.press("Enter", 0);
    let button = "document.querySelector('#node button.place')";
    let said = format!("doll.ron:{}", line(&text, "ExtractRegion("));
    browser.wait(&format!("{button}.textContent === '{said}'"));
    browser.ask(&format!("{button}.click()"));
    assert_opened(line(&text, "ExtractRegion("), &told, &project);
    let broken = text.replace("Nurbs(", "Nurb(");
    project.save(&broken);
    browser.wait("document.querySelector('#problems button.place')");
    browser.ask("document.querySelector('#problems button.place').click()");
    assert_opened(line(&broken, "Nurb("), &told, &project);
    browser.ask("document.activeElement.blur()");
    browser.press("?", 0);
    let help = browser.ask("document.querySelector('#help').textContent");
    assert!(help.as_str().unwrap().contains("editor"), "{help}");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

#[test]
fn boxes_are_colored_by_state_time_or_bytes() {
    let Some((_project, _served, mut browser)) = doll() else { return };
    fn choose(browser: &mut Browser, what: &str) {
        browser.ask(&format!(
            "(() => {{ const select = document.querySelector('#profile'); select.value = '{what}'; \
             select.dispatchEvent(new Event('change')); }})()"
        ));
    }
    // The fill colors of the nodes' boxes, and the contrast of their texts. Colors are given as `color(srgb r g b)` from 0 to 1 or as
    // `rgb(r, g, b)`.
    let fills = "(() => { const read = (text) => { const parts = text.match(/[\\d.]+/g).map(Number); \
                 return text.startsWith('rgb') ? parts.map((part) => part / 255) : parts; }; \
                 const light = (rgb) => { const [r, g, b] = rgb.map((c) => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4); \
                 return 0.2126 * r + 0.7152 * g + 0.0722 * b; }; \
                 return [...document.querySelectorAll('svg .node:has(.state)')].map((node) => { \
                 const fill = read(getComputedStyle(node.querySelector('.body')).fill).slice(0, 3); \
                 const contrasts = [...node.querySelectorAll('.name, .kind, .port')].map((text) => { \
                 const [a, b] = [light(fill), light(read(getComputedStyle(text).fill).slice(0, 3))]; \
                 return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05); }); \
                 return { name: node.dataset.name, fill: fill.map((c) => c.toFixed(3)).join(), contrast: Math.min(...contrasts) }; }); })()";
    fn colors(browser: &mut Browser, fills: &str) -> (std::collections::BTreeSet<String>, f64) {
        let told = browser.ask(fills);
        let boxes = told.as_array().unwrap().iter();
        let fills = boxes.clone().map(|it| it["fill"].as_str().unwrap().to_owned());
        let least = boxes.map(|it| it["contrast"].as_f64().unwrap()).fold(f64::MAX, f64::min);
        (std::collections::BTreeSet::from_iter(fills), least)
    }
    // Viewing a node is not a run: the times shown are still those of the last run.
    browser.ask("document.querySelector('svg .node[data-name=grid]').focus()");
    browser.press("Enter", 0);
    browser.wait(&format!("{CAPTION}.startsWith('grid.mesh of')"));
    let state = "document.querySelector('svg .node[data-name=grid]').dataset.state";
    assert_eq!(browser.ask(state), "computed");
    for scheme in ["light", "dark"] {
        let media = json!({ "features": [{ "name": "prefers-color-scheme", "value": scheme }] });
        browser.call("Emulation.setEmulatedMedia", media);
        choose(&mut browser, "state");
        assert_eq!(colors(&mut browser, fills).0.len(), 1);
        assert_eq!(browser.ask("document.querySelector('#legend').hidden"), true);
        for what in ["time", "bytes"] {
            choose(&mut browser, what);
            let (fills, contrast) = colors(&mut browser, fills);
            // On a busy machine, one node may take nearly all of the time. All other nodes then have similar colors, so fewer colors are
            // required.
            let least = if what == "time" { 2 } else { 4 };
            assert!(fills.len() >= least, "{scheme}, {what}: {fills:?}");
            assert!(contrast > 4.5, "{scheme}, {what}: {contrast}");
        }
    }
    // The node with the largest value has the strongest color and is named in the legend.
    let shares = "Object.fromEntries([...document.querySelectorAll('svg .node:has(.state)')].map((node) => \
                  [node.dataset.name, parseFloat(node.style.getPropertyValue('--share'))]))";
    let shares = browser.ask(shares);
    let shares = shares.as_object().unwrap();
    let most = shares.iter().find(|(_, share)| share.as_f64() == Some(100.0)).unwrap().0;
    let legend = browser.ask("document.querySelector('#legend').textContent");
    let legend = legend.as_str().unwrap();
    assert!(legend.starts_with("most: ") && legend.ends_with(&format!("B, {most}")), "{legend}");
    // The panel of the selected node shows this value, too, and the reason why the node ran.
    browser.ask(&format!("document.querySelector('svg .node[data-name=\"{most}\"]').focus()"));
    browser.press("Enter", 0);
    let panel = browser.ask("document.querySelector('#node').innerText");
    let panel = panel.as_str().unwrap();
    let size = legend.strip_prefix("most: ").unwrap().split(',').next().unwrap();
    assert!(panel.contains(size) && panel.contains("not computed before"), "{panel}");
    // The selected coloring survives a reload.
    browser.reload();
    browser.wait(SEEN);
    browser.wait("document.querySelector('#profile').value === 'bytes'");
    browser.wait("document.querySelector('#legend').textContent.startsWith('most: ')");
}

#[test]
fn a_graph_that_is_used_is_measured_as_a_whole() {
    let Some(mut browser) = Browser::start() else { return };
    let part = "Graph(format: 1, inputs: { \"mesh\": Mesh }, nodes: { \"a\": Transform(mesh: \"mesh\"), \
                \"b\": Subdivide(mesh: \"a\", scheme: CatmullClark, levels: 1) }, outputs: { \"mesh\": \"b\" })";
    let whole = "Graph(format: 1, use: { \"Part\": \"part.ron\" }, nodes: { \"net\": PointNet(points: [[(0, 0, 0), (1, 0, 1), \
                 (2, 0, 0)], [(0, 1, 1), (1, 1, 2), (2, 1, 1)], [(0, 2, 0), (1, 2, 1), (2, 2, 0)]]), \"surface\": \
                 Nurbs(net: \"net\"), \"coarse\": Tessellate(surface: \"surface\", u: 20, v: 20),\n\"used\": \
                 Part(mesh: \"coarse\") }, outputs: { \"m.ply\": \"used\" })";
    let project = Project::new("");
    std::fs::write(project.folder().join("part.ron"), part).unwrap();
    project.save(whole);
    let mut served = Server::new(&project);
    let run = served.watch.run_until_ok();
    let nodes = run.done["nodes"].as_array().unwrap().iter();
    let inside = nodes.filter(|node| node["name"].as_str().unwrap().starts_with("used/"));
    let bytes: u64 = inside.map(|node| node["bytes"].as_u64().unwrap()).sum();
    assert!(bytes > 1_000);
    browser.open(&served.link());
    browser.wait("document.querySelector('svg .node[data-name=used]')");
    browser.ask("document.querySelector('svg .node[data-name=used]').focus()");
    browser.press("Enter", 0);
    let size = format!("{:.1} kB", bytes as f64 / 1e3);
    browser.wait(&format!("document.querySelector('#node').innerText.includes('{size}')"));
    browser
        .wait("document.querySelector('#node').innerText.includes('used/a: not computed before')");
    browser.wait("document.querySelector('#node button.place').textContent === 'doll.ron:2'");
}

#[test]
fn a_name_that_is_bound_to_this_machine_and_a_foreign_page_are_told_nothing() {
    let project = Project::doll();
    let mut served = Server::new(&project);
    served.watch.run_until_ok();
    let resolver = "--host-resolver-rules=MAP evil.example 127.0.0.1";
    // The browser connects directly, without a proxy or an attempt to use TLS.
    let plain = ["--no-proxy-server", "--disable-features=HttpsUpgrades,HttpsFirstBalancedMode"];
    let Some(mut browser) = Browser::start_with(&[resolver, plain[0], plain[1]]) else { return };
    let port = served.host.rsplit(':').next().unwrap();
    browser.open(&format!("http://evil.example:{port}/"));
    browser.wait("location.host.startsWith('evil.example') && document.readyState === 'complete'");
    let status = "performance.getEntriesByType('navigation')[0].responseStatus";
    assert_eq!(browser.ask(status), 403);
    let text = browser.ask("document.body.innerText");
    assert!(text.as_str().unwrap().contains("only served to this machine"), "{text}");
    // A page of another site may do whatever browsers allow, and even knows the token.
    let foreign = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = foreign.local_addr().unwrap();
    // Each connection has a thread, because a browser opens connections that it may never use.
    fn answer(mut stream: TcpStream) {
        let _ = stream.read(&mut [0; 4096]);
        let page = "<!doctype html><title>foreign</title>";
        let head = "HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nConnection: close\r\n";
        let _ = write!(stream, "{head}Content-Length: {}\r\n\r\n{page}", page.len());
    }
    std::thread::spawn(move || {
        for stream in foreign.incoming().flatten() {
            std::thread::spawn(move || answer(stream));
        }
    });
    fn socket(host: &str, token: &str) -> String {
        format!(
            "new Promise((told) => {{ const socket = new WebSocket('ws://{host}/socket', ['maquette', '{token}']); \
             socket.onopen = () => told('open'); socket.onerror = () => told('refused'); }})"
        )
    }
    for host in [format!("evil.example:{}", address.port()), address.to_string()] {
        browser.open(&format!("http://{host}/"));
        browser.wait("document.title === 'foreign'");
        browser.wait(&format!("location.host === '{host}'"));
        for to in [served.host.clone(), format!("evil.example:{port}")] {
            assert_eq!(browser.ask(&socket(&to, &served.token)), "refused", "{host} to {to}");
            let read =
                format!("fetch('http://{to}/page.js').then((it) => it.text(), () => 'refused')");
            assert_eq!(browser.ask(&read), "refused", "{host} to {to}");
            let unread = format!(
                "fetch('http://{to}/page.js', {{ mode: 'no-cors' }}).then(() => 'read', () => 'refused')"
            );
            assert_eq!(browser.ask(&unread), "refused", "{host} to {to}");
        }
    }
    // The server's own page can open a socket to the same address. So the attempts above were refused because of their origin.
    browser.open(&served.link());
    browser.wait(SEEN);
    assert_eq!(browser.ask(&socket(&served.host, &served.token)), "open");
}
