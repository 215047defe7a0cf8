//! Interaction with the live page in a real browser that draws without a graphics card: dragging, typing, pointing and picking.

use serde_json::{Value as Json, json};

use crate::browser::Browser;
use crate::preview::{Server, mesh_of};
use crate::project::Project;

mod picking;

/// A JavaScript expression for the hash of the value that the page draws.
const SHOWN: &str = "document.querySelector('canvas[tabindex]').dataset.shown";

const CAPTION: &str = "document.querySelector('.caption').textContent";

const PROBE: &str = "document.querySelector('.probe').textContent";

const FIELD: &str = "document.querySelector('#parameter-growth').value";

const SLIDER: &str = "input[aria-label=growth]";

/// A JavaScript expression that is true while the page shows a dragged value that is not saved yet.
const LIVE: &str = "document.querySelector('.caption').textContent.includes('not in the file yet')";

/// Opens a page of the example graph `doll.ron` and waits until its last node is drawn. Returns `None` without a browser.
fn doll() -> Option<(Project, Server, Browser)> {
    let project = Project::doll();
    let text = project.doll_text(12.0);
    page(project, &text)
}

/// Opens a page of a graph with this text and waits until its last node is drawn.
fn page(project: Project, text: &str) -> Option<(Project, Server, Browser)> {
    let mut browser = Browser::start()?;
    project.save(text);
    let mut served = Server::new(&project);
    served.watch.run_until_ok();
    browser.open(&served.link());
    browser.wait(&format!("document.querySelector('canvas[tabindex]') && {SHOWN}"));
    Some((project, served, browser))
}

fn file(project: &Project) -> String {
    std::fs::read_to_string(project.graph()).unwrap()
}

/// Selects an output of a node and waits until it is drawn.
fn look(browser: &mut Browser, node: &str, output: &str) {
    let block = format!("document.querySelector('svg .node[aria-label^=\"{node},\"]')");
    browser.ask(&format!("{block}.dispatchEvent(new MouseEvent('click'))"));
    let tab = format!(
        "[...document.querySelectorAll('.tabs button')].find((tab) => tab.textContent.startsWith('{output}:'))"
    );
    browser.wait(&tab);
    // Clears the hash, so only a new drawing counts.
    browser.ask(&format!("{tab}.click(), {SHOWN} = ''"));
    browser.wait(&format!("{CAPTION}.startsWith('{node}.{output} of') && {SHOWN}"));
}

/// Scrolls an element into view and returns its left, top, width and height.
fn area(browser: &mut Browser, selector: &str) -> [f64; 4] {
    let area = browser.ask(&format!(
        "(() => {{ const place = document.querySelector('{selector}'); place.scrollIntoView({{ block: 'nearest' }}); \
         const {{ x, y, width, height }} = place.getBoundingClientRect(); return [x, y, width, height]; }})()"
    ));
    serde_json::from_value(area).unwrap()
}

/// Sends a mouse event. The kind `Dragged` is a move with the button down.
fn mouse(browser: &mut Browser, kind: &str, [x, y]: [f64; 2]) {
    let (button, buttons) = match kind {
        "Moved" => ("none", 0),
        "Dragged" => ("left", 1),
        "Pressed" => ("left", 1),
        _ => ("left", 0),
    };
    let kind = if kind == "Dragged" { "Moved" } else { kind };
    let event = json!({ "type": format!("mouse{kind}"), "x": x, "y": y, "button": button, "buttons": buttons, "clickCount": 1 });
    browser.call("Input.dispatchMouseEvent", event);
}

fn click(browser: &mut Browser, place: [f64; 2]) {
    for kind in ["Moved", "Pressed", "Released"] {
        mouse(browser, kind, place);
    }
}

/// Returns the center of the slider's thumb, which is 16 pixels wide.
fn thumb(browser: &mut Browser) -> [f64; 2] {
    let [left, top, width, height] = area(browser, SLIDER);
    let share = browser.ask(&format!("document.querySelector('{SLIDER}').value / 40"));
    [left + 8.0 + (width - 16.0) * share.as_f64().unwrap(), top + height / 2.0]
}

/// Records the hash of every value that is drawn from now on.
fn note(browser: &mut Browser) {
    browser.ask(
        "(() => { const canvas = document.querySelector('canvas[tabindex]'); window.seen = []; \
         new MutationObserver(() => canvas.dataset.shown !== seen.at(-1) && seen.push(canvas.dataset.shown)) \
         .observe(canvas, { attributeFilter: ['data-shown'] }); })()",
    );
}

/// Returns a JavaScript expression that is true if the page shows the saved value with this hash, and no dragged value.
fn at_rest(hash: &Json) -> String {
    format!("{SHOWN} === {hash} && !{LIVE}")
}

#[test]
fn a_slider_is_dragged_by_the_mouse_and_the_file_waits_until_it_is_let_go() {
    let Some((project, mut served, mut browser)) = doll() else { return };
    let before = file(&project);
    let first = browser.ask(SHOWN);
    note(&mut browser);
    let [mut x, y] = thumb(&mut browser);
    mouse(&mut browser, "Pressed", [x, y]);
    let (mut step, start) = (1.0, x);
    while browser.ask("seen.length >= 3") != true {
        x += step;
        if (x - start).abs() > 15.0 {
            step = -step;
        }
        mouse(&mut browser, "Dragged", [x, y]);
        assert_eq!(file(&project), before);
    }
    assert_eq!(browser.ask(LIVE), true);
    // During a drag, the mouse may leave the slider.
    mouse(&mut browser, "Dragged", [start + 20.0, y + 200.0]);
    let value = browser.ask(FIELD);
    let value = value.as_str().unwrap();
    assert_eq!(browser.ask(&format!("document.querySelector('{SLIDER}').value")), value);
    let last = json!(project.hash("model.mesh", &[&format!("growth={value}")]));
    browser.wait(&format!("{SHOWN} === {last} && {LIVE}"));
    assert_eq!(file(&project), before);
    mouse(&mut browser, "Released", [start + 20.0, y + 200.0]);
    let run = served.watch.run_until_ok();
    assert_eq!(run.done["computed"], 0, "{run:?}");
    assert_eq!(file(&project), before.replace("default: 12.0", &format!("default: {value}")));
    browser.wait(&at_rest(&last));
    browser.press("z", 2);
    browser.wait(&at_rest(&first));
    assert_eq!(file(&project), before);
    browser.wait(&format!("{FIELD} === '12' && document.querySelector('{SLIDER}').value === '12'"));
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
    served.watch.end();
}

#[test]
fn a_drag_is_given_up_with_escape_and_ends_where_it_began() {
    let Some((project, mut served, mut browser)) = doll() else { return };
    look(&mut browser, "raised", "net");
    let before = file(&project);
    let first = browser.ask(SHOWN);
    let [x, y] = thumb(&mut browser);
    mouse(&mut browser, "Pressed", [x, y]);
    mouse(&mut browser, "Dragged", [x + 20.0, y]);
    browser.wait(&format!("{LIVE} && {SHOWN} !== {first}"));
    browser.press("Escape", 0);
    browser.wait(&at_rest(&first));
    // A small movement before the button is released does not continue the cancelled drag.
    mouse(&mut browser, "Dragged", [x + 21.0, y]);
    mouse(&mut browser, "Released", [x + 21.0, y]);
    assert_eq!(
        browser.ask(&format!("[{FIELD}, document.querySelector('{SLIDER}').value].join()")),
        "12,12"
    );
    // A drag after the cancelled drag works normally. It ends at the value at which it began.
    mouse(&mut browser, "Pressed", [x, y]);
    let begun = browser.ask(FIELD);
    mouse(&mut browser, "Dragged", [x + 20.0, y]);
    browser.wait(&format!("{LIVE} && {SHOWN} !== {first}"));
    // Moves back to the start: a slider has fewer positions than values, so positions a fraction of a pixel apart are tried.
    let back = (0..24).map(|k| [x - 3.0 + 0.25 * f64::from(k), y]).find(|place| {
        mouse(&mut browser, "Dragged", *place);
        browser.ask(FIELD) == begun
    });
    mouse(&mut browser, "Released", back.unwrap());
    browser.wait(&at_rest(&first));
    assert_eq!(file(&project), before);
    // The drag has ended, so the save of another program does not conflict with it.
    project.save(&project.doll_text(14.0));
    browser.wait(&format!("{FIELD} === '14' && {SHOWN} !== {first} && !{LIVE}"));
    assert_eq!(browser.ask("document.querySelector('#refused').textContent"), "");
    served.watch.end();
}

#[test]
fn a_field_and_its_slider_agree_and_nothing_is_lost_while_somebody_types() {
    let Some((project, mut served, mut browser)) = doll() else { return };
    look(&mut browser, "raised", "net");
    let before = file(&project);
    let both = format!("[{FIELD}, document.querySelector('{SLIDER}').value].join()");
    fn says(growth: &str, before: &str) -> String {
        before.replace("default: 12.0", &format!("default: {growth}"))
    }
    let mut at = |browser: &mut Browser, growth: &str| {
        assert!(served.watch.run_until_ok().done["ok"] == true);
        assert_eq!(file(&project), says(growth, &before));
        browser.wait(&format!("{both} === '{growth},{growth}'"));
    };
    browser.write("#parameter-growth", "20.5");
    assert_eq!(browser.ask(&both), "20.5,20.6", "the slider has steps of 0.2");
    browser.press("Escape", 0);
    assert_eq!(browser.ask(&both), "12,12");
    browser.write("#parameter-growth", "20");
    browser.press("Enter", 0);
    at(&mut browser, "20");
    browser.press("ArrowUp", 0);
    at(&mut browser, "21");
    // The left end of the slider has the value 0, which the page must not treat as a missing value.
    let [x, y] = thumb(&mut browser);
    mouse(&mut browser, "Pressed", [x, y]);
    mouse(&mut browser, "Dragged", [x - 200.0, y]);
    mouse(&mut browser, "Released", [x - 200.0, y]);
    at(&mut browser, "0");
    browser.reload();
    browser.wait(&format!("document.querySelector('{SLIDER}') && {both} === '0,0'"));
    browser.write("#parameter-growth", "5");
    browser.press("Enter", 0);
    at(&mut browser, "5");
    browser.write("#parameter-growth", "0");
    browser.press("Enter", 0);
    at(&mut browser, "0");
    // An invalid value is refused with a message, and Escape restores the saved value.
    browser.write("#parameter-growth", "100");
    browser.press("Enter", 0);
    browser.wait("document.querySelector('#refused').textContent.includes('growth')");
    browser.press("Escape", 0);
    assert_eq!(browser.ask(&both), "0,0");
    assert_eq!(file(&project), says("0", &before));
    // A focused field and its slider follow changes of the file until the user types.
    project.save(&says("7", &before));
    at(&mut browser, "7");
    browser.write("#parameter-growth", "33");
    project.save(&says("8", &before));
    let run = served.watch.run_until_ok().number();
    browser.wait(&format!("{CAPTION}.endsWith('run {run}')"));
    assert_eq!(browser.ask(&both), "33,33");
    browser.press("Escape", 0);
    assert_eq!(browser.ask(&both), "8,8");
    served.watch.end();
}

/// A JavaScript expression for the number of bytes that the page received for the last value.
const MOVED: &str = "performance.getEntriesByName('value')[0].detail.bytes";

/// Returns a screenshot of the canvas.
fn pixels(browser: &mut Browser) -> Json {
    let [x, y, width, height] = area(browser, "canvas[tabindex]");
    // Waits for two frames; then the last drawing is on the screen.
    browser.ask(
        "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(0))))",
    );
    let clip = json!({ "x": x, "y": y, "width": width, "height": height, "scale": 1 });
    browser.call("Page.captureScreenshot", json!({ "clip": clip }))["data"].take()
}

#[test]
fn a_small_change_moves_few_bytes_and_a_change_that_is_taken_back_brings_the_same_pixels() {
    let Some((project, mut served, mut browser)) = doll() else { return };
    let all = browser.ask(MOVED).as_f64().unwrap();
    let (first, seen) = (browser.ask(SHOWN), pixels(&mut browser));
    project.save(&project.doll_text(13.0));
    browser.wait(&format!("{SHOWN} !== {first}"));
    let moved = browser.ask(MOVED).as_f64().unwrap();
    assert!(all > 1e5 && moved > 0.0 && moved <= 0.1 * all, "{moved} of {all} bytes");
    assert_ne!(pixels(&mut browser), seen);
    project.save(&project.doll_text(12.0));
    browser.wait(&at_rest(&first));
    assert_eq!(pixels(&mut browser), seen);
    served.watch.end();
}

/// Returns the number of columns in the page, their size in bytes, and the bytes of all objects and buffers of the page.
fn heap_size(browser: &mut Browser) -> [f64; 3] {
    let class = json!({ "expression": "import('/columns.js').then((it) => it.Columns.prototype)", "awaitPromise": true });
    let class = browser.call("Runtime.evaluate", class)["result"]["objectId"].take();
    let found = browser.call("Runtime.queryObjects", json!({ "prototypeObjectId": class }));
    let count = "function() { const all = this.flatMap((it) => [...it.all.values()]); \
                 return [all.length, all.reduce((sum, it) => sum + it.bytes.length, 0)]; }";
    let asked = json!({ "functionDeclaration": count, "objectId": found["objects"]["objectId"], "returnByValue": true });
    let counted = browser.call("Runtime.callFunctionOn", asked)["result"]["value"].take();
    browser.call("Runtime.releaseObject", json!({ "objectId": found["objects"]["objectId"] }));
    browser.call("HeapProfiler.collectGarbage", json!({}));
    let heap = browser.call("Runtime.getHeapUsage", json!({}));
    let bytes = heap["usedSize"].as_f64().unwrap() + heap["backingStorageSize"].as_f64().unwrap();
    [counted[0].as_f64().unwrap(), counted[1].as_f64().unwrap(), bytes]
}

#[test]
fn many_changes_leave_the_memory_of_the_page_where_it_was() {
    let Some((project, mut served, mut browser)) = doll() else { return };
    look(&mut browser, "grid", "mesh");
    fn edits(browser: &mut Browser, numbers: std::ops::Range<u32>, project: &Project) {
        for k in numbers {
            let before = browser.ask(SHOWN);
            project.save(&project.doll_text(2.0 + f64::from(k) / 2.0));
            browser.wait(&format!("{SHOWN} !== {before}"));
        }
    }
    edits(&mut browser, 0..5, &project);
    let [columns, bytes, heap] = heap_size(&mut browser);
    edits(&mut browser, 5..45, &project);
    let [columns_then, bytes_then, heap_then] = heap_size(&mut browser);
    assert_eq!((columns, bytes), (columns_then, bytes_then));
    assert!(heap_then < heap + 2e6, "{heap} bytes became {heap_then}");
    served.watch.end();
}

#[test]
fn keys_act_on_what_is_seen_before_anybody_has_clicked() {
    let Some((_project, mut served, mut browser)) = doll() else { return };
    fn is_pressed(browser: &mut Browser, label: &str) -> Json {
        browser.ask(&format!(
            "[...document.querySelectorAll('.tools button')].find((it) => it.textContent === '{label}').ariaPressed"
        ))
    }
    let side = "document.querySelector('.side').textContent";
    assert_eq!(browser.ask("document.activeElement === document.body"), true);
    browser.press("w", 0);
    assert_eq!(is_pressed(&mut browser, "edges"), "true");
    browser.press("ArrowRight", 0);
    browser.wait(&format!("{side} !== 'from the front'"));
    browser.press("0", 0);
    browser.wait(&format!("{side} === 'from the front'"));
    // If the focus is outside of the canvas, letter keys still act, but arrow keys scroll.
    browser.ask("document.querySelector('svg .node').focus()");
    browser.press("w", 0);
    browser.press("ArrowRight", 0);
    assert_eq!(is_pressed(&mut browser, "edges"), "false");
    assert_eq!(browser.ask(side), "from the front");
    // Letter keys do not act while the user types in a field or the help is open.
    browser.write("#parameter-growth", "5");
    browser.press("w", 0);
    assert_eq!(is_pressed(&mut browser, "edges"), "false");
    browser.press("Escape", 0);
    browser.ask("document.activeElement.blur()");
    browser.press("?", 0);
    browser.wait("document.querySelector('#help').open");
    browser.press("w", 0);
    assert_eq!(is_pressed(&mut browser, "edges"), "false");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
    served.watch.end();
}

#[test]
fn eight_tabs_follow_a_save() {
    let Some((project, mut served, mut browser)) = doll() else { return };
    let tabs: Vec<_> = (0..8).map(|_| browser.add_tab()).collect();
    for tab in &tabs {
        browser.go_to(tab);
        browser.open(&served.link());
        browser.wait(&format!("document.querySelector('canvas[tabindex]') && {SHOWN}"));
    }
    let first = browser.ask(SHOWN);
    project.save(&project.doll_text(14.0));
    served.watch.run_until_ok();
    let last = json!(project.hash("model.mesh", &[]));
    assert_ne!(first, last);
    for tab in &tabs {
        browser.go_to(tab);
        browser.wait(&at_rest(&last));
        assert_eq!(browser.ask("document.querySelector('#link').textContent"), "live");
    }
    // A change made in one tab is visible in all tabs.
    browser.write("#parameter-growth", "15");
    browser.press("Enter", 0);
    for tab in &tabs {
        browser.go_to(tab);
        browser.wait(&format!("{FIELD} === '15' && {SHOWN} !== {last}"));
    }
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
    served.watch.end();
}

#[test]
fn while_the_graph_is_broken_the_last_picture_says_how_many_runs_it_is_behind() {
    let Some((project, mut served, mut browser)) = doll() else { return };
    let (first, seen) = (browser.ask(SHOWN), pixels(&mut browser));
    for behind in 1..=3 {
        let broken = project.doll_text(12.0 + f64::from(behind)).replace("Nurbs(", "Nurb(");
        project.save(&broken);
        let words = format!("{behind} {} behind", if behind == 1 { "run" } else { "runs" });
        browser.wait(&format!("{CAPTION}.includes('{words}')"));
        assert_eq!(
            browser.ask("document.querySelector('.caption').dataset.behind"),
            behind.to_string()
        );
        assert_eq!((browser.ask(SHOWN), pixels(&mut browser)), (first.clone(), seen.clone()));
    }
    project.save(&project.doll_text(16.0));
    browser.wait(&format!("{SHOWN} !== {first} && !{CAPTION}.includes('behind')"));
    served.watch.end();
}
