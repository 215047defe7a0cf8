//! Measures the main use case, the example graph `doll.ron`. The doll's nose must be found and grow by the requested distance, and nothing
//! else may change.

use std::path::Path;

use maquette::value::{Direction, Labels, Mask, Mesh, RangeImage, Region, Value};
use maquette::{CancelToken, Catalog, Evaluation, Evaluator, Graph, Options};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// The distance in mm by which the graph grows the nose.
const GROWTH: f64 = 12.0;

struct Doll {
    graph: Graph,
    evaluation: Evaluation,
}

impl Doll {
    fn new() -> Self {
        let catalog = Catalog::new(maquette_nodes::PACKS);
        let path = Path::new(ROOT).join("graphs/doll.ron");
        let graph =
            Graph::load(&path, &catalog, &Options::default()).graph.expect("the graph checks");
        let mut evaluator = Evaluator::new(2, 1 << 30).unwrap();
        let evaluation = evaluator.evaluate_all_nodes(&graph, &(), &CancelToken::default());
        assert!(evaluation.diagnostics().is_empty(), "{:?}", evaluation.diagnostics());
        Self { graph, evaluation }
    }

    fn get<T: Value>(&self, node: &str, output: &str) -> &T {
        self.evaluation.find(&self.graph, node, output).and_then(|value| value.get()).expect(node)
    }
}

/// The label of the nose in the picture of the right labels, `doll_front_labels.png`.
const NOSE: u8 = 4;

#[test]
fn the_mask_is_the_nose() {
    let doll = Doll::new();
    let spots: &Labels = doll.get("spots", "");
    let largest = spots.by_area()[0];
    let bytes = include_bytes!("../data/doll_front_labels.png");
    let truth = maquette::format::png::read(bytes).unwrap();
    let (mut both, mut either) = (0, 0);
    for (&label, truth) in spots.pixels().iter().zip(truth.pixels()) {
        let (found, is_nose) = (label == largest, truth[0] == NOSE);
        both += usize::from(found && is_nose);
        either += usize::from(found || is_nose);
    }
    let agreement = both as f64 / either as f64;
    assert!(agreement >= 0.97, "intersection over union is {agreement}");
    assert!(doll.get::<Mask>("red", "").count() >= spots.statistics()[largest as usize - 1].area);
}

#[test]
fn the_nose_grows_and_nothing_else_moves() {
    let doll = Doll::new();
    let scan: &RangeImage = doll.get("whole", "");
    let blended: &RangeImage = doll.get("blended", "");
    let nose: &Region = doll.get("nose", "");
    let normal = doll.get::<Direction>("normal", "").vector();
    assert!(normal.z < -0.8, "the nose points to the sensor: {normal:?}");
    for cell in (0..scan.points().len()).filter(|&cell| nose.find(cell).is_none()) {
        fn bits(range: &RangeImage, cell: usize) -> Vec<u64> {
            range.points()[cell].coords.iter().map(|x| x.to_bits()).collect()
        }
        assert_eq!(bits(scan, cell), bits(blended, cell), "cell {cell} is outside of the nose");
    }
    fn displacement(&cell: &u32, nose: &Region, blended: &RangeImage) -> nalgebra::Vector3<f64> {
        let before = nose.points()[nose.find(cell as usize).unwrap()];
        blended.points()[cell as usize] - before
    }
    let summit = nose
        .cells()
        .iter()
        .map(|cell| displacement(cell, nose, blended).dot(&normal))
        .fold(0.0, f64::max);
    assert!((summit - GROWTH).abs() <= 0.1 * GROWTH, "the summit moved by {summit} mm");
    let rim = &nose.contours()[0].cells;
    let farthest =
        rim.iter().map(|cell| displacement(cell, nose, blended).norm()).fold(0.0, f64::max);
    assert!(farthest <= 0.015 * GROWTH, "a cell of the contour moved by {farthest} mm");
}

#[test]
fn the_mesh_is_manifold_and_looks_towards_the_sensor() {
    let doll = Doll::new();
    for node in ["grid", "skin", "model"] {
        let mesh: &Mesh = doll.get(node, "");
        let edges = mesh.edges();
        assert!(edges.faces.iter().all(|&faces| faces <= 2), "{node} is manifold at its edges");
        assert_eq!(edges.misoriented, 0, "{node} is consistently oriented");
    }
    let grid: &Mesh = doll.get("grid", "");
    let away = grid.faces().iter().filter(|face| {
        let center = grid.positions()[face[0] as usize];
        grid.area_vector(face).dot(&center.coords) > 0.0
    });
    // Of the resulting surface, only the grown nose overhangs slightly. All other faces are visible from the sensor.
    let share = away.count() as f64 / grid.faces().len() as f64;
    assert!(share < 0.01, "{share} of the faces look away from the sensor");
    assert!(doll.get::<Mesh>("model", "").texture().is_some());
}

#[test]
fn planar_texture_coordinates_are_near_those_of_the_registration() {
    let doll = Doll::new();
    let scan: &RangeImage = doll.get("scan", "range");
    let image = doll.get("scan", "color");
    let mesh = maquette_nodes::range::triangulate(scan, 6.0, 85.0, 20).unwrap();
    let planar = maquette_nodes::mesh::texture(
        &mesh,
        image,
        None,
        maquette_nodes::mesh::Mapping::Planar { scale: (0.0, 0.0) },
    );
    let planar = planar.unwrap();
    fn uv(mesh: &Mesh) -> Vec<[f64; 2]> {
        mesh.vertex().pairs("uv").unwrap().to_vec()
    }
    fn largest_difference(axis: usize, mesh: &Mesh, planar: &Mesh) -> f64 {
        let pairs = uv(mesh).into_iter().zip(uv(planar));
        pairs.map(|(bound, planar)| (bound[axis] - planar[axis]).abs() * 400.0).fold(0.0, f64::max)
    }
    assert!(
        largest_difference(0, &mesh, &planar) <= 5.0
            && largest_difference(1, &mesh, &planar) <= 5.0,
        "{} and {} pixels",
        largest_difference(0, &mesh, &planar),
        largest_difference(1, &mesh, &planar)
    );
}
