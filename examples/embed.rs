//! Uses maquette in another program: loads a graph from a text, passes a mesh as arrays, reports progress, can cancel, and reads columns
//! without a copy.
#![allow(clippy::print_stdout, reason = "this program talks to its user")]

use maquette::value::{Faces, Mesh};
use maquette::{AnyValue, CancelToken, Observer, Options, Run, Session, Settings};
use nalgebra::Point3;

const GRAPH: &str = r#"Graph(
    format: 1,
    inputs: { "cage": Mesh(doc: "What is to become smooth.") },
    params: { "levels": Integer(default: 1, min: 0, max: 6, doc: "How often.") },
    nodes: { "smooth": Subdivide(mesh: "cage", scheme: Loop, levels: Param("levels")) },
    outputs: { "smooth": "smooth" },
)"#;

/// Prints the progress. A host that wants to stop the run calls `cancel()` on its token.
struct Show;

impl Observer for Show {
    fn on_progress(&self, node: &str, share: f64) {
        println!("{node}: {:.0} %", share * 100.0);
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut session = Session::new(maquette_nodes::PACKS, &Settings::in_memory())?;
    let set = vec![("levels".into(), "3".into())];
    let options = Options { set, ..Options::default() }.with_text("smooth.ron", GRAPH);
    let checked = session.load("smooth.ron".as_ref(), &options);
    let graph = checked.graph.ok_or_else(|| checked.diagnostics[0].to_text(false))?;
    let corners = [[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [0.0, 9.0, 0.0], [0.0, 0.0, 9.0]];
    let faces = Faces::triangles(vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]);
    let cage = Mesh::new(corners.map(Point3::from).to_vec(), faces)?;
    let inputs = [("cage".to_owned(), AnyValue::new(cage))].into();
    let run = Run { inputs, observer: &Show, cancel: CancelToken::default(), ..Run::default() };
    let done = session.run(&graph, &run).map_err(|problems| problems[0].to_text(false))?;
    let smooth = done.get::<Mesh>("smooth")?;
    println!("{} vertices, the first at {}", smooth.positions().len(), smooth.positions()[0]);
    Ok(())
}
