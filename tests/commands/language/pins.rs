//! A pinned result replaces its node, whatever happens to the cache. A stale pin is a warning, and a pin without its bytes is an error.

use std::collections::BTreeMap;
use std::path::PathBuf;

use maquette::rng::Random;
use serde_json::Value as Json;

use crate::output::text_of;
use crate::project::Project;

/// Returns a graph whose node `skin` has this number of levels, and which uses another graph.
fn graph(levels: &str) -> String {
    format!(
        r#"Graph(
            format: 1,
            use: {{ "Part": "part.ron" }},
            nodes: {{
                "coarse": ReadMesh(path: "doll/coarse.obj"),
                "skin": Subdivide(mesh: "coarse", scheme: Loop, levels: {levels}),
                "part": Part(mesh: "skin", scale: 2.0),
                "end": Transform(mesh: "part", translate: (1, 0, 0)),
            }},
            outputs: {{ "end.ply": "end" }},
        )"#
    )
}

const PART: &str = r#"Graph(
    format: 1,
    inputs: { "mesh": Mesh() },
    params: { "scale": Number(default: 1.0, doc: "How large.") },
    nodes: { "big": Transform(mesh: "mesh", scale: (Param("scale"), 1, 1)) },
    outputs: { "mesh": "big" },
)"#;

fn project() -> Project {
    let project = Project::doll();
    project.copy_asset("coarse.obj", "doll/coarse.obj");
    std::fs::write(project.folder().join("part.ron"), PART).unwrap();
    project.save(&graph("1"));
    project
}

/// Runs a command that must succeed and returns its output.
fn ok(project: &Project, words: &[&str]) -> String {
    let output = project.maquette(words);
    let told = text_of(&output);
    assert!(output.status.success(), "{words:?}: {told}");
    told
}

/// Runs a command that must fail and returns its output.
fn fails(project: &Project, words: &[&str]) -> String {
    let output = project.maquette(words);
    let told = text_of(&output);
    assert!(!output.status.success() && !told.contains("panicked"), "{words:?}: {told}");
    told
}

const RUN: [&str; 5] = ["run", "doll.ron", "--out", "out", "--no-provenance"];

/// Runs the graph; returns the output and the mesh that it writes.
fn run(project: &Project, more: &[&str]) -> (String, Vec<u8>) {
    let told = ok(project, &[&RUN, more].concat());
    (told, project.outputs().remove("end.ply").unwrap())
}

/// Returns the only file of a pinned result.
fn pin_file(project: &Project) -> PathBuf {
    let mut files = std::fs::read_dir(project.folder().join("doll.pins")).unwrap();
    files.next().unwrap().unwrap().path()
}

const STALE: &str = "`skin` is pinned before `levels` changed (1 -> 2)";

#[test]
fn a_pinned_node_is_not_run_and_a_stale_pin_is_loud() {
    let project = project();
    let (_, one_level) = run(&project, &[]);
    assert!(ok(&project, &["pin", "doll.ron", "skin"]).starts_with("pinned skin  doll.pins/"));
    let (told, end) = run(&project, &["--no-cache"]);
    assert!(told.contains("Pinned") && !told.contains("Subdivide"), "{told}");
    assert!(!told.contains("coarse"), "what only a pinned node needs is not run: {told}");
    assert!(end == one_level);

    project.save(&graph("2"));
    let watch = ["watch", "doll.ron", "--once", "--out", "out", "--no-provenance"];
    for words in [
        &RUN[..],
        &watch,
        &["check", "doll.ron"],
        &["why", "doll.ron", "skin"],
        &["inspect", "doll.ron", "skin"],
        &["pin", "doll.ron", "--list"],
    ] {
        let told = ok(&project, words);
        assert!(told.contains(STALE), "{words:?}: {told}");
        assert!(project.outputs()["end.ply"] == one_level, "a stale pin is used as it was");
    }
    let why = ok(&project, &["why", "doll.ron", "skin"]);
    assert!(why.contains("`skin` does not run: its result is pinned"), "{why}");

    // A run can ignore pins. After a pin is removed, no output and no file shows that it existed.
    let (told, two_levels) = run(&project, &["--no-pins"]);
    assert!(!told.to_lowercase().contains("pinned"), "{told}");
    assert!(two_levels != one_level);
    assert_eq!(ok(&project, &["pin", "--remove", "doll.ron", "skin"]), "unpinned skin\n");
    let (told, end) = run(&project, &[]);
    assert!(!told.to_lowercase().contains("pinned") && end == two_levels, "{told}");
    for left in ["doll.pins.ron", "doll.pins"] {
        assert!(!project.folder().join(left).exists(), "{left} holds nothing");
    }
    assert!(
        fails(&project, &["pin", "--remove", "doll.ron", "skin"]).contains("`skin` is not pinned")
    );
    assert!(!project.folder().join("doll.pins.ron").exists(), "nothing is written for nothing");
}

#[test]
fn a_pin_survives_the_cache_and_is_an_error_without_its_bytes() {
    let project = project();
    ok(&project, &["pin", "doll.ron", "skin"]);
    ok(&project, &["cache", "clear"]);
    assert!(!run(&project, &[]).0.contains("Subdivide"));
    let file = pin_file(&project);
    let bytes = std::fs::read(&file).unwrap();
    for damaged in [bytes[..bytes.len() - 1].to_vec(), Vec::new(), [&bytes[..], b"x"].concat(), {
        let mut bytes = bytes.clone();
        bytes[4000] ^= 1;
        bytes
    }] {
        std::fs::write(&file, &damaged).unwrap();
        let told = fails(&project, &[&RUN[..], &["--no-cache"]].concat());
        assert!(told.contains("its pinned result doll.pins/") && told.contains("is damaged"));
    }
    std::fs::remove_file(&file).unwrap();
    for words in [&RUN[..], &["check", "doll.ron"], &["pin", "doll.ron", "--list"]] {
        let told = fails(&project, words);
        assert!(told.contains("`skin` is pinned, but its result doll.pins/"), "{told}");
    }
    std::fs::write(&file, &bytes).unwrap();
    run(&project, &["--no-cache"]);
}

#[test]
fn nodes_inside_of_uses_are_pinned_and_pins_without_a_node_are_told() {
    let project = project();
    assert!(ok(&project, &["pin", "doll.ron", "part"]).starts_with("pinned part/big  "));
    let told = ok(&project, &["pin", "doll.ron", "--list"]);
    assert!(told.starts_with("part/big  Mesh\n"), "{told}");
    let (told, _) = run(&project, &[]);
    assert!(!told.contains("Subdivide") && told.contains("part/big"), "{told}");
    // `skin` has changed, a node on which the pinned node depends.
    project.save(&graph("2"));
    let told = ok(&project, &["check", "doll.ron"]);
    assert!(told.contains("`part/big` is pinned before `skin.levels` changed (1 -> 2)"), "{told}");
    // Renaming a node on which the pinned node depends does not make the pin stale.
    project.save(&graph("1").replace("\"skin\"", "\"hull\""));
    assert!(ok(&project, &["check", "doll.ron"]).contains("0 errors\n"));
    project.save(&graph("1").replace("\"part\"", "\"piece\""));
    let told = ok(&project, &["check", "doll.ron"]);
    assert!(told.contains("`part/big` is pinned, but the graph has no such node"), "{told}");
    assert!(told.contains("doll.pins.ron:5:"), "{told}");
    let told = fails(&project, &["pin", "--remove", "doll.ron", "piece"]);
    assert!(told.contains("`piece` is not pinned; pinned are: part/big"), "{told}");
    assert_eq!(ok(&project, &["pin", "--remove", "doll.ron", "part"]), "unpinned part/big\n");
}

#[test]
fn another_file_makes_a_pin_stale_and_a_draft_does_not() {
    let project = project();
    let drafted = graph("Draft(final: 1, draft: 0)");
    project.save(&drafted);
    ok(&project, &["pin", "doll.ron", "skin"]);
    assert!(!run(&project, &["--draft"]).0.contains("is pinned before"));
    project.save(&drafted.replace("final: 1", "final: 2"));
    assert!(run(&project, &["--draft"]).0.contains(STALE), "a draft is no excuse");
    project.save(&drafted);
    let path = project.folder().join("doll/coarse.obj");
    let mesh = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, mesh + "# more\n").unwrap();
    let told = ok(&project, &["check", "doll.ron"]);
    assert!(told.contains("`skin` is pinned before file doll/coarse.obj changed"), "{told}");
}

#[test]
fn a_file_that_a_file_names_makes_a_pin_stale_too() {
    let project = project();
    fn write(name: &str, text: &str, project: &Project) {
        std::fs::write(project.folder().join(name), text).unwrap();
    }
    write(
        "a.obj",
        "mtllib a.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n",
        &project,
    );
    write("a.mtl", "newmtl a\nmap_Kd doll/color.png\n", &project);
    project.save(r#"Graph(format: 1, nodes: { "a": ReadMesh(path: "a.obj"), "b": Transform(mesh: "a") }, outputs: { "b.glb": "b" })"#);
    ok(&project, &["pin", "doll.ron", "b"]);
    assert!(!ok(&project, &["check", "doll.ron"]).contains("is pinned before"));
    write("a.mtl", "newmtl a\nKd 1 0 0\n", &project);
    let told = ok(&project, &["check", "doll.ron"]);
    assert!(told.contains("`b` is pinned before file a.obj changed"), "{told}");
}

#[test]
fn a_pin_of_other_types_stands_in_for_nothing() {
    let project = project();
    ok(&project, &["pin", "doll.ron", "coarse"]);
    project.save(&graph("1").replace(
        "\"coarse\": ReadMesh(path: \"doll/coarse.obj\")",
        "\"coarse\": Triangulate(range: \"scan\"), \"scan\": ReadRange(path: \"doll/range.pcd\")",
    ));
    let told = ok(&project, &["check", "doll.ron"]);
    let became = "`coarse` is pinned before `coarse` became a Triangulate (it was a ReadMesh)";
    assert!(told.contains(became), "{told}");
    project.save(
        r#"Graph(format: 1, nodes: { "coarse": ReadRange(path: "doll/range.pcd") }, outputs: { "a.pcd": "coarse" })"#,
    );
    let told = fails(&project, &["check", "doll.ron"]);
    assert!(
        told.contains("`coarse` is pinned with Mesh, and gives RangeImage, Image now"),
        "{told}"
    );
}

#[test]
fn what_cannot_be_pinned_is_told_with_what_can() {
    let project = project();
    project.save(
        r##"Graph(
            format: 1,
            use: { "Part": "part.ron" },
            nodes: {
                "coarse": ReadMesh(path: "doll/coarse.obj"),
                "piece": ForEach(graph: "Part", over: Parts("coarse")),
                "all": Merge(meshes: ["piece"]),
            },
            outputs: { "end.ply": "all" },
        )"##,
    );
    for name in ["piece", "piece/1/big"] {
        let told = fails(&project, &["pin", "doll.ron", name]);
        assert!(told.contains("pin its data, or a node that uses all elements"), "{told}");
    }
    let told = fails(&project, &["pin", "doll.ron", "al"]);
    assert!(told.contains("the graph has no node `al`") && told.contains("`all`"), "{told}");
    // The pinned node `all` collects the elements. Its result is known, so no element is computed.
    let (_, before) = run(&project, &[]);
    ok(&project, &["pin", "doll.ron", "all"]);
    let (told, after) = run(&project, &["--no-cache"]);
    assert!(!told.contains("piece") && before == after, "{told}");
}

#[test]
fn goldens_of_a_pinned_graph_are_judged_without_its_pins() {
    let project = project();
    std::fs::write(project.folder().join("doll.test.ron"), "Test(graph: \"doll.ron\")").unwrap();
    ok(&project, &["pin", "doll.ron", "skin"]);
    project.save(&graph("2"));
    let bless = project.command(&["test", ".", "--bless"]).env_remove("CI").output().unwrap();
    assert!(bless.status.success(), "{}", text_of(&bless));
    ok(&project, &["pin", "--remove", "doll.ron", "skin"]);
    ok(&project, &["test", "."]);
}

#[test]
fn a_file_of_pins_that_is_none_is_an_error_at_its_place() {
    let project = project();
    for (text, expected) in [
        ("Pins(format: 1, pins: { \"skin\": 3 })", "\"skin\" is no pin"),
        ("Pins(pins: {})", "a file of pins begins with `Pins(format: 1, ..)`"),
        ("Pins(format: 1)", "a file of pins needs a map `pins`"),
        ("Pins(format: 1, pins: {", "doll.pins.ron:1:"),
        ("", "doll.pins.ron"),
        // The help must not suggest to delete the file: the pins of both sides would be lost.
        (
            "<<<<<<< a\nPins(format: 1, pins: {})\n=======\nPins()\n>>>>>>> b\n",
            "resolve each conflict",
        ),
    ] {
        std::fs::write(project.folder().join("doll.pins.ron"), text).unwrap();
        for words in
            [&RUN[..], &["pin", "--remove", "doll.ron", "skin"], &["pin", "doll.ron", "skin"]]
        {
            let told = fails(&project, words);
            assert!(told.contains(expected) || words[1] == "--remove", "{words:?}: {told}");
        }
        let unchanged = std::fs::read_to_string(project.folder().join("doll.pins.ron")).unwrap();
        assert_eq!(unchanged, text, "nothing is written over it");
    }
}

#[test]
fn outputs_tell_of_pins_and_are_made_again_with_them() {
    let project = project();
    ok(&project, &["pin", "doll.ron", "skin"]);
    project.save(&graph("2"));
    ok(&project, &["run", "doll.ron", "--out", "out"]);
    let told = ok(&project, &["replay", "out/end.ply", "--graph", "doll.ron"]);
    assert!(told.contains(STALE), "{told}");
    ok(&project, &["pin", "--remove", "doll.ron", "skin"]);
    let told = fails(&project, &["replay", "out/end.ply", "--graph", "doll.ron"]);
    assert!(told.contains("pin `skin` is not there any more"), "{told}");
}

#[test]
fn a_watch_takes_up_pins_while_it_runs() {
    let project = project();
    let mut watch = project.watch(&["--no-provenance"]);
    let without = project.outputs();
    // `skin` is pinned with two levels and then set back to one level, so its pin is stale but used.
    project.save(&graph("2"));
    watch.run_until_ok();
    let with = project.outputs();
    ok(&project, &["pin", "doll.ron", "skin"]);
    project.save(&graph("1"));
    let mut run = watch.run_until_ok();
    while !run.problems.to_string().contains("is pinned before `levels` changed (2 -> 1)") {
        run = watch.run_until_ok();
    }
    assert!(project.outputs() == with);
    ok(&project, &["pin", "--remove", "doll.ron", "skin"]);
    watch.run_until_ok();
    assert!(project.outputs() == without);
}

/// A chain of three nodes that scale a mesh.
const CHAIN: [&str; 3] = ["a", "b", "c"];

fn chain(times: [u32; 3]) -> String {
    let nodes = CHAIN.iter().zip(["start", "a", "b"]).zip(times).map(|((name, of), times)| {
        format!("\"{name}\": Transform(mesh: \"{of}\", scale: ({times}, {times}, {times})),\n")
    });
    let nodes = String::from_iter(nodes);
    format!(
        "Graph(format: 1, nodes: {{ \"start\": ReadMesh(path: \"doll/coarse.obj\"), {nodes} }}, outputs: {{ \"end.ply\": \"c\" }})"
    )
}

/// Random sequences of edits, pins, unpins and cleared caches give the results of a simple model without state.
#[test]
fn any_sequence_of_pins_and_edits_is_as_said() {
    let project = project();
    fn area(project: &Project) -> f64 {
        let told = project.maquette(&["inspect", "doll.ron", "c", "--json"]);
        let told: Json = serde_json::from_slice(&told.stdout).unwrap();
        told["outputs"][0]["facts"]["area"].as_f64().unwrap()
    }
    let mut random = Random(20_261_125);
    let mut times = [1, 1, 1];
    // For each pinned node: the scales of the chain up to that node at the time of pinning.
    let mut pinned: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
    project.save(&chain(times));
    let start = area(&project);
    for turn in 0..60 {
        let node = random.next_below(3);
        match random.next_below(6) {
            0 | 1 => {
                times[node] = 1 + u32::try_from(random.next_below(4)).unwrap();
                project.save(&chain(times));
            }
            2 | 3 => {
                ok(&project, &["pin", "doll.ron", CHAIN[node]]);
                pinned.insert(node, times[..=node].to_vec());
            }
            4 if pinned.remove(&node).is_some() => {
                ok(&project, &["pin", "--remove", "doll.ron", CHAIN[node]]);
            }
            _ => drop(ok(&project, &["cache", "clear"])),
        }
        let expected = times.iter().enumerate().fold(1, |so_far, (node, times)| {
            pinned.get(&node).map_or(so_far * times, |kept| kept.iter().product())
        });
        let (found, expected) = ((area(&project) / start).sqrt(), f64::from(expected));
        assert!((found - expected).abs() < 1e-6 * expected, "turn {turn}: {found}, {expected}");
        let said = ok(&project, &["check", "doll.ron"]);
        for (node, name) in CHAIN.iter().enumerate() {
            let stale = pinned.get(&node).is_some_and(|kept| kept[..] != times[..=node]);
            let is_told = said.contains(&format!("`{name}` is pinned before"));
            assert_eq!(is_told, stale, "turn {turn}, {name}: {said}");
        }
    }
}

#[test]
fn a_stale_pin_tells_of_what_changed_and_not_of_another_name() {
    let project = project();
    ok(&project, &["pin", "doll.ron", "end"]);
    ok(&project, &["edit", "doll.ron", "rename", "part", "wide"]);
    assert!(!ok(&project, &["check", "doll.ron"]).contains("is pinned before"));
    ok(&project, &["edit", "doll.ron", "set", "wide.scale=3"]);
    let told = ok(&project, &["check", "doll.ron"]);
    assert!(told.contains("`end` is pinned before `wide/big.scale"), "{told}");
}
