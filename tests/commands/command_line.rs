//! The program as its users see it.

use std::path::Path;
use std::process::{Command, Output};

use expect_test::expect;
use maquette::format::png;
use maquette::value::Image;

mod graph_tests;

const GRAPHS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../graphs");

fn maquette(arguments: &[&str]) -> Output {
    maquette_with_cache(tempfile::tempdir().unwrap().path(), arguments)
}

fn maquette_with_cache(cache: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_maquette"))
        .args(arguments)
        .env("MAQUETTE_CACHE", cache)
        .current_dir(GRAPHS)
        .env("NO_COLOR", "1")
        .output()
        .unwrap()
}

fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<_> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn run_writes_every_output_and_says_what_it_did() {
    let out = tempfile::tempdir().unwrap();
    let output = maquette(&["run", "doll.ron", "--out", out.path().to_str().unwrap()]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(
        names(out.path()),
        ["blended.pcd", "model.glb", "model.ply", "nose-mask.png", "surface.ply"]
    );
    assert!(stdout(&output).contains("computed  red"), "{}", stdout(&output));
    assert_eq!(stderr(&output), "");
}

#[test]
fn run_json_is_one_document_with_nodes_and_outputs() {
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().to_str().unwrap();
    let output =
        maquette(&["run", "doll.ron", "--out", folder, "--only", "nose-mask.png", "--json"]);
    let document: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let node_names: Vec<_> = document["nodes"]
        .as_array()
        .unwrap()
        .iter()
        .map(|node| node["name"].as_str().unwrap())
        .collect();
    assert_eq!(node_names, ["scan", "red"], "only what the output needs is evaluated");
    assert_eq!(document["outputs"][0]["name"], "nose-mask.png");
    assert_eq!(document["problems"], serde_json::json!([]));
    assert_eq!(names(out.path()), ["nose-mask.png"]);
}

#[test]
fn a_graph_with_inputs_is_called_with_files_and_finds_what_its_use_has_computed() {
    let [cache, out] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let folder = out.path().to_str().unwrap();
    let used = maquette_with_cache(cache.path(), &["run", "feature.ron", "--out", folder]);
    assert!(used.status.success(), "{}", stderr(&used));
    fn call(more: &[&str], cache: &tempfile::TempDir, folder: &str) -> Output {
        let inputs = ["--input", "color=doll/color.png", "--input", "range=doll/range.pcd"];
        let set = ["--set", "hue=#724d31", "--set", "near=22.0", "--set", "growth=9.0"];
        let called = ["run", "lib/feature.ron", "--out", folder];
        maquette_with_cache(cache.path(), &[&called, &inputs[..], &set, more].concat())
    }
    let called = call(&[], &cache, folder);
    assert!(called.status.success(), "{}", stderr(&called));
    assert!(stdout(&called).contains("2 computed, 8 equal"), "{}", stdout(&called));
    assert!(out.path().join("range.pcd").exists() && out.path().join("region.ply").exists());
    let inputs = ["--input", "color=doll/color.png", "--input", "range=doll/range.pcd"];
    let mask = out.path().join("mask.png");
    let seen = ["inspect", "lib/feature.ron", "mask", "--out", mask.to_str().unwrap()];
    let seen = maquette_with_cache(cache.path(), &[&seen[..], &inputs].concat());
    assert!(seen.status.success() && mask.exists(), "{}", stderr(&seen));
    let list = maquette(&[&["watch", "lib/feature.ron", "--list"][..], &inputs].concat());
    for file in ["color.png  an input", "camera.json  read with an input"] {
        assert!(stdout(&list).contains(file), "{}", stdout(&list));
    }
    let why = maquette_with_cache(cache.path(), &["why", "lib/feature.ron", "color"]);
    assert!(stdout(&why).contains("`color` runs: it gets another value"), "{}", stdout(&why));
    let one = stdout(&call(&["--only", "range"], &cache, folder));
    assert!(one.contains("range.pcd") && !one.contains("region.ply"), "{one}");

    let wrong = call(&["--input", "rang=doll/range.pcd"], &cache, folder);
    assert_eq!(wrong.status.code(), Some(1));
    assert!(stderr(&wrong).contains("the graph has no input `rang`"), "{}", stderr(&wrong));
    let wrong = maquette(&["run", "doll.ron", "--input", "range=doll/range.pcd", "--out", folder]);
    assert!(stderr(&wrong).contains("it has no inputs at all"), "{}", stderr(&wrong));
    let wrong = maquette(&["run", "lib/feature.ron", "--input", "range=doll/mug.obj"]);
    let told = "no RangeImage can be read from `.obj`; supported extensions: pcd, ply";
    assert!(stderr(&wrong).contains(told), "{}", stderr(&wrong));
}

#[test]
fn a_test_case_calls_a_graph_with_files() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["color.png", "range.pcd", "camera.json"] {
        let from = Path::new(GRAPHS).join("doll").join(name);
        std::fs::copy(from, folder.path().join(name)).unwrap();
    }
    std::fs::copy(Path::new(GRAPHS).join("lib/feature.ron"), folder.path().join("feature.ron"))
        .unwrap();
    fn write(inputs: &str, folder: &tempfile::TempDir) -> Output {
        let test = format!(
            r#"Test(graph: "feature.ron", cases: {{ "nose": (inputs: {inputs}) }},
            expect: [Count(of: "region", what: "cells", min: 100)])"#
        );
        std::fs::write(folder.path().join("feature.test.ron"), test).unwrap();
        maquette(&["test", folder.path().to_str().unwrap()])
    }
    let unseen = write(r#"{ "color": "color.png", "range": "range.pcd" }"#, &folder);
    let told = [stdout(&unseen), stderr(&unseen)].concat();
    assert!(told.contains("spot: there is no golden"), "{told}");
    assert!(!told.contains("error"), "{told}");
    let outside = write(r#"{ "color": "../color.png" }"#, &folder);
    assert!(stderr(&outside).contains("input `color`: "), "{}", stderr(&outside));
}

#[test]
fn set_changes_a_parameter_or_a_field() {
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().to_str().unwrap();
    fn run(set: &[&str], folder: &str) -> Option<String> {
        let base = ["run", "doll.ron", "--out", folder, "--only", "blended.pcd", "--json"];
        let output = maquette(&[&base, set].concat());
        let document: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        document["outputs"][0]["hash"].as_str().map(str::to_owned)
    }
    let plain = run(&[], folder);
    assert_eq!(run(&["--set", "growth=12.0"], folder), plain);
    assert_ne!(run(&["--set", "growth=20"], folder), plain);
    assert_ne!(run(&["--set", "blended.mode=Replace"], folder), plain);
    assert_eq!(run(&["--set", "growth=99"], folder), None, "99 is out of range");
}

#[test]
fn an_empty_selection_names_the_nearest_pixel() {
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().to_str().unwrap();
    let set = "red.select=Near(color: \"#00ff00\", distance: 5.0)";
    let output =
        maquette(&["run", "doll.ron", "--out", folder, "--only", "nose-mask.png", "--set", set]);
    assert!(output.status.success());
    let messages = stderr(&output);
    assert!(
        messages.contains("warning[G017]: `red`: nothing is selected: the closest pixel is #"),
        "{messages}"
    );
    assert!(messages.contains(" where 5.0 is allowed"), "{messages}");
}

#[test]
fn a_failed_node_leaves_the_older_file_and_the_other_outputs() {
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().to_str().unwrap();
    std::fs::write(out.path().join("model.ply"), "older").unwrap();
    let output = maquette(&["run", "doll.ron", "--out", folder, "--set", "nose.pick=Rank(99)"]);
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(names(out.path()), ["model.ply", "nose-mask.png"]);
    assert_eq!(std::fs::read(out.path().join("model.ply")).unwrap(), b"older");
    assert!(
        stderr(&output).contains("error[G016]: `nose` cannot be computed"),
        "{}",
        stderr(&output)
    );
}

#[test]
fn an_output_that_cannot_be_written_is_an_error_and_leaves_nothing() {
    let out = tempfile::tempdir().unwrap();
    std::fs::create_dir(out.path().join("nose-mask.png")).unwrap();
    let folder = out.path().to_str().unwrap();
    let output = maquette(&["run", "doll.ron", "--out", folder, "--only", "nose-mask.png"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("cannot write"), "{}", stderr(&output));
    assert_eq!(names(out.path()), ["nose-mask.png"], "no temporary file is left");
}

#[test]
fn an_output_does_not_overwrite_the_picture_beside_a_model() {
    let folder = tempfile::tempdir().unwrap();
    for file in ["color.png", "range.pcd"] {
        std::fs::copy(Path::new(GRAPHS).join("doll").join(file), folder.path().join(file)).unwrap();
    }
    let graph = folder.path().join("skin.ron");
    let text = r#"Graph(format: 1, nodes: {
        "scan": ReadCapture(color: "color.png", range: "range.pcd"),
        "skin": Triangulate(range: "scan.range"),
        "painted": Texture(mesh: "skin", image: "scan.color"),
    }, outputs: { "skin.obj": "painted", "skin.png": "painted" })"#;
    std::fs::write(&graph, text).unwrap();
    let out = folder.path().join("out");
    let output = maquette(&["run", graph.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    let messages = stderr(&output);
    assert!(messages.contains("`skin.obj` also writes skin.png, another output"), "{messages}");
    assert_eq!(names(&out), ["skin.png"]);
}

#[test]
fn outputs_whose_pictures_would_have_one_name_are_an_error() {
    let folder = tempfile::tempdir().unwrap();
    for file in ["pictured.obj", "pictured.mtl", "picture.png"] {
        let inputs = Path::new(GRAPHS).join("../tests/readers/inputs");
        std::fs::copy(inputs.join(file), folder.path().join(file)).unwrap();
    }
    let graph = folder.path().join("box.ron");
    let outputs = r#""a #1.obj": "box", "a__1.obj": "box", "b.obj": "box""#;
    let text = format!(
        r#"Graph(format: 1, nodes: {{ "box": ReadMesh(path: "pictured.obj") }}, outputs: {{ {outputs} }})"#
    );
    std::fs::write(&graph, text).unwrap();
    let out = folder.path().join("out");
    let output = maquette(&["run", graph.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    let messages = stderr(&output);
    let text = "`a__1.obj` also writes a file that `a #1.obj` writes";
    assert!(messages.contains(text), "{messages}");
    assert_eq!(messages.matches("error").count(), 1, "{messages}");
}

#[test]
fn exit_codes_tell_a_wrong_graph_from_a_wrong_command() {
    assert_eq!(maquette(&["check", "doll.ron"]).status.code(), Some(0));
    assert_eq!(maquette(&["check", "nowhere.ron"]).status.code(), Some(1));
    assert_eq!(maquette(&["chekc", "doll.ron"]).status.code(), Some(2));
    assert_eq!(maquette(&["run", "doll.ron", "--only", "model.gbl"]).status.code(), Some(2));
    assert_eq!(maquette(&["inspect", "doll.ron", "nsoe"]).status.code(), Some(2));
    assert_eq!(maquette(&["nodes", "Threshhold"]).status.code(), Some(2));
    let wrong = maquette(&["run", "doll.ron", "--only", "model.gbl"]);
    expect![["error: the graph has no output `model.gbl`; did you mean `model.glb`?\n"]]
        .assert_eq(&stderr(&wrong));
}

#[test]
fn the_eyedropper_tells_color_and_point() {
    let output = maquette(&["inspect", "doll.ron", "scan", "--at", "200,196"]);
    let text = stdout(&output);
    for fact in ["scan.color: Image at (200, 196)", "sRGB", "Lab", "range cell", "point (mm)"] {
        assert!(text.contains(fact), "{fact} is missing:\n{text}");
    }
    let label = maquette(&["inspect", "doll.ron", "spots", "--at", "200,196", "--json"]);
    let document: serde_json::Value = serde_json::from_slice(&label.stdout).unwrap();
    assert!(document["outputs"][0]["facts"]["label"].as_u64().unwrap() > 0, "{document}");
}

#[test]
fn inspect_describes_and_writes_any_value() {
    let out = tempfile::tempdir().unwrap();
    let path = out.path().join("grid.png");
    let output = maquette(&["inspect", "doll.ron", "grid", "--out", path.to_str().unwrap()]);
    assert!(stdout(&output).contains("non-manifold edges    0"), "{}", stdout(&output));
    assert!(png::read(&std::fs::read(path).unwrap()).is_ok());
}

#[test]
fn nodes_prints_the_reference_for_people_and_programs() {
    let list = stdout(&maquette(&["nodes"]));
    let line = list.lines().find(|line| line.starts_with("  Threshold ")).unwrap();
    assert!(
        line.ends_with(" Selects pixels by color or brightness, and returns them as a mask."),
        "{line}"
    );
    let document: serde_json::Value =
        serde_json::from_slice(&maquette(&["nodes", "--json"]).stdout).unwrap();
    let nodes = document["nodes"].as_array().unwrap();
    let threshold = nodes.iter().find(|node| node["name"] == "Threshold").unwrap();
    assert_eq!(threshold["inputs"][1]["optional"], true);
    assert_eq!(threshold["outputs"][0]["types"][0], "Mask");
}

#[test]
fn completions_are_printed_for_a_shell() {
    assert!(stdout(&maquette(&["completions", "bash"])).contains("_maquette"));
}

#[test]
fn draw_needs_no_files_and_writes_svg_or_dot() {
    let folder = tempfile::tempdir().unwrap();
    let graph = folder.path().join("doll.ron");
    std::fs::copy(Path::new(GRAPHS).join("doll.ron"), &graph).unwrap();
    let graph = graph.to_str().unwrap();
    assert!(!maquette(&["check", graph]).status.success(), "the capture is not there");
    let svg = maquette(&["draw", graph]);
    assert!(svg.status.success() && stdout(&svg).starts_with("<svg "), "{}", stderr(&svg));
    let file = folder.path().join("doll.dot");
    let dot = maquette(&["draw", graph, "--out", file.to_str().unwrap()]);
    assert!(dot.status.success(), "{}", stderr(&dot));
    let text = std::fs::read_to_string(&file).unwrap();
    assert!(text.contains("subgraph \"cluster_nurbs\""), "{text}");
    assert_eq!(stdout(&maquette(&["draw", graph, "--dot"])), text);
}

#[test]
fn draw_reports_a_broken_graph_and_unknown_endings() {
    let folder = tempfile::tempdir().unwrap();
    let graph = folder.path().join("graph.ron");
    fn draw(node: &str, graph: &Path) -> Output {
        let text = format!("Graph(format: 1, nodes: {{ \"a\": {node} }}, outputs: {{}})");
        std::fs::write(graph, text).unwrap();
        maquette(&["draw", graph.to_str().unwrap()])
    }
    let broken = draw("ReadMesh(file: \"a.obj\")", &graph);
    assert_eq!((broken.status.code(), stdout(&broken)), (Some(1), String::new()));
    assert!(stderr(&broken).contains("ReadMesh has no field `file`"));
    let unknown = draw("Nothing()", &graph);
    assert!(unknown.status.success() && stdout(&unknown).starts_with("<svg"));
    assert!(stderr(&unknown).contains("warning[G003]: there is no node type `Nothing`"));
    assert_eq!(maquette(&["draw", "doll.ron", "--out", "doll.png"]).status.code(), Some(2));
}

#[test]
fn a_second_run_computes_nothing_and_a_third_says_why_it_would() {
    let (cache, out) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let folder = out.path().to_str().unwrap();
    fn run(more: &[&str], cache: &tempfile::TempDir, folder: &str) -> Output {
        maquette_with_cache(cache.path(), &[&["run", "doll.ron", "--out", folder], more].concat())
    }
    let first = stdout(&run(&[], &cache, folder));
    assert!(first.contains("15 nodes: 15 computed"), "{first}");
    let before = std::fs::read(out.path().join("model.glb")).unwrap();
    let second = stdout(&run(&[], &cache, folder));
    assert!(second.contains("15 nodes: 15 cached"), "{second}");
    assert_eq!(std::fs::read(out.path().join("model.glb")).unwrap(), before);

    let dry = stdout(&run(&["-n", "--set", "growth=25"], &cache, folder));
    assert!(
        dry.contains("runs      raised   parameter `distance` 12 -> 25, doll.ron:22:78"),
        "{dry}"
    );
    assert!(dry.contains("may run   model    depends on `skin`"), "{dry}");
    fn run_why(node: &str, cache: &tempfile::TempDir) -> String {
        let why = ["why", "doll.ron", node, "--set", "growth=25"];
        stdout(&maquette_with_cache(cache.path(), &why))
    }
    assert_eq!(
        run_why("nose", &cache),
        "`nose` does not run: nothing that it depends on changed\n"
    );
    expect![[r#"
        `skin` runs if the result of a dependency changes:
          `raised` runs: parameter `distance` 12 -> 25, doll.ron:22:78
    "#]]
    .assert_eq(&run_why("skin", &cache));

    let usage = stdout(&maquette_with_cache(cache.path(), &["cache", "ls"]));
    assert!(usage.contains("of 1 build") && usage.contains("1 graph"), "{usage}");
    let cleared = stdout(&maquette_with_cache(cache.path(), &["cache", "clear"]));
    assert!(cleared.starts_with("dropped "), "{cleared}");
    let again = stdout(&run(&[], &cache, folder));
    assert!(again.contains("15 nodes: 15 computed"), "{again}");
}

#[test]
fn a_folder_that_is_no_cache_is_not_cleared() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("precious.txt"), "keep me").unwrap();
    let output = maquette_with_cache(folder.path(), &["cache", "clear"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("is not a cache of maquette"), "{}", stderr(&output));
    assert!(folder.path().join("precious.txt").exists());
}

#[test]
fn profile_prints_a_table_and_writes_a_trace() {
    let out = tempfile::tempdir().unwrap();
    let output = maquette(&["run", "doll.ron", "--profile", "--out", out.path().to_str().unwrap()]);
    let text = stdout(&output);
    assert!(text.contains("node") && text.contains("memory") && text.contains("100 %"), "{text}");
    for (name, state) in [("graph", "read"), ("files", "read"), ("model.glb", "written")] {
        let row = text.lines().find(|row| row.starts_with(&format!("{name} ")));
        let row = row.unwrap_or_else(|| panic!("the table has no row of {name}:\n{text}"));
        assert!(row.contains(state) && row.contains(" ms "), "{row}");
    }
    let trace = std::fs::read(out.path().join("doll.trace.json")).unwrap();
    let trace: serde_json::Value = serde_json::from_slice(&trace).unwrap();
    assert_eq!(trace["traceEvents"].as_array().unwrap().len(), 15);
}

#[test]
fn files_are_compared_by_what_they_mean_and_rendered() {
    let out = tempfile::tempdir().unwrap();
    fn path(name: &str, out: &tempfile::TempDir) -> String {
        out.path().join(name).to_str().unwrap().to_owned()
    }
    for scale in ["(1, 1, 1)", "(1, 1, 1.001)"] {
        let set = format!("lying.scale={scale}");
        let folder = path(scale, &out);
        assert!(
            maquette(&["run", "nodes/Transform.ron", "--set", &set, "--out", &folder])
                .status
                .success()
        );
    }
    let (a, b) = (path("(1, 1, 1)/lying.ply", &out), path("(1, 1, 1.001)/lying.ply", &out));
    fn compare(more: &[&str], a: &str, b: &str) -> Output {
        maquette(&[&["compare", a, b], more].concat())
    }
    assert_eq!(compare(&[], &a, &b).status.code(), Some(1));
    let within = compare(&["--max", "1"], &a, &b);
    assert!(
        within.status.success() && stdout(&within).starts_with("within tolerance"),
        "{}",
        stdout(&within)
    );
    assert!(stdout(&maquette(&["compare", &a, &a])).starts_with("identical"));
    assert_eq!(maquette(&["compare", &a, "nowhere.ply"]).status.code(), Some(2));
    for arguments in [
        vec![&a[..]],
        vec!["nodes/Transform.ron", "lying.ply"],
        vec!["nodes/Transform.ron", "doll"],
    ] {
        let picture = path("a.png", &out);
        let output = maquette(
            &[
                &["render"],
                &arguments[..],
                &[&picture, "--camera", "-30,20,1.2", "--size", "40x30"],
            ]
            .concat(),
        );
        assert!(output.status.success(), "{}", stderr(&output));
        let picture = png::read(&std::fs::read(picture).unwrap()).unwrap();
        assert_eq!((picture.width(), picture.height()), (40, 30));
    }
}

#[test]
fn a_model_comes_with_the_picture_that_its_material_names() {
    let folder = tempfile::tempdir().unwrap();
    fn write(name: &str, bytes: &[u8], folder: &tempfile::TempDir) {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    let model = "mtllib quad.mtl\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
        usemtl paint\nf 1/1 2/2 3/3 4/4\n";
    let red = Image::new(2, 2, vec![[220, 10, 10]; 4]).unwrap();
    write("quad.obj", model.as_bytes(), &folder);
    write("quad.mtl", b"newmtl paint\nmap_Kd red paint.png\n", &folder);
    write("red paint.png", &png::encode_rgb(&red).unwrap(), &folder);
    write(
        "a.ron",
        br#"Graph(format: 1, nodes: { "m": ReadMesh(path: "quad.obj") }, outputs: { "b.obj": "m" })"#,
        &folder,
    );
    fn path_in(name: &str, folder: &tempfile::TempDir) -> String {
        folder.path().join(name).to_str().unwrap().to_owned()
    }

    let picture = path_in("front.png", &folder);
    let output = maquette(&["render", &path_in("quad.obj", &folder), &picture, "--size", "40x40"]);
    assert_eq!(stderr(&output), "");
    let [r, g, b] = png::read(&std::fs::read(&picture).unwrap()).unwrap().pixel([20, 20]);
    assert!(g.max(b) < 100 && 100 < r, "{r} {g} {b}");

    let cache = tempfile::tempdir().unwrap();
    fn run(cache: &tempfile::TempDir, folder: &tempfile::TempDir) -> String {
        let output = maquette_with_cache(
            cache.path(),
            &["run", &path_in("a.ron", folder), "--out", &path_in("out", folder)],
        );
        assert!(output.status.success(), "{}", stderr(&output));
        stderr(&output)
    }
    assert_eq!(run(&cache, &folder), "");
    let copy = std::fs::read(folder.path().join("out/b.png")).unwrap();
    assert_eq!(png::read(&copy).unwrap(), red);
    std::fs::remove_file(path_in("red paint.png", &folder)).unwrap();
    let text = "there is no file `red paint.png`: the mesh comes without its picture";
    assert!(run(&cache, &folder).contains(text), "the picture is a part of what was read");
    let output = maquette(&["render", &path_in("quad.obj", &folder), &picture]);
    assert_eq!(stderr(&output), format!("warning: {text}\n"));
}

#[test]
fn what_a_graph_expects_is_checked_when_it_runs() {
    let folder = graph_tests::tested_graph();
    let graph = folder.path().join("net.ron");
    let text = std::fs::read_to_string(&graph).unwrap();
    let expecting = |expect: &str| {
        std::fs::write(&graph, text.replace("outputs:", &format!("expect: [{expect}],\noutputs:")))
            .unwrap();
        maquette(&["run", graph.to_str().unwrap(), "--out", folder.path().to_str().unwrap()])
    };
    assert!(expecting("Manifold(\"mesh\"), NoSelfIntersection(\"surface\"), Near(of: \"mesh\", to: \"surface\", max: 0.1)").status.success());
    let open = expecting("Closed(\"mesh\")");
    assert_eq!(open.status.code(), Some(1));
    assert!(
        stderr(&open)
            .contains("error[G020]: expected Closed, but `mesh` has 32 edges with one face"),
        "{}",
        stderr(&open)
    );
    let unknown = expecting("Closed(\"mush\")");
    assert!(stderr(&unknown).contains("there is no node `mush`"), "{}", stderr(&unknown));
    assert!(stderr(&expecting("Closd(\"mesh\")")).contains("did you mean `Closed`?"));
    assert!(
        stderr(&expecting("Count(of: \"mesh\", what: \"faces\", max: 10)"))
            .contains("has 64 faces, expected at most 10")
    );
}
