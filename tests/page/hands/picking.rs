//! The page shows the value under the pointer. Colors, pixels and positions can be picked from the view.

use maquette::value::Mesh;
use nalgebra::Point3;

use super::*;

/// Checks that the page's text about a pixel has the facts that `inspect` prints.
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
        let values: Vec<_> = values.split(", ").collect();
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
    // The window is large enough to show each pixel of a picture as several pixels of the screen.
    let large = json!({ "width": 2000, "height": 2200, "deviceScaleFactor": 1, "mobile": false });
    browser.call("Emulation.setDeviceMetricsOverride", large);
    for (node, output) in
        [("scan", "color"), ("red", "mask"), ("spots", "labels"), ("scan", "range")]
    {
        look(&mut browser, node, output);
        let [left, top, width, height] = area(&mut browser, "canvas[tabindex]");
        // The picture of 400 x 400 pixels is in the middle of a larger canvas.
        let side = width.min(height);
        for [column, row] in [[200.0, 210.0], [120.0, 133.0], [3.0, 399.0]] {
            fn place(at: f64, start: f64, size: f64, side: f64) -> f64 {
                start + (size - side) / 2.0 + (at + 0.5) * side / 400.0
            }
            mouse(&mut browser, "Moved", [left + 1.0, top + 1.0]);
            mouse(
                &mut browser,
                "Moved",
                [place(column, left, width, side), place(row, top, height, side)],
            );
            browser.wait(&format!("{PROBE} !== ''"));
            let said = browser.ask(PROBE);
            let said = said.as_str().unwrap();
            fn inspect(
                column: f64,
                row: f64,
                node: &str,
                output: &str,
                project: &Project,
            ) -> std::process::Output {
                let (name, at) = (format!("{node}.{output}"), format!("{column},{row}"));
                project.maquette(&["inspect", "doll.ron", &name, "--at", &at, "--json"])
            }
            if !said.starts_with("pixel ") {
                // Nothing was measured at this cell of the range image; the page and `inspect` give the same reason.
                let why = inspect(column, row, node, output, &project).stderr;
                assert!(String::from_utf8(why).unwrap().contains(said), "{said}");
                continue;
            }
            let pixel = numbers(said, "pixel ");
            // A cell of a range image covers several pixels, so the page may name a neighbor.
            let near = if output == "range" { 1.0 } else { 0.0 };
            let off = (pixel[0] - column).abs().max((pixel[1] - row).abs());
            assert!(off <= near, "{said} at {column}, {row}");
            let inspected = inspect(pixel[0], pixel[1], node, output, &project);
            let inspected: Json = serde_json::from_slice(&inspected.stdout).unwrap();
            assert_same(said, &inspected["outputs"][0]["facts"]);
        }
    }
    mouse(&mut browser, "Moved", [5.0, 5.0]);
    browser.wait(&format!("{PROBE} === ''"));
    served.watch.end();
}

/// Returns the numbers that follow a word in the page's text about a position.
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
        // The position is inside of the triangle: the areas of the three parts add up to that of the triangle. The tolerance allows for the
        // six digits in the text.
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

/// Returns true if all pixels around a position of the canvas differ from the background, false if none does, and `None` if only some do.
fn is_drawn(browser: &mut Browser, picture: &Json, x: f64, y: f64) -> Option<bool> {
    // The background is constant along each row, so each pixel is compared with the first pixel of its row.
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

/// Opens a page of the example graph `doll.ron` with a color, a pixel and a position among its parameters.
fn picky() -> Option<(Project, Server, Browser)> {
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

/// Clicks the button that starts picking a parameter.
fn want(browser: &mut Browser, name: &str) {
    let button = format!("button[aria-label=\"pick {name} in the view\"]");
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
    // Picks a position on the mesh.
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
    // Picking has ended, so another click has no effect.
    click(&mut browser, [middle[0] + 20.0, middle[1]]);
    // Picks a color in the picture, and then a pixel.
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
    // Each of the three changes can be undone.
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
    browser.wait(&format!("{refused}.includes('there is no position')"));
    browser.press("Escape", 0);
    browser.wait(&format!("{WANTS} === undefined && {refused} === ''"));
    // A value without texture and colors has no color to pick.
    look(&mut browser, "raised", "net");
    want(&mut browser, "hue");
    click(&mut browser, [left + width / 2.0, top + height / 2.0]);
    browser.wait(&format!("{refused}.includes('there is no color')"));
    // A click beside the picture finds no color, either. Picking continues after such a miss, because the user may have to search.
    look(&mut browser, "scan", "color");
    browser.ask("document.querySelector('#refused').textContent = ''");
    click(&mut browser, [left + 3.0, top + height / 2.0]);
    browser.wait(&format!("{refused}.includes('there is no color')"));
    // Escape cancels picking, whichever element has the focus.
    browser.ask("document.querySelector('svg .node').focus()");
    browser.press("Escape", 0);
    browser.wait(&format!("{WANTS} === undefined"));
    click(&mut browser, [left + width / 2.0, top + height / 2.0]);
    project.save(&before.replace("12.0", "13.0"));
    served.watch.run_until_ok();
    assert_eq!(file(&project), before.replace("12.0", "13.0"));
    served.watch.end();
}

/// Makes a project with a square whose texture has four pixels, one in each quarter.
fn textured_square() -> Project {
    let project = Project::new(
        r##"Graph(
    format: 1,
    params: {
        "hue": Color(default: "#000000", doc: "A color."),
        "spot": Vector(default: (9, 9), doc: "A pixel."),
        "place": Vector(default: (9, 9, 9), doc: "A place."),
    },
    nodes: {
        "square": ReadMesh(path: "square.obj"),
        "moved": Transform(mesh: "square", translate: Param("place")),
    },
    outputs: { "square.ply": "square" },
)"##,
    );
    let write =
        |name: &str, bytes: &[u8]| std::fs::write(project.folder().join(name), bytes).unwrap();
    let square = "mtllib square.mtl\nusemtl paint\nv 0 0 0\nv 40 0 0\nv 40 40 0\nv 0 40 0\n\
                  vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n";
    write("square.obj", square.as_bytes());
    write("square.mtl", b"newmtl paint\nmap_Kd square.png\n");
    let pixels = vec![[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 0]];
    let picture = maquette::value::Image::new(2, 2, pixels).unwrap();
    write("square.png", &maquette::format::png::encode_rgb(&picture).unwrap());
    project
}

#[test]
fn a_click_on_a_textured_mesh_picks_its_place_its_pixel_and_its_color() {
    let project = textured_square();
    let text = file(&project);
    let Some((project, mut served, mut browser)) = page(project, &text) else { return };
    look(&mut browser, "square", "mesh");
    let [left, top, width, height] = area(&mut browser, "canvas[tabindex]");
    // The lower right quarter shows the second pixel in the second row of the texture.
    let side = width.min(height);
    let at = [left + width / 2.0 + 0.2 * side, top + height / 2.0 + 0.2 * side];
    for (name, kept) in [("place", "place"), ("spot", "(1, 1)"), ("hue", "\"#ffff00\"")] {
        want(&mut browser, name);
        click(&mut browser, at);
        served.watch.run_until_ok();
        browser.wait(&format!("{WANTS} === undefined"));
        let text = file(&project);
        if name != "place" {
            assert!(text.contains(&format!("default: {kept}")), "{name}: {text}");
            continue;
        }
        let said = text.split("\"place\": Vector(default: (").nth(1).unwrap();
        let (said, _) = said.split_once(')').unwrap();
        let place: Vec<_> = said.split(", ").map(|it| it.parse::<f64>().unwrap()).collect();
        assert!((20.0..40.0).contains(&place[0]) && (0.0..20.0).contains(&place[1]), "{said}");
        assert!(place[2].abs() < 1e-9, "{said}");
    }
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
    served.watch.end();
}
