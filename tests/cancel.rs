//! A cancelled evaluation stops soon, whatever node is running.

use std::fmt::Write;
use std::path::Path;
use std::time::{Duration, Instant};

use maquette::{CancelToken, Catalog, Evaluator, Graph, Observer, Options, State};

/// Writes a range image with `side` cells per side. Its depths are a noisy plane with a square hole of half the side length in the middle.
fn write_range(path: &Path, side: usize) {
    let mut text = String::from("VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n");
    let _ = write!(
        text,
        "WIDTH {side}\nHEIGHT {side}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {}\nDATA binary\n",
        side * side
    );
    let mut bytes = text.into_bytes();
    for cell in 0..side * side {
        let [column, row] = [cell % side, cell / side];
        let in_hole = [column, row].iter().all(|&at| (side / 4..3 * side / 4).contains(&at));
        let point = match in_hole {
            true => [f32::NAN; 3],
            false => [column as f32, row as f32, 3000.0 + (cell * 7919 % 97) as f32 * 0.01],
        };
        bytes.extend(point.iter().flat_map(|x| x.to_le_bytes()));
    }
    std::fs::write(path, bytes).unwrap();
}

/// Cancels the evaluation 100 ms after this node has started.
struct Canceller<'a> {
    node: &'a str,
    cancel: CancelToken,
}

impl Observer for Canceller<'_> {
    fn on_start(&self, node: &str) {
        if node == self.node {
            let cancel = self.cancel.clone();
            std::thread::spawn(move || {
                std::thread::sleep(Duration::from_millis(100));
                cancel.cancel();
            });
        }
    }
}

/// Returns the time in seconds from the cancellation until the node stops. Without cancellation, each tested node would run for much
/// longer.
fn seconds_to_stop(nodes: &str, node: &str) -> f64 {
    seconds_to_stop_with(1200, nodes, node)
}

fn seconds_to_stop_with(side: usize, nodes: &str, node: &str) -> f64 {
    let folder = tempfile::tempdir().unwrap();
    write_range(&folder.path().join("range.pcd"), side);
    let path = folder.path().join("graph.ron");
    let text = format!(
        "Graph(format: 1, nodes: {{
            \"scan\": ReadRange(path: \"range.pcd\"),
            \"all\": Foreground(range: \"scan.range\", by: Valid, fill_holes: true),
            \"spots\": Label(mask: \"all\"),
            {nodes}
        }}, outputs: {{}})"
    );
    std::fs::write(&path, text).unwrap();
    let checked = Graph::load(&path, &Catalog::new(maquette_nodes::PACKS), &Options::default());
    let messages = checked.diagnostics.iter().map(|problem| &problem.message[..]);
    let graph = checked.graph.unwrap_or_else(|| panic!("{}", Vec::from_iter(messages).join("; ")));
    let canceller = Canceller { node, cancel: CancelToken::default() };
    let mut evaluator = Evaluator::new(2, 1 << 30).unwrap();
    let start = Instant::now();
    let evaluation = evaluator.evaluate_all_nodes(&graph, &canceller, &canceller.cancel);
    let trace = evaluation.trace();
    let stopped = trace.0.iter().find(|trace| trace.name == node).unwrap();
    assert_eq!((stopped.state, &stopped.reason[..]), (State::Failed, "cancelled"), "{trace}");
    let before: f64 = trace.0.iter().map(|node| node.seconds).sum();
    start.elapsed().as_secs_f64() - before - 0.1
}

/// The bound is far more than the 50 ms between two checks for cancellation, because tests run in parallel, and far less than the node's
/// work.
fn soon(seconds: f64) {
    assert!(seconds < 2.0, "it went on for {seconds} s");
}

#[test]
fn the_filling_of_a_large_range_hole() {
    let nodes =
        r#""region": ExtractRegion(labels: "spots", range: "scan.range", fill_holes: true),"#;
    soon(seconds_to_stop(nodes, "region"));
}

#[test]
fn a_fit_by_many_rounds() {
    let rows = (0..60).map(|row| {
        let point = |column: i32| format!("({column}, {row}, {})", (row * column) % 7);
        format!("[{}]", (0..60).map(point).collect::<Vec<_>>().join(", "))
    });
    let nodes = format!(
        "\"points\": PointNet(points: [{}]),
         \"fit\": FitSurface(net: \"points\", method: Lspia(rows: 40, columns: 40, iterations: 100000, tolerance: 0.0)),",
        Vec::from_iter(rows).join(", ")
    );
    soon(seconds_to_stop(&nodes, "fit"));
}

#[test]
fn the_denoising_of_a_large_capture() {
    let nodes = r#""calm": Denoise(range: "scan.range", iterations: 100),"#;
    soon(seconds_to_stop(nodes, "calm"));
}

#[test]
fn the_filling_of_a_hole_of_many_triangles() {
    let nodes = r#""sheet": Triangulate(range: "scan.range"),
        "whole": FillHoles(mesh: "sheet", method: ThinPlate),"#;
    // A larger hole would be refused, because filling it would need more triangles than allowed.
    soon(seconds_to_stop_with(600, nodes, "whole"));
}

#[test]
fn a_subdivision_by_many_levels() {
    let nodes = r#""sheet": Triangulate(range: "scan.range"),
        "fine": Subdivide(mesh: "sheet", scheme: Loop, levels: 1, limit: true),"#;
    soon(seconds_to_stop(nodes, "fine"));
}
