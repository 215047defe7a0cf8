//! What becomes of attributes is declared, and the manual's table is made of the declarations.

use maquette::Catalog;
use maquette_nodes::PACKS;

#[test]
fn the_manual_has_a_row_for_each_declaration_and_no_other() {
    let manual = include_str!("../../../src/lsp/language/attributes.md");
    let rows = manual.lines().filter(|line| line.starts_with("| ") && line.contains(", `"));
    let catalog = Catalog::new(PACKS).to_json();
    let nodes = catalog["nodes"].as_array().unwrap();
    let mut declared = Vec::new();
    for node in nodes {
        for carry in node["attributes"].as_array().into_iter().flatten() {
            let word = |name: &str| carry[name].as_str().unwrap_or("-").to_owned();
            let fates = ["vertex", "corner", "edge", "face", "cell"].map(word).join(" | ");
            let (name, port, output) =
                (node["name"].as_str().unwrap(), word("port"), word("output"));
            declared.push(format!("| {name} | `{port}`, `{output}` | {fates} |"));
        }
    }
    assert!(declared.len() > 10, "{declared:#?}");
    assert_eq!(Vec::from_iter(rows), declared);
}
