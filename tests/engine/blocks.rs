//! Files of points that are read block by block give the results of files that are read as a whole.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use maquette::value::Hash;
use maquette::{Catalog, Evaluation, Evaluator, Graph, Options, State};

const FORMATS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/data/formats");

/// Crops the points of a file twice.
fn graph(folder: &Path, file: &str) -> Graph {
    let text = format!(
        "Graph(
            format: 1,
            nodes: {{
                \"points\": ReadPoints(path: {file:?}, unit: Mm),
                \"above\": Crop(mesh: \"points\", within: Box(min: (-1e6, -1e6, -1e6), max: (1e6, 40.0, 1e6))),
                \"ball\": Crop(mesh: \"above\", within: Sphere(center: (30.0, 30.0, 30.0), radius: 60.0), invert: true),
            }},
            outputs: {{ \"ball.ply\": \"ball\" }},
        )"
    );
    let path = folder.join("graph.ron");
    fs::write(&path, text).unwrap();
    let checked = Graph::load(&path, &Catalog::new(maquette_nodes::PACKS), &Options::default());
    checked.graph.unwrap_or_else(|| panic!("{:?}", checked.diagnostics))
}

const COUNT: u32 = 20_011;

/// Points on a helix.
fn helix() -> impl Iterator<Item = [f32; 3]> {
    (0..COUNT).map(f64::from).map(|k| {
        let (sin, cos) = libm::sincos(0.01 * k);
        [50.0 + 49.0 * cos, 50.0 + 49.0 * sin, 0.005 * k].map(|x| x as f32)
    })
}

/// A binary PLY file with colors.
fn ply_file() -> Vec<u8> {
    let mut text = format!("ply\nformat binary_little_endian 1.0\nelement vertex {COUNT}\n");
    for name in ["float x", "float y", "float z", "uchar red", "uchar green", "uchar blue"] {
        let _ = writeln!(text, "property {name}");
    }
    text += "end_header\n";
    let mut bytes = text.into_bytes();
    for point in helix() {
        bytes.extend(point.iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend([point[0] as u8, point[1] as u8, 7]);
    }
    bytes
}

fn xyz_file() -> String {
    helix().fold(String::new(), |mut text, [x, y, z]| {
        let _ = writeln!(text, "{x} {y} {z}");
        text
    })
}

#[test]
fn blocks_give_the_results_of_the_whole_file() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("helix.ply"), ply_file()).unwrap();
    fs::write(folder.path().join("helix.xyz"), xyz_file()).unwrap();
    for name in ["survey.las", "two_scans.e57", "points.xyz"] {
        fs::copy(Path::new(FORMATS).join(name), folder.path().join(name)).unwrap();
    }
    for file in ["helix.ply", "helix.xyz", "survey.las", "two_scans.e57", "points.xyz"] {
        let graph = graph(folder.path(), file);
        let whole = evaluate(&graph, &mut Evaluator::new(1, 1 << 30).unwrap());
        let (ball, points) = (hash(&whole, &graph, "ball"), whole_points(&graph));
        for (threads, block_len) in [(1, 7), (1, 1000), (8, 1000), (8, 1 << 16)] {
            let evaluator = Evaluator::new(threads, 1 << 30).unwrap();
            let mut evaluator = evaluator.with_blocks(0, block_len);
            let blocks = evaluate(&graph, &mut evaluator);
            assert_eq!(hash(&blocks, &graph, "ball"), ball, "{file} {block_len}");
            // All points are there when they are asked for.
            let asked = evaluator.evaluate_nodes(&graph, &["points"]);
            assert_eq!(hash(&asked, &graph, "points"), points, "{file}");
            // Nothing runs again.
            let again = evaluate(&graph, &mut evaluator);
            assert_eq!(again.trace().count(State::Cached), 3, "{file} {}", again.trace());
        }
    }
}

fn evaluate(graph: &Graph, evaluator: &mut Evaluator) -> Evaluation {
    let evaluation = evaluator.evaluate_all(graph);
    assert_eq!(evaluation.trace().count(State::Failed), 0, "{}", evaluation.trace());
    evaluation
}

fn hash(evaluation: &Evaluation, graph: &Graph, node: &str) -> Hash {
    evaluation.find(graph, node, "").unwrap().hash()
}

fn whole_points(graph: &Graph) -> Hash {
    let mut evaluator = Evaluator::new(1, 1 << 30).unwrap();
    hash(&evaluator.evaluate_nodes(graph, &["points"]), graph, "points")
}
