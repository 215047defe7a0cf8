//! `maquette help` explains the graph language by topic, and the commands.

use crate::output::text_of;
use crate::project::Project;

/// Runs the program; returns its output, and true if it succeeds.
fn run_text(arguments: &[&str]) -> (String, bool) {
    let output = Project::new("").maquette(arguments);
    (text_of(&output), output.status.success())
}

#[test]
fn without_a_word_commands_and_topics_are_listed() {
    let (text, is_known) = run_text(&["help"]);
    assert!(is_known && text == run_text(&["--help"]).0, "{text}");
    assert!(text.contains("\n  run  ") && text.contains(" help TOPIC`: graph, params, "), "{text}");
    assert!(text.lines().count() <= 45, "does not fit on one screen: {text}");
}

#[test]
fn what_becomes_of_attributes_is_told_for_each_node_of_the_program() {
    let (nodes, _) = run_text(&["nodes", "--json"]);
    let nodes: serde_json::Value = serde_json::from_str(&nodes).unwrap();
    let mut wanted = Vec::new();
    for node in nodes["nodes"].as_array().unwrap() {
        for carry in node["attributes"].as_array().into_iter().flatten() {
            let word = |name: &str| carry[name].as_str().unwrap_or("-").to_owned();
            let fates = ["vertex", "corner", "edge", "face", "cell"].map(word).join(" | ");
            let (name, port, output) =
                (node["name"].as_str().unwrap(), word("port"), word("output"));
            wanted.push(format!("| {name} | `{port}`, `{output}` | {fates} |"));
        }
    }
    let (text, _) = run_text(&["help", "attributes"]);
    let rows = text.lines().filter(|line| line.starts_with("| ") && line.contains(", `"));
    let (mut rows, several) = (Vec::from_iter(rows), wanted.len() > 10);
    rows.sort_unstable();
    wanted.sort_unstable();
    assert!(several && rows == wanted, "{rows:#?} {wanted:#?}");
}

#[test]
fn each_node_says_how_exact_it_is() {
    let (nodes, _) = run_text(&["nodes", "--json"]);
    let nodes: serde_json::Value = serde_json::from_str(&nodes).unwrap();
    assert!(nodes["nodes"].as_array().unwrap().iter().all(|node| node["exactness"] == "exact"));
    let exact = "\nExactness\n  exact: the same bytes on every machine and build\n";
    let (one, _) = run_text(&["nodes", "Threshold"]);
    assert!(one.contains(exact), "{one}");
    assert_eq!(run_text(&["nodes", "--doc", "Threshold"]).0, one);
    let (all, is_known) = run_text(&["nodes", "--doc"]);
    assert!(is_known && all.contains(&one), "{all}");
    assert_eq!(all.matches(exact).count(), nodes["nodes"].as_array().unwrap().len());
}

#[test]
fn what_files_keep_is_told_for_each_format_of_the_program() {
    let (text, is_known) = run_text(&["help", "formats"]);
    assert!(is_known, "{text}");
    // Each of the four tables of file formats has a header row with the formats, and one row for each kind of data.
    let tables: Vec<_> = text.split("\n| ").skip(1).filter(|line| line.starts_with(' ')).collect();
    assert_eq!(tables.len(), 4, "{text}");
    assert!(tables[0].contains("| ply") && tables[0].contains("| 3mf"), "{text}");
    assert!(tables[1].contains("| gltf") && tables[3].contains("| e57"), "{text}");
    let lines: Vec<_> = text.lines().filter(|line| line.starts_with("| ")).collect();
    assert_eq!(lines.len(), 4 * 17, "{text}");
    for table in lines.chunks(17) {
        let width = table[0].matches('|').count();
        for line in &table[1..] {
            assert_eq!(line.matches('|').count(), width, "{line}");
            let words = line.split('|').skip(2).map(str::trim).filter(|word| !word.is_empty());
            assert!(
                words.into_iter().all(|it| ["kept", "changed", "lost"].contains(&it)),
                "{line}"
            );
        }
    }
    assert!(text.contains("- pictures, `ply`: their colors at the vertices\n"), "{text}");
    assert!(!text.contains("| meshes, ") && !text.contains("| points, "), "{text}");
}
