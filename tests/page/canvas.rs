//! Compares the drawing of the live page in a real browser with the picture that `render` makes, and tests interaction with the drawing.

use maquette::format::png;
use maquette::value::Image;
use serde_json::json;

use crate::browser::Browser;
use crate::preview::Server;
use crate::project::Project;
use crate::visible_page::{ImageDifference, ROUNDED, SIZE, VisiblePage, columns};

/// Returns a wavy surface of quads with vertex colors as a PLY file. The vertices in the columns after 18 are raised by `raised`.
fn wave(raised: f64) -> String {
    let side = 24;
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        side * side,
        (side - 1) * (side - 1)
    );
    for (row, column) in (0..side * side).map(|at| (at / side, at % side)) {
        let end = if column > 18 { raised } else { 0.0 };
        let z =
            3.0 * libm::sin(0.4 * f64::from(column)) + 2.0 * libm::cos(0.3 * f64::from(row)) + end;
        text += &format!("{column} {row} {z:.4} {} {} 120\n", 10 * column, 10 * row);
    }
    for (row, column) in (0..side - 1).flat_map(|row| (0..side - 1).map(move |at| (row, at))) {
        let first = row * side + column;
        text += &format!("4 {first} {} {} {}\n", first + 1, first + side + 1, first + side);
    }
    text
}

/// Makes a project whose graph has small values that the example graph `doll.ron` lacks: a mesh with vertex colors, points, a curve, a
/// point net, a NURBS surface, and a mesh with materials.
fn shapes() -> Project {
    let project = Project::new(
        "Graph(format: 1, nodes: { \"wave\": ReadMesh(path: \"wave.ply\"), \"points\": ReadPoints(path: \"points.xyz\"), \
         \"curve\": ReadCurve(path: \"curve.obj\"), \"net\": PointNet(points: [[(0, 0, 0), (1, 0, 1), (2, 0, 0), (3, 0, 0)], \
         [(0, 1, 1), (1, 1, 2), (2, 1, 1), (3, 1, 0)], [(0, 2, 0), (1, 2, 1), (2, 2, 0), (3, 2, 1)]]), \
         \"surface\": Nurbs(net: \"net\"), \"materials\": ReadMesh(path: \"materials.obj\") }, outputs: { \"wave.ply\": \"wave\", \
         \"points.ply\": \"points\", \"curve.ply\": \"curve\", \"surface.ply\": \"surface\", \"materials.glb\": \"materials\" })",
    );
    let points = (0..400).map(|k| {
        let (x, y) = (k % 20, k / 20);
        format!("{x} {y} {} {} {} 60\n", (x * y) % 7, 12 * x, 12 * y)
    });
    let ring = (0..24).map(|k| {
        let angle = f64::from(k) * std::f64::consts::TAU / 24.0;
        format!(
            "v {:.5} {:.5} {:.5}\n",
            2.0 * libm::cos(angle),
            libm::sin(angle),
            0.3 * f64::from(k % 3)
        )
    });
    let order = (1..=24).map(|k| format!(" {k}"));
    let curve = format!("{}l{} 1\n", String::from_iter(ring), String::from_iter(order));
    fn write(name: &str, content: &[u8], project: &Project) {
        std::fs::write(project.folder().join(name), content).unwrap();
    }
    write("wave.ply", wave(0.0).as_bytes(), &project);
    write("points.xyz", String::from_iter(points).as_bytes(), &project);
    write("curve.obj", curve.as_bytes(), &project);
    // Three squares with different materials: a texture that repeats beyond its border, a color, and another texture.
    let squares = "mtllib materials.mtl\nv 0 0 0\nv 1 0 0\nv 2 0 0\nv 3 0 0\nv 0 1 0\nv 1 1 0\nv 2 1 0\nv 3 1 0\nvt 0.5 0.5\nvt 2.5 0.5\n\
                   vt 2.5 1.5\nvt 0.5 1.5\nusemtl a\nf 1/1 2/2 6/3 5/4\nusemtl b\nf 2/1 3/2 7/3 6/4\nusemtl c\nf 3/1 4/2 8/3 7/4\n";
    write("materials.obj", squares.as_bytes(), &project);
    write(
        "materials.mtl",
        b"newmtl a\nmap_Kd a.png\nnewmtl b\nKd 0.9 0.2 0.1\nnewmtl c\nmap_Kd c.png\n",
        &project,
    );
    for (name, blue) in [("a.png", 30), ("c.png", 230)] {
        // The texture is periodic, so there is no visible seam where it repeats.
        fn level(k: usize) -> u8 {
            let angle = (k as f64 + 0.5) * std::f64::consts::TAU / 16.0;
            (127.5 + 120.0 * libm::cos(angle)) as u8
        }
        let pixels = (0..16 * 16).map(|k| [level(k % 16), level(k / 16), blue]);
        let image = Image::new(16, 16, pixels.collect::<Vec<_>>()).unwrap();
        write(name, &png::encode_rgb(&image).unwrap(), &project);
    }
    project
}

/// Maximum allowed differences between a picture of the page and one made by `render`, for each kind of picture. Each is about twice the
/// measured difference. Edges are antialiased differently, so pictures that mostly show edges differ most.
const FACES: ImageDifference = ImageDifference { mean: 0.4, other: 0.002 };
const PIXELS: ImageDifference = ImageDifference { mean: 1.0, other: 0.01 };
const THIN: ImageDifference = ImageDifference { mean: 0.6, other: 0.01 };
const NET: ImageDifference = ImageDifference { mean: 2.2, other: 0.035 };

/// Checks that the page draws a value in space like `render`, from the front and from another side. A rendering that is rotated by ten
/// degrees must differ.
fn assert_is_as_rendered(seen: &mut VisiblePage, node: &str, output: &str, limit: ImageDifference) {
    seen.view(node, output);
    for keys in [&["0"][..], &["ArrowRight", "ArrowRight", "ArrowUp", "f"]] {
        seen.press(keys);
        let canvas = seen.canvas();
        let [apart, aside] =
            [0.0, 10.0].map(|aside| ImageDifference::between(&canvas, &seen.render_view(aside)));
        assert!(apart.is_within(limit), "{node}.{output} {keys:?}: {apart:?}");
        assert!(!aside.is_within(limit), "{node}.{output} {keys:?}, from aside: {aside:?}");
    }
}

#[test]
fn the_doll_is_drawn_as_it_is_rendered() {
    let Some(mut seen) = VisiblePage::open(Project::doll()) else { return };
    assert_is_as_rendered(&mut seen, "model", "mesh", FACES);
    assert_is_as_rendered(&mut seen, "grid", "mesh", FACES);
    assert_is_as_rendered(&mut seen, "surface", "surface", NET);
    assert_is_as_rendered(&mut seen, "net", "net", NET);
    for (node, output) in [
        ("scan", "color"),
        ("whole", "range"),
        ("red", "mask"),
        ("spots", "labels"),
        ("nose", "region"),
    ] {
        seen.view(node, output);
        let apart = ImageDifference::between(&seen.canvas(), &seen.render_view(0.0));
        assert!(apart.is_within(PIXELS), "{node}.{output}: {apart:?}");
    }
    let flat = seen.canvas();
    seen.press(&["m"]);
    seen.canvas_after(&flat);
    assert_is_as_rendered(&mut seen, "nose", "region", THIN);
    assert!(seen.browser.complaints.is_empty(), "{:?}", seen.browser.complaints);
}

#[test]
fn colors_points_curves_and_surfaces_are_drawn_as_they_are_rendered() {
    let Some(mut seen) = VisiblePage::open(shapes()) else { return };
    assert_is_as_rendered(&mut seen, "wave", "mesh", FACES);
    assert_is_as_rendered(&mut seen, "points", "points", THIN);
    assert_is_as_rendered(&mut seen, "curve", "curve", THIN);
    assert_is_as_rendered(&mut seen, "surface", "surface", THIN);
    assert_is_as_rendered(&mut seen, "materials", "mesh", THIN);
}

#[test]
fn what_grows_is_drawn_as_it_is_rendered() {
    let Some(mut seen) = VisiblePage::open(Project::doll()) else { return };
    seen.view("model", "mesh");
    seen.press(&["0", "ArrowRight"]);
    let mut before = seen.canvas();
    // Changes the parameter `growth` up and down: at 0 the surface is flat, at 40 it is so steep that faces get vertices of their own. The
    // last value equals the first.
    for (edit, growth) in [13.0, 40.0, 0.0, 39.0, 12.5, 13.0].into_iter().enumerate() {
        seen.project.save(&seen.project.doll_text(growth));
        seen.drawn_of(2 + edit);
        // Fits the view to the new value, because the rendering is fitted to it, too.
        seen.press(&["f"]);
        let canvas = seen.canvas();
        let apart = ImageDifference::between(&canvas, &seen.render_view(0.0));
        assert!(apart.is_within(FACES), "{growth}: {apart:?}");
        assert!(
            !ImageDifference::between(&canvas, &before).is_within(ROUNDED),
            "nothing has grown to {growth}"
        );
        before = canvas;
    }
}

/// Makes a project with a mesh of a red mark in front of a blue wall.
fn mark() -> Project {
    let project = Project::new(
        "Graph(format: 1, nodes: { \"mark\": ReadMesh(path: \"mark.ply\") }, outputs: { \"mark.ply\": \"mark\" })",
    );
    let text = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n\
                property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 2\n\
                property list uchar int vertex_indices\nend_header\n\
                -10 -8 0 60 90 200\n10 -8 0 60 90 200\n10 8 0 60 90 200\n-10 8 0 60 90 200\n\
                3.4 3 3 255 0 0\n4 2.4 3 255 0 0\n4.6 3 3 255 0 0\n4 3.6 3 255 0 0\n4 0 1 2 3\n4 4 5 6 7\n";
    std::fs::write(project.folder().join("mark.ply"), text).unwrap();
    project
}

/// Returns the center of the red pixels.
fn middle_of_red(image: &Image) -> [f64; 2] {
    let pixels = image.pixels().iter().enumerate();
    let red = pixels.filter(|(_, [r, g, b])| *r > 90 && *r > 2 * g.max(b).min(&120));
    let red: Vec<_> = red.map(|(at, _)| [at % image.width(), at / image.width()]).collect();
    assert!(red.len() > 20, "{} pixels are red", red.len());
    [0, 1].map(|k| red.iter().map(|at| at[k] as f64 + 0.5).sum::<f64>() / red.len() as f64)
}

#[test]
fn what_is_clicked_twice_stays_in_the_middle_whatever_is_turned() {
    let Some(mut seen) = VisiblePage::open(mark()) else { return };
    let [x, y] = middle_of_red(&seen.canvas());
    assert!(libm::hypot(x - 240.0, y - 180.0) > 50.0, "{x}, {y}");
    let before = seen.word("camera");
    seen.double_click([x, y]);
    seen.browser.wait(&format!("!location.hash.endsWith('={before}')"));
    seen.wait_for_frame();
    for keys in
        [&[][..], &["ArrowRight", "ArrowRight"], &["ArrowUp"], &["ArrowLeft"; 4], &["+", "+"]]
    {
        seen.press(keys);
        let [x, y] = middle_of_red(&seen.canvas());
        assert!(libm::hypot(x - 240.0, y - 180.0) < 2.0, "{keys:?}: {x}, {y}");
    }
    let canvas = seen.canvas();
    seen.reload();
    seen.becomes(&canvas);
}

#[test]
fn a_scan_turns_about_the_place_that_is_clicked_twice() {
    let Some(mut seen) = VisiblePage::open(Project::doll()) else { return };
    seen.double_click([250.0, 170.0]);
    seen.browser.wait("location.hash.split(',').length === 8");
    let camera = seen.word("camera");
    let target =
        camera.split(',').skip(3).take(3).map(|it| it.parse::<f64>().unwrap()).collect::<Vec<_>>();
    for keys in [&[][..], &["ArrowRight"], &["ArrowUp", "+"]] {
        seen.press(keys);
        seen.mouse("mouseMoved", [1.0, 1.0], 0);
        seen.browser.wait("document.querySelector('.probe').textContent === ''");
        seen.mouse("mouseMoved", [240.0, 180.0], 0);
        seen.browser.wait("document.querySelector('.probe').textContent.startsWith('at ')");
        let told = seen.browser.ask("document.querySelector('.probe').textContent.match(/-?[\\d.]+/g).slice(0, 3).map(Number)");
        // The page's text uses the sensor's axes: y points down and z away from the sensor.
        for (k, sign) in [1.0, -1.0, -1.0].into_iter().enumerate() {
            let place = sign * told[k].as_f64().unwrap();
            assert!((place - target[k]).abs() < 0.01, "{keys:?}: {told} is not {target:?}");
        }
    }
}

#[test]
fn a_new_value_and_a_resize_move_nothing() {
    let Some(mut seen) = VisiblePage::open(shapes()) else { return };
    seen.view("wave", "mesh");
    seen.press(&["0", "ArrowUp"]);
    let painted = seen.paint("normal");
    seen.press(&["w"]);
    let before = seen.canvas_after(&painted);
    let address = seen.browser.ask("location.href");
    std::fs::write(seen.project.folder().join("wave.ply"), wave(4.0)).unwrap();
    seen.drawn_of(2);
    let after = seen.canvas();
    let [left, right] = [[0, 240], [240, 480]].map(|[from, to]| {
        ImageDifference::between(&columns(&before, from, to), &columns(&after, from, to))
    });
    assert!(
        left.is_within(ImageDifference { mean: 0.1, other: 0.001 }),
        "what did not grow is elsewhere: {left:?}"
    );
    assert!(right.mean > 1.0, "nothing has grown: {right:?}");
    seen.resize(600, 300);
    seen.wait_for_frame();
    assert_eq!(seen.browser.ask("location.href"), address);
    assert_eq!(seen.browser.ask("document.querySelector('[data-key=paint]').value"), "normal");
    assert_eq!(seen.browser.ask("document.querySelector('[data-key=w]').ariaPressed"), "true");
    seen.resize(SIZE[0], SIZE[1]);
    seen.becomes(&after);
}

#[test]
fn a_picture_that_is_looked_at_in_space_stays_there_and_so_does_the_tab() {
    let Some(mut seen) = VisiblePage::open(Project::doll()) else { return };
    let text = std::fs::read_to_string(seen.project.graph()).unwrap();
    seen.view("nose", "region");
    let flat = seen.canvas();
    seen.press(&["m"]);
    seen.canvas_after(&flat);
    seen.press(&["ArrowRight"]);
    let address = seen.browser.ask("location.href");
    seen.project.save(&text.replace("distance: 30.0", "distance: 20.0"));
    seen.drawn_of(2);
    assert_eq!(seen.browser.ask("document.querySelector('[data-key=m]').ariaPressed"), "true");
    assert_eq!(seen.browser.ask("location.href"), address);
    seen.view("scan", "range");
    seen.project.save(&text.replace("range.pcd", "../doll/range.pcd"));
    seen.drawn_of(3);
    seen.resize(600, 300);
    let tab = "document.querySelector('.tabs [aria-pressed=true]').textContent";
    assert!(seen.browser.ask(tab).as_str().unwrap().starts_with("range:"));
    assert!(seen.word("look").contains("space"));
}

#[test]
fn every_output_of_every_node_is_seen() {
    let Some(mut seen) = VisiblePage::open(Project::doll()) else { return };
    let nodes =
        "[...document.querySelectorAll('svg .node:has(.state)')].map((node) => node.dataset.name)";
    let nodes = seen.browser.ask(nodes);
    let mut last = seen.canvas();
    let mut count = 0;
    for node in nodes.as_array().unwrap() {
        let node = node.as_str().unwrap();
        seen.browser.ask(&format!(
            "document.querySelector('svg .node[data-name=\"{node}\"]').dispatchEvent(new MouseEvent('click'))"
        ));
        let outputs = "[...document.querySelectorAll('.tabs button')].map((tab) => tab.textContent.split(':')[0])";
        for output in seen.browser.ask(outputs).as_array().unwrap() {
            let output = output.as_str().unwrap();
            seen.view(node, output);
            seen.press(&["0"]);
            let caption = seen.browser.ask("document.querySelector('.caption').textContent");
            assert_eq!(caption, format!("{node}.{output} of run 1"));
            let canvas = seen.canvas();
            let first = canvas.pixels()[0];
            let seen = canvas
                .pixels()
                .iter()
                .filter(|pixel| (0..3).any(|k| pixel[k].abs_diff(first[k]) > 40));
            assert!(seen.count() > 200, "there is nothing to be seen of {node}.{output}");
            // Except for the knots `knots-u` and `knots-v`, each value looks different from the value that was drawn before it.
            assert!(
                canvas != last || node.starts_with("knots"),
                "{node}.{output} is the one before"
            );
            last = canvas;
            count += 1;
        }
    }
    assert!(count >= 16, "{count}");
}

#[test]
fn an_output_is_pinned_beside_another_and_both_are_turned() {
    let Some(mut seen) = VisiblePage::open(Project::doll()) else { return };
    let text = std::fs::read_to_string(seen.project.graph()).unwrap();
    seen.press(&["p"]);
    fn halves(image: &Image) -> [Image; 2] {
        [columns(image, 0, 240), columns(image, 240, 480)]
    }
    // The left and the right half may be rounded differently.
    fn are_similar([left, right]: &[Image; 2]) -> bool {
        ImageDifference::between(left, right).is_within(ROUNDED)
    }
    let before = halves(&seen.canvas());
    assert!(are_similar(&before), "the same is seen twice");
    seen.press(&["ArrowRight"]);
    let after = halves(&seen.canvas());
    assert!(are_similar(&after) && after != before, "both are turned");
    let [turned, _] = after;
    seen.view("grid", "mesh");
    let both = seen.canvas();
    let [model, grid] = halves(&both);
    assert!(model == turned && grid != turned, "the pinned one stays");
    let address = seen.browser.ask("location.href");
    assert!(address.as_str().unwrap().contains("&pin=model&pinned=mesh"), "{address}");
    seen.reload();
    seen.becomes(&both);
    assert_eq!(seen.browser.ask("location.href"), address);
    // The value of a pinned output is updated after a save, too.
    seen.project.save(&text.replace("default: 12.0", "default: 24.0"));
    seen.browser
        .wait("document.querySelector('.pin').textContent.startsWith('model.mesh of run 2')");
    seen.press(&["u"]);
    assert_eq!(seen.browser.ask("document.querySelector('.pin').hidden"), true);
    assert!(!seen.browser.ask("location.hash").as_str().unwrap().contains("pin"));
}

#[test]
fn all_of_it_is_seen_in_the_half_beside_a_pinned_output() {
    let Some(mut seen) = VisiblePage::open(mark()) else { return };
    fn ends_of_blue(image: &Image) -> [usize; 2] {
        let at =
            |(at, [r, _, b]): (usize, &[u8; 3])| (*b > 100 && b > r).then_some(at % image.width());
        let columns = image.pixels().iter().enumerate().filter_map(at);
        [columns.clone().min().unwrap(), columns.max().unwrap()]
    }
    let whole = seen.canvas();
    seen.press(&["p"]);
    let [first, last] = ends_of_blue(&columns(&seen.canvas(), 240, 480));
    assert!(first > 4 && first < 30 && last > 210 && last < 236, "{first} to {last}");
    seen.press(&["u"]);
    seen.becomes(&whole);
}

#[test]
fn a_result_is_held_and_later_ones_are_compared_with_it() {
    let Some(mut seen) = VisiblePage::open(Project::doll()) else { return };
    seen.press(&["ArrowRight"]);
    let old = seen.canvas();
    seen.press(&["h"]);
    assert!(seen.canvas() == old, "both are the same at first");
    let text = seen.project.doll_text(30.0);
    seen.project.save(&text);
    seen.drawn_of(2);
    let middle = seen.canvas();
    // The line between the old and the new picture is dragged by the mouse.
    seen.mouse("mouseMoved", [243.0, 100.0], 0);
    seen.mouse("mousePressed", [243.0, 100.0], 1);
    seen.mouse("mouseMoved", [228.0, 110.0], 1);
    seen.mouse("mouseReleased", [228.0, 110.0], 1);
    seen.wait_for_frame();
    let moved = seen.canvas();
    seen.press(&["u"]);
    let new = seen.canvas();
    assert!(new != old && columns(&old, 200, 240) != columns(&new, 200, 240), "nothing has grown");
    for (compared, at) in [(middle, 240), (moved, 228)] {
        assert!(columns(&compared, 0, at) == columns(&old, 0, at), "left of {at} is the old one");
        assert!(
            columns(&compared, at, 480) == columns(&new, at, 480),
            "right of {at} is the new one"
        );
    }
    assert_eq!(std::fs::read_to_string(seen.project.graph()).unwrap(), text);
}

#[test]
fn the_edges_of_small_faces_do_not_cover_them() {
    let Some(mut seen) = VisiblePage::open(Project::doll()) else { return };
    let before = seen.canvas();
    seen.press(&["w"]);
    let after = seen.canvas_after(&before);
    fn light(image: &Image) -> f64 {
        image.pixels().iter().flatten().map(|channel| f64::from(*channel)).sum::<f64>()
    }
    assert!(light(&after) < light(&before), "there are edges");
    assert!(light(&after) > 0.8 * light(&before), "{} of {}", light(&after), light(&before));
}

#[test]
fn a_lost_context_comes_back_with_the_same_pixels() {
    let Some(mut seen) = VisiblePage::open(shapes()) else { return };
    seen.view("wave", "mesh");
    seen.press(&["ArrowRight", "f"]);
    let plain = seen.canvas();
    seen.press(&["w"]);
    let before = seen.canvas_after(&plain);
    seen.browser.ask(
        "window.card = document.querySelector('.frame canvas').getContext('webgl2').getExtension('WEBGL_lose_context'), 0",
    );
    fn wait_for_context_event(what: &str, act: &str) -> String {
        format!(
            "new Promise((done) => {{ document.querySelector('.frame canvas').addEventListener('webglcontext{what}', \
             () => setTimeout(done, 0, 1), {{ once: true }}); window.card.{act}(); }})"
        )
    }
    seen.browser.ask(&wait_for_context_event("lost", "loseContext"));
    seen.browser.ask(&wait_for_context_event("restored", "restoreContext"));
    seen.wait_for_frame();
    assert!(seen.canvas() == before, "what comes back is something else");
    // A value that arrives while the WebGL context is lost is drawn after the context is restored.
    seen.browser.ask(&wait_for_context_event("lost", "loseContext"));
    std::fs::write(seen.project.folder().join("wave.ply"), wave(4.0)).unwrap();
    seen.browser.wait("document.querySelector('.caption').textContent === 'wave.mesh of run 2'");
    seen.browser.ask(&wait_for_context_event("restored", "restoreContext"));
    seen.drawn_of(2);
    let after = seen.canvas();
    assert!(after != before);
    seen.reload();
    seen.becomes(&after);
    assert!(seen.browser.complaints.is_empty(), "{:?}", seen.browser.complaints);
}

#[test]
fn without_webgl_the_watch_draws() {
    let Some(mut browser) = Browser::without_webgl() else { return };
    let project = Project::doll();
    let mut served = Server::new(&project);
    served.watch.run_until_ok();
    browser.open(&served.link());
    browser.wait("document.querySelector('.frame img')?.naturalWidth > 100");
    let picture = "document.querySelector('.frame img').src";
    assert_eq!(browser.ask("document.querySelector('.frame canvas').hidden"), true);
    let same_size = "(() => { const [picture, frame] = [document.querySelector('.frame img'), document.querySelector('.frame')]; \
                     return picture.naturalWidth === frame.clientWidth && picture.naturalHeight === frame.clientHeight; })()";
    browser.wait(same_size);
    browser.ask("document.querySelector('.frame img').focus()");
    browser.press("ArrowRight", 0);
    browser.wait(&format!("{picture}.includes('yaw=15')"));
    let label = browser.ask("document.activeElement.ariaLabel");
    assert_eq!(label, "model.mesh of run 1, 15° to the right");
    let old = browser.ask(&format!("{picture}.split('?')[0]"));
    project.save(&project.doll_text(16.0));
    browser.wait(&format!("{picture}.split('?')[0] !== {old} && {picture}.includes('yaw=15')"));
    let address = browser.ask("location.href");
    browser.reload();
    browser.wait(&format!("{picture}.includes('yaw=15')"));
    assert_eq!(browser.ask("location.href"), address);
}

#[test]
fn the_address_brings_pin_paint_camera_and_wipe_back() {
    let Some(mut seen) = VisiblePage::open(shapes()) else { return };
    seen.view("wave", "mesh");
    seen.press(&["0", "ArrowRight", "ArrowUp", "+"]);
    seen.paint("normal");
    seen.press(&["p"]);
    seen.view("points", "points");
    seen.press(&["x"]);
    let canvas = seen.canvas();
    let address = seen.browser.ask("location.href");
    let address = address.as_str().unwrap();
    for word in ["view=points", "pin=wave", "paint=normal", "wipe=0.5", "camera=15,15,1.25,"] {
        assert!(address.contains(word), "{word} is not in {address}");
    }
    seen.browser.open("about:blank");
    seen.browser.wait("location.href === 'about:blank'");
    seen.go_to(address);
    seen.becomes(&canvas);
    assert_eq!(seen.browser.ask("location.href"), address);
}

#[test]
fn one_finger_turns_and_two_enlarge() {
    let Some(mut seen) = VisiblePage::open(shapes()) else { return };
    seen.browser.call("Emulation.setTouchEmulationEnabled", json!({ "enabled": true }));
    seen.view("wave", "mesh");
    seen.press(&["0"]);
    let before = seen.canvas();
    seen.touch("touchStart", &[[240.0, 180.0]]);
    seen.touch("touchMove", &[[290.0, 155.0]]);
    seen.touch("touchEnd", &[]);
    seen.browser.wait("location.hash.includes('camera=-20,-10,1,')");
    let turned = seen.canvas_after(&before);
    seen.touch("touchStart", &[[200.0, 180.0], [280.0, 180.0]]);
    seen.touch("touchMove", &[[160.0, 180.0], [320.0, 180.0]]);
    seen.touch("touchEnd", &[]);
    seen.browser.wait("location.hash.includes('camera=-20,-10,2,')");
    seen.canvas_after(&turned);
}

#[test]
fn a_label_says_what_is_seen_and_from_where() {
    let Some(mut seen) = VisiblePage::open(shapes()) else { return };
    seen.view("wave", "mesh");
    for (keys, label) in [
        (&["0"][..], "from the front"),
        (&["ArrowRight", "ArrowUp"], "15° to the right, 15° above"),
        (&["ArrowLeft", "ArrowLeft", "ArrowDown", "ArrowDown"], "15° to the left, 15° below"),
    ] {
        seen.press(keys);
        let told = seen.browser.ask("document.activeElement.ariaLabel");
        assert_eq!(told, format!("wave.mesh of run 1, {label}"));
        let live = "document.querySelector('.below .side[aria-live=polite]').textContent";
        assert_eq!(seen.browser.ask(live), label);
    }
}

/// Opens a page of the example graph `doll.ron`. Unlike `VisiblePage`, this function keeps the layout of the window.
fn page() -> Option<(Project, Server, Browser)> {
    let mut browser = Browser::start()?;
    let project = Project::doll();
    let mut served = Server::new(&project);
    served.watch.run_until_ok();
    browser.open(&served.link());
    browser.wait("document.querySelector('.frame canvas')?.dataset.shown");
    Some((project, served, browser))
}

#[test]
fn a_narrow_window_shows_all_of_it() {
    let Some((_project, _served, mut browser)) = page() else { return };
    let window = json!({ "width": 820, "height": 1180, "deviceScaleFactor": 1, "mobile": false });
    browser.call("Emulation.setDeviceMetricsOverride", window);
    browser.wait("innerWidth === 820 && document.querySelector('.frame canvas').width === 820");
    assert_eq!(browser.ask("document.documentElement.scrollWidth"), 820);
    let told = browser.ask(
        "Object.fromEntries(['header', '#graph', '.frame', 'aside', '#link'].map((name) => { \
         const area = document.querySelector(name).getBoundingClientRect(); \
         return [name, [area.left, area.top, area.right, area.bottom]]; }))",
    );
    fn edge(name: &str, k: usize, told: &serde_json::Value) -> f64 {
        told[name][k].as_f64().unwrap()
    }
    assert!(edge(".frame", 3, &told) - edge(".frame", 1, &told) > 200.0, "{told}");
    assert!(
        edge("aside", 1, &told) >= edge(".frame", 3, &told) && edge("aside", 3, &told) <= 1180.0,
        "{told}"
    );
    assert!(edge("#link", 2, &told) <= 820.0 && edge("#graph", 2, &told) <= 820.0, "{told}");
}

#[test]
fn nothing_moves_by_itself() {
    let Some((_project, _served, mut browser)) = page() else { return };
    let media = json!({ "features": [{ "name": "prefers-reduced-motion", "value": "reduce" }] });
    browser.call("Emulation.setEmulatedMedia", media);
    let moving = "[...document.querySelectorAll('*')].map((it) => getComputedStyle(it)).filter((style) => \
                  style.transitionDuration !== '0s' || style.animationName !== 'none' || style.scrollBehavior === 'smooth').length \
                  + document.getAnimations().length";
    assert_eq!(browser.ask(moving), 0);
}

#[test]
fn every_control_is_reached_by_tab_and_has_a_name() {
    let Some((_project, _served, mut browser)) = page() else { return };
    browser.ask(
        "window.controls = [...document.querySelectorAll('*')].filter((it) => it.tabIndex >= 0 && !it.disabled && \
         it.checkVisibility({ visibilityProperty: true })), document.activeElement.blur()",
    );
    let count = browser.ask("controls.length").as_u64().unwrap();
    let mut reached = std::collections::BTreeSet::new();
    for _ in 0..=count + 5 {
        browser.press("Tab", 0);
        let at = browser.ask("controls.indexOf(document.activeElement)").as_i64().unwrap();
        if at < 0 {
            continue;
        }
        reached.insert(at as u64);
        let focused = json!({ "expression": "document.activeElement" });
        let focused = browser.call("Runtime.evaluate", focused)["result"]["objectId"].clone();
        let asked = json!({ "objectId": focused, "fetchRelatives": false });
        let node = browser.call("Accessibility.getPartialAXTree", asked)["nodes"][0].take();
        let name = node["name"]["value"].as_str().unwrap_or_default();
        let html = browser.ask("document.activeElement.outerHTML.slice(0, 200)");
        assert!(!name.trim().is_empty(), "{html} has no name");
    }
    let missed = (0..count).filter(|at| !reached.contains(at));
    let missed = missed.map(|at| browser.ask(&format!("controls[{at}].outerHTML.slice(0, 200)")));
    assert_eq!(Vec::from_iter(missed), Vec::<serde_json::Value>::new());
    assert!(count > 25, "{count}");
}
