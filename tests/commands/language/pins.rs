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
    project.write("part.ron", PART);
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
fn a_watch_takes_up_pins_while_it_runs() {
    let project = project();
    let mut watch = project.watch(&["--no-provenance"]);
    let without = project.outputs();
    // The node `skin` is pinned with two levels and then set back to one level. Its pin is now stale, but still used.
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
