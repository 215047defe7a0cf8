//! `-0.0` is accepted as zero for an integer or an enum variant, wherever the value comes from.

use std::path::Path;

use maquette::{Catalog, Graph, Options, Run, Session, Settings, State};
use maquette_nodes::PACKS;

/// Runs a graph that subdivides a mesh by this number of levels, and returns the state of that node. Panics if there are errors.
fn subdivide_state(session: &mut Session, levels: &str, set: &[(String, String)]) -> State {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs/zeros.ron");
    let text = format!(
        r#"Graph(
            format: 1,
            params: {{ "n": Integer(default: -0.0), "x": Number(default: -1.0) }},
            nodes: {{
                "doll": ReadMesh(path: "doll/coarse.obj"),
                "s": Subdivide(mesh: "doll", scheme: Loop, levels: {levels}),
                "one": Switch(cases: {{ "0": "s", "1": "doll" }}, choose: Expr("n * x")),
                "none": ForEach(graph: "Transform", over: Param("n"), with: (mesh: "doll")),
                "all": Merge(meshes: "none"),
            }},
            outputs: {{ "s.ply": "one" }},
        )"#
    );
    let options = Options { set: set.to_vec(), ..Options::default() }.with_text(&path, text);
    let checked = Graph::load(&path, &Catalog::new(PACKS), &options);
    let graph = checked.graph.unwrap_or_else(|| panic!("{levels}: {:?}", checked.diagnostics));
    let done = session.run(&graph, &Run::default()).unwrap();
    assert!(done.diagnostics().is_empty(), "{levels}: {:?}", done.diagnostics());
    done.trace().0.into_iter().find(|node| node.name == "s").unwrap().state
}

#[test]
fn a_whole_number_takes_minus_zero_as_zero_and_has_the_same_key() {
    let mut session = Session::new(PACKS, &Settings::in_memory()).unwrap();
    assert_eq!(subdivide_state(&mut session, "0", &[]), State::Computed);
    for levels in ["-0", "0.0", "-0.0", "Param(\"n\")", "Expr(\"x * 0\")"] {
        assert_ne!(subdivide_state(&mut session, levels, &[]), State::Computed, "{levels}");
    }
    let set = [("n".to_owned(), "-0.0".to_owned())];
    assert_ne!(subdivide_state(&mut session, "Param(\"n\")", &set), State::Computed);
    assert_eq!(subdivide_state(&mut session, "1", &[]), State::Computed);
}
