//! What hands do on the live page: drag, type, point and pick, in a real browser that draws by itself.

use serde_json::{Value as Json, json};

use crate::browser::Browser;
use crate::preview::{Served, mesh_of};
use crate::project::Project;

mod picking;

/// The hash of what is drawn.
const SHOWN: &str = "document.querySelector('canvas[tabindex]').dataset.shown";

const CAPTION: &str = "document.querySelector('.caption').textContent";

const PROBE: &str = "document.querySelector('.probe').textContent";

const FIELD: &str = "document.querySelector('#parameter-growth').value";

const SLIDER: &str = "input[aria-label=growth]";

/// What is dragged is seen.
const LIVE: &str = "document.querySelector('.caption').textContent.includes('not in the file yet')";

/// A page of the doll that has drawn its last node; none without a browser.
fn doll() -> Option<(Project, Served, Browser)> {
    let project = Project::doll();
    let text = project.doll_text(12.0);
    page(project, &text)
}

/// The same of another graph.
fn page(project: Project, text: &str) -> Option<(Project, Served, Browser)> {
    let mut browser = Browser::start()?;
    project.save(text);
    let mut served = Served::new(&project);
    served.watch.run_until_ok();
    browser.open(&served.link());
    browser.wait(&format!("document.querySelector('canvas[tabindex]') && {SHOWN}"));
    Some((project, served, browser))
}

fn file(project: &Project) -> String {
    std::fs::read_to_string(project.graph()).unwrap()
}

/// Looks at an output of a node, and waits until it is drawn.
fn look(browser: &mut Browser, node: &str, output: &str) {
    let block = format!("document.querySelector('svg .node[aria-label^=\"{node},\"]')");
    browser.ask(&format!("{block}.dispatchEvent(new MouseEvent('click'))"));
    let tab = format!(
        "[...document.querySelectorAll('.tabs button')].find((tab) => tab.textContent.startsWith('{output}:'))"
    );
    browser.wait(&tab);
    // What was drawn before does not count.
    browser.ask(&format!("{tab}.click(), {SHOWN} = ''"));
    browser.wait(&format!("{CAPTION}.startsWith('{node}.{output} of') && {SHOWN}"));
}

/// Left, top, width and height of an element.
fn area(browser: &mut Browser, selector: &str) -> [f64; 4] {
    let area = browser.ask(&format!(
        "(() => {{ const place = document.querySelector('{selector}'); place.scrollIntoView({{ block: 'nearest' }}); \
         const {{ x, y, width, height }} = place.getBoundingClientRect(); return [x, y, width, height]; }})()"
    ));
    serde_json::from_value(area).unwrap()
}

/// The mouse, whose button may be down.
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

/// Where the thumb of the slider is, which is 16 pixels wide.
fn thumb(browser: &mut Browser) -> [f64; 2] {
    let [left, top, width, height] = area(browser, SLIDER);
    let share = browser.ask(&format!("document.querySelector('{SLIDER}').value / 40"));
    [left + 8.0 + (width - 16.0) * share.as_f64().unwrap(), top + height / 2.0]
}

/// Notes every value that is drawn from now on.
fn note(browser: &mut Browser) {
    browser.ask(
        "(() => { const canvas = document.querySelector('canvas[tabindex]'); window.seen = []; \
         new MutationObserver(() => canvas.dataset.shown !== seen.at(-1) && seen.push(canvas.dataset.shown)) \
         .observe(canvas, { attributeFilter: ['data-shown'] }); })()",
    );
}

/// The file's value is seen, and nothing else.
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
    // Nor does it matter where the mouse is meanwhile.
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
    // The hand trembles before it lets go.
    mouse(&mut browser, "Dragged", [x + 21.0, y]);
    mouse(&mut browser, "Released", [x + 21.0, y]);
    assert_eq!(
        browser.ask(&format!("[{FIELD}, document.querySelector('{SLIDER}').value].join()")),
        "12,12"
    );
    // The next drag is one again, and comes back to where it began.
    mouse(&mut browser, "Pressed", [x, y]);
    let begun = browser.ask(FIELD);
    mouse(&mut browser, "Dragged", [x + 20.0, y]);
    browser.wait(&format!("{LIVE} && {SHOWN} !== {first}"));
    // A slider has fewer places than values: some fraction of a pixel is where it began.
    let back = (0..24).map(|k| [x - 3.0 + 0.25 * f64::from(k), y]).find(|place| {
        mouse(&mut browser, "Dragged", *place);
        browser.ask(FIELD) == begun
    });
    mouse(&mut browser, "Released", back.unwrap());
    browser.wait(&at_rest(&first));
    assert_eq!(file(&project), before);
    // It is over: what somebody else saves is no conflict.
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
    // All the way to the left is 0, and 0 is no missing value.
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
    // What cannot be is refused and said; what is in the file comes back.
    browser.write("#parameter-growth", "100");
    browser.press("Enter", 0);
    browser.wait("document.querySelector('#refused').textContent.includes('growth')");
    browser.press("Escape", 0);
    assert_eq!(browser.ask(&both), "0,0");
    assert_eq!(file(&project), says("0", &before));
    // A field that has the focus is the hand's alone once somebody types; else it follows, and its slider, too.
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

/// Bytes that the last value took from the watch.
const MOVED: &str = "performance.getEntriesByName('value')[0].detail.bytes";

/// The pixels of the canvas.
fn pixels(browser: &mut Browser) -> Json {
    let [x, y, width, height] = area(browser, "canvas[tabindex]");
    // What was drawn last has to be on the screen.
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

/// How many columns the page has, their bytes, and bytes of all its objects and buffers.
fn held(browser: &mut Browser) -> [f64; 3] {
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
    let [columns, bytes, heap] = held(&mut browser);
    edits(&mut browser, 5..45, &project);
    let [columns_then, bytes_then, heap_then] = held(&mut browser);
    assert_eq!((columns, bytes), (columns_then, bytes_then));
    assert!(heap_then < heap + 2e6, "{heap} bytes became {heap_then}");
    served.watch.end();
}

#[test]
fn keys_act_on_what_is_seen_before_anybody_has_clicked() {
    let Some((_project, mut served, mut browser)) = doll() else { return };
    fn pressed(browser: &mut Browser, label: &str) -> Json {
        browser.ask(&format!(
            "[...document.querySelectorAll('.tools button')].find((it) => it.textContent === '{label}').ariaPressed"
        ))
    }
    let side = "document.querySelector('.side').textContent";
    assert_eq!(browser.ask("document.activeElement === document.body"), true);
    browser.press("w", 0);
    assert_eq!(pressed(&mut browser, "edges"), "true");
    browser.press("ArrowRight", 0);
    browser.wait(&format!("{side} !== 'from the front'"));
    browser.press("0", 0);
    browser.wait(&format!("{side} === 'from the front'"));
    // Beside what is seen letters act, and arrows scroll.
    browser.ask("document.querySelector('svg .node').focus()");
    browser.press("w", 0);
    browser.press("ArrowRight", 0);
    assert_eq!(pressed(&mut browser, "edges"), "false");
    assert_eq!(browser.ask(side), "from the front");
    // What somebody types is typed, and the help has its own keys.
    browser.write("#parameter-growth", "5");
    browser.press("w", 0);
    assert_eq!(pressed(&mut browser, "edges"), "false");
    browser.press("Escape", 0);
    browser.ask("document.activeElement.blur()");
    browser.press("?", 0);
    browser.wait("document.querySelector('#help').open");
    browser.press("w", 0);
    assert_eq!(pressed(&mut browser, "edges"), "false");
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
    // A change made in one of them is one in all of them.
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
