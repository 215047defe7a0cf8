//! What hands do on the live page: drag, type, point and pick, in a real browser that draws by itself.

use maquette::value::Mesh;
use nalgebra::Point3;
use serde_json::{Value as Json, json};

use crate::browser::Browser;
use crate::preview::{Served, mesh_of};
use crate::project::Project;

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
    let says = |growth: &str| before.replace("default: 12.0", &format!("default: {growth}"));
    let mut at = |browser: &mut Browser, growth: &str| {
        assert!(served.watch.run_until_ok().done["ok"] == true);
        assert_eq!(file(&project), says(growth));
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
    assert_eq!(file(&project), says("0"));
    // A field that has the focus is the hand's alone once somebody types; else it follows, and its slider, too.
    project.save(&says("7"));
    at(&mut browser, "7");
    browser.write("#parameter-growth", "33");
    project.save(&says("8"));
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
    let edits = |browser: &mut Browser, numbers: std::ops::Range<u32>| {
        for k in numbers {
            let before = browser.ask(SHOWN);
            project.save(&project.doll_text(2.0 + f64::from(k) / 2.0));
            browser.wait(&format!("{SHOWN} !== {before}"));
        }
    };
    edits(&mut browser, 0..5);
    let [columns, bytes, heap] = held(&mut browser);
    edits(&mut browser, 5..45);
    let [columns_then, bytes_then, heap_then] = held(&mut browser);
    assert_eq!((columns, bytes), (columns_then, bytes_then));
    assert!(heap_then < heap + 2e6, "{heap} bytes became {heap_then}");
    served.watch.end();
}

/// Whether what the page says of a pixel is what `inspect` says of it.
fn assert_same(said: &str, facts: &Json) {
    let facts = facts.as_object().unwrap();
    let mut parts = said.split("   ").skip(1);
    for (name, fact) in facts {
        let part = parts.next().unwrap_or_default();
        let values =
            part.strip_prefix(&format!("{name} ")).unwrap_or_else(|| panic!("{said}: {name}"));
        let fact = match fact {
            Json::Array(items) => items.clone(),
            one => vec![one.clone()],
        };
        let values = Vec::from_iter(values.split(", "));
        assert_eq!(values.len(), fact.len(), "{said}: {name}");
        for (value, fact) in values.into_iter().zip(fact) {
            match fact.as_f64() {
                Some(number) => {
                    let value: f64 = value.parse().unwrap();
                    assert!(
                        (value - number).abs() <= 1e-5 * number.abs(),
                        "{said}: {name} {number}"
                    );
                }
                None => assert_eq!(value, fact.as_str().map_or(fact.to_string(), str::to_owned)),
            }
        }
    }
    assert_eq!(parts.next(), None, "{said}");
}

#[test]
fn the_pointer_is_told_of_a_pixel_what_inspect_says() {
    let Some((project, mut served, mut browser)) = doll() else { return };
    // Several pixels of the window for each pixel of a picture.
    let large = json!({ "width": 2000, "height": 2200, "deviceScaleFactor": 1, "mobile": false });
    browser.call("Emulation.setDeviceMetricsOverride", large);
    for (node, output) in
        [("scan", "color"), ("red", "mask"), ("spots", "labels"), ("scan", "range")]
    {
        look(&mut browser, node, output);
        let [left, top, width, height] = area(&mut browser, "canvas[tabindex]");
        // A picture of 400 x 400 in the middle of what is higher or wider.
        let side = width.min(height);
        for [column, row] in [[200.0, 210.0], [120.0, 133.0], [3.0, 399.0]] {
            let place = |at: f64, start: f64, size: f64| {
                start + (size - side) / 2.0 + (at + 0.5) * side / 400.0
            };
            mouse(&mut browser, "Moved", [left + 1.0, top + 1.0]);
            mouse(&mut browser, "Moved", [place(column, left, width), place(row, top, height)]);
            browser.wait(&format!("{PROBE} !== ''"));
            let said = browser.ask(PROBE);
            let said = said.as_str().unwrap();
            let inspect = |column: f64, row: f64| {
                let (name, at) = (format!("{node}.{output}"), format!("{column},{row}"));
                project.maquette(&["inspect", "doll.ron", &name, "--at", &at, "--json"])
            };
            if !said.starts_with("pixel ") {
                // Nothing was measured there.
                let why = inspect(column, row).stderr;
                assert!(String::from_utf8(why).unwrap().contains(said), "{said}");
                continue;
            }
            let pixel = numbers(said, "pixel ");
            // The cells of a range image are larger than pixels.
            let near = if output == "range" { 1.0 } else { 0.0 };
            let off = (pixel[0] - column).abs().max((pixel[1] - row).abs());
            assert!(off <= near, "{said} at {column}, {row}");
            let inspected = inspect(pixel[0], pixel[1]);
            let inspected: Json = serde_json::from_slice(&inspected.stdout).unwrap();
            assert_same(said, &inspected["outputs"][0]["facts"]);
        }
    }
    mouse(&mut browser, "Moved", [5.0, 5.0]);
    browser.wait(&format!("{PROBE} === ''"));
    served.watch.end();
}

/// The numbers behind a word that the page says of a place, and before the next one.
fn numbers(said: &str, word: &str) -> Vec<f64> {
    let part = said.split("   ").find_map(|part| part.strip_prefix(word)).unwrap_or_default();
    part.trim_end_matches(" mm")
        .split(", ")
        .filter_map(|number| number.trim().parse().ok())
        .collect()
}

#[test]
fn the_pointer_is_told_the_face_the_vertex_and_the_place_of_what_is_drawn_under_it() {
    let Some((project, mut served, mut browser)) = doll() else { return };
    let mesh: Mesh = mesh_of(&project, "model");
    let faces = mesh.faces().as_triangles().unwrap();
    let [left, top, width, height] = area(&mut browser, "canvas[tabindex]");
    let picture = pixels(&mut browser);
    let (mut hits, mut misses) = (0, 0);
    for k in 0..25 {
        let at = [k % 5, k / 5].map(|step| 0.1 + 0.2 * f64::from(step));
        let [x, y] = [(width * at[0]).round(), (height * at[1]).round()];
        let Some(is_drawn) = is_drawn(&mut browser, &picture, x, y) else { continue };
        if !is_drawn {
            misses += 1;
            mouse(&mut browser, "Moved", [left + width / 2.0, top + height / 2.0]);
            browser.wait(&format!("{PROBE}.startsWith('at ')"));
            mouse(&mut browser, "Moved", [left + x, top + y]);
            browser.wait(&format!("{PROBE} === ''"));
            continue;
        }
        mouse(&mut browser, "Moved", [5.0, 5.0]);
        browser.wait(&format!("{PROBE} === ''"));
        mouse(&mut browser, "Moved", [left + x, top + y]);
        browser.wait(&format!("{PROBE}.startsWith('at ')"));
        let said = browser.ask(PROBE);
        let said = said.as_str().unwrap();
        hits += 1;
        let [face, vertex] = ["face ", "vertex "].map(|word| numbers(said, word)[0] as usize);
        let place = Point3::from_slice(&numbers(said, "at "));
        let corners = faces[face].map(|v| mesh.positions()[v as usize]);
        let [a, b, c] = corners;
        let (u, v, w) = (b - a, c - a, place - a);
        let size = u.cross(&v).norm();
        // In its plane and inside of it, as exact as it is said: six digits of some hundred millimeters.
        let shares =
            [u.cross(&w).norm(), w.cross(&v).norm(), (b - place).cross(&(c - place)).norm()];
        let sum: f64 = shares.iter().sum();
        assert!((sum - size).abs() < 0.05 * size, "{said}: {corners:?}");
        let far = |v: &u32| (mesh.positions()[*v as usize] - place).norm();
        let least = faces[face].iter().map(far).fold(f64::MAX, f64::min);
        assert!(
            faces[face].contains(&(vertex as u32)) && far(&(vertex as u32)) < least + 0.01,
            "{said}"
        );
    }
    assert!(hits > 3 && misses > 3, "{hits} hits, {misses} misses");
    served.watch.end();
}

/// Whether a pixel of a picture of the canvas shows anything but the ground; nothing where both are near.
fn is_drawn(browser: &mut Browser, picture: &Json, x: f64, y: f64) -> Option<bool> {
    // The ground is the same in each row.
    let asked = format!(
        "(async () => {{ const bytes = Uint8Array.from(atob({picture}), (letter) => letter.charCodeAt(0)); \
         const bitmap = await createImageBitmap(new Blob([bytes], {{ type: 'image/png' }})); \
         const canvas = new OffscreenCanvas(bitmap.width, bitmap.height).getContext('2d'); canvas.drawImage(bitmap, 0, 0); \
         const at = (x, y) => canvas.getImageData(x, y, 1, 1).data.join(); const found = []; \
         for (let dy = -3; dy <= 3; dy++) for (let dx = -3; dx <= 3; dx++) found.push(at({x} + dx, {y} + dy) !== at(0, {y} + dy)); \
         return found.every((it) => it) ? true : found.some((it) => it) ? null : false; }})()"
    );
    browser.ask(&asked).as_bool()
}

/// A doll with a color, a pixel and a place among its parameters.
fn picky() -> Option<(Project, Served, Browser)> {
    let project = Project::doll();
    let text = project.doll_text(12.0).replace(
        "    params: {\n",
        "    params: {\n        \"hue\": Color(default: \"#c33923\", doc: \"Of the nose.\"),\n        \
         \"spot\": Vector(default: (1, 2), doc: \"A pixel.\"),\n        \
         \"place\": Vector(default: (0, 0, 0), doc: \"A place.\"),\n",
    );
    let text = text.replace("color: \"#c33923\"", "color: Param(\"hue\")");
    page(project, &text)
}

/// Wants to pick a parameter, as somebody would with the mouse.
fn want(browser: &mut Browser, name: &str) {
    let button = format!("button[aria-label=\"take {name} from what is seen\"]");
    let [x, y, width, height] = area(browser, &button);
    click(browser, [x + width / 2.0, y + height / 2.0]);
    browser.wait("document.querySelector('.frame').dataset.wanting");
}

const WANTS: &str = "document.querySelector('.frame').dataset.wanting";

#[test]
fn colors_pixels_and_places_are_picked_from_what_is_seen() {
    let Some((project, mut served, mut browser)) = picky() else { return };
    assert_eq!(browser.ask("document.querySelectorAll('button.dropper').length"), 3);
    let before = file(&project);
    // A place on the mesh.
    let [left, top, width, height] = area(&mut browser, "canvas[tabindex]");
    let middle = [left + width / 2.0, top + height / 2.0];
    want(&mut browser, "place");
    click(&mut browser, middle);
    served.watch.run_until_ok();
    let text = file(&project);
    let said = text.split("\"place\": Vector(default: (").nth(1).unwrap();
    let (said, _) = said.split_once(')').unwrap();
    assert_eq!(text, before.replace("(0, 0, 0)", &format!("({said})")));
    mouse(&mut browser, "Moved", [5.0, 5.0]);
    mouse(&mut browser, "Moved", middle);
    browser.wait(&format!("{PROBE}.startsWith('at {said} mm')"));
    assert_eq!(browser.ask(WANTS), Json::Null);
    // Another click takes nothing more.
    click(&mut browser, [middle[0] + 20.0, middle[1]]);
    // A color of the picture, and a pixel of it.
    look(&mut browser, "scan", "color");
    let [left, top, width, height] = area(&mut browser, "canvas[tabindex]");
    let middle = [left + width / 2.0, top + height / 2.0];
    mouse(&mut browser, "Moved", middle);
    browser.wait(&format!("{PROBE}.startsWith('pixel 200, ')"));
    let said = browser.ask(PROBE);
    let said = said.as_str().unwrap();
    let color = said.split_whitespace().find(|word| word.starts_with('#')).unwrap();
    want(&mut browser, "hue");
    click(&mut browser, middle);
    served.watch.run_until_ok();
    let colored = text.replace("\"#c33923\"", &format!("\"{color}\""));
    assert_eq!(file(&project), colored);
    browser.wait(&format!("document.querySelector('#parameter-hue').value === '{color}'"));
    want(&mut browser, "spot");
    click(&mut browser, middle);
    served.watch.run_until_ok();
    let pixel = said.strip_prefix("pixel ").unwrap().split("   ").next().unwrap();
    assert_eq!(file(&project), colored.replace("(1, 2)", &format!("({pixel})")));
    // All of it can be taken back.
    for _ in 0..3 {
        browser.press("z", 2);
        served.watch.run_until_ok();
    }
    assert_eq!(file(&project), before);
    served.watch.end();
}

#[test]
fn a_pick_is_given_up_with_escape_and_where_there_is_nothing_that_is_said() {
    let Some((project, mut served, mut browser)) = picky() else { return };
    let before = file(&project);
    let [left, top, width, height] = area(&mut browser, "canvas[tabindex]");
    let refused = "document.querySelector('#refused').textContent";
    want(&mut browser, "place");
    click(&mut browser, [left + 3.0, top + 3.0]);
    browser.wait(&format!("{refused}.includes('there is no place')"));
    browser.press("Escape", 0);
    browser.wait(&format!("{WANTS} === undefined && {refused} === ''"));
    want(&mut browser, "hue");
    click(&mut browser, [left + width / 2.0, top + height / 2.0]);
    browser.wait(&format!("{refused}.includes('there is no color')"));
    // It is still wanted: somebody may have to look for it first. Beside a picture there is nothing, either.
    look(&mut browser, "scan", "color");
    browser.ask("document.querySelector('#refused').textContent = ''");
    click(&mut browser, [left + 3.0, top + height / 2.0]);
    browser.wait(&format!("{refused}.includes('there is no color')"));
    // Escape helps wherever the focus is.
    browser.ask("document.querySelector('svg .node').focus()");
    browser.press("Escape", 0);
    browser.wait(&format!("{WANTS} === undefined"));
    click(&mut browser, [left + width / 2.0, top + height / 2.0]);
    project.save(&before.replace("12.0", "13.0"));
    served.watch.run_until_ok();
    assert_eq!(file(&project), before.replace("12.0", "13.0"));
    served.watch.end();
}

#[test]
fn eight_tabs_follow_a_save() {
    let Some((project, mut served, mut browser)) = doll() else { return };
    let tabs = Vec::from_iter((0..8).map(|_| browser.add_tab()));
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
