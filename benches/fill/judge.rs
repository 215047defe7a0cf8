//! How far what fills a hole is from what was there, and whether it is a surface.

use maquette::Progress;
use maquette::value::{Mesh, TriangleTree};
use maquette_nodes::fill::{FillMethod, FillOptions, HoleChoice, fill_holes};
use nalgebra::Point3;
use robust::{Coord3D, orient3d};

use crate::cases::Case;

/// What is known of a filled mesh. Distances are in mean edges.
pub(crate) struct Verdict {
    /// From points all over the filled part to the truth: the root of the mean square, and the largest.
    pub(crate) rms: f64,
    pub(crate) most: f64,
    /// From the lost vertices to the filled mesh.
    pub(crate) back_rms: f64,
    pub(crate) back_most: f64,
    pub(crate) open: usize,
    pub(crate) added: usize,
    /// Whether no border is left that the truth does not have.
    pub(crate) is_tight: bool,
    pub(crate) is_manifold: bool,
    /// Pairs of triangles, at least one of them filled, that run through each other.
    pub(crate) crossings: usize,
}

/// Looks at `filled`, whose first vertices and faces are those of the case.
pub(crate) fn judge(case: &Case, filled: &Mesh) -> Verdict {
    let (data, kept) = (case.holed.positions().len(), case.holed.faces().len());
    let there = TriangleTree::new(&case.truth);
    let (samples, weights) = samples(filled, kept);
    let squares = |tree: &TriangleTree, points: &[Point3<f64>]| -> Vec<f64> {
        tree.nearest_to_all(points).into_iter().flatten().map(|place| place.distance_sq).collect()
    };
    let distances = squares(&there, &samples);
    let sum: f64 = distances.iter().zip(&weights).map(|(d, w)| d * w).sum();
    let most = |squares: &[f64]| squares.iter().copied().fold(0.0, f64::max).sqrt() / case.edge;
    let back = squares(&TriangleTree::new(filled), &case.truth.positions()[data..]);
    let open = |mesh: &Mesh| mesh.edges().faces.iter().filter(|&&faces| faces == 1).count();
    // Who fills nothing learns whether it is a surface.
    let nothing = FillOptions { holes: HoleChoice::Loops(Vec::new()), method: FillMethod::Flat };
    Verdict {
        rms: (sum / weights.iter().sum::<f64>()).sqrt() / case.edge,
        most: most(&distances),
        back_rms: (back.iter().sum::<f64>() / back.len() as f64).sqrt() / case.edge,
        back_most: most(&back),
        open: open(filled),
        added: filled.positions().len() - data,
        is_tight: open(filled) == open(&case.truth),
        is_manifold: fill_holes(filled, &nothing, &Progress::none()).is_ok(),
        crossings: crossings(filled, kept),
    }
}

/// Points all over the faces behind the first `kept`, with the areas that they stand for.
fn samples(mesh: &Mesh, kept: usize) -> (Vec<Point3<f64>>, Vec<f64>) {
    let (mut points, mut weights) = (Vec::new(), Vec::new());
    for face in mesh.faces().iter().skip(kept) {
        let [a, b, c] = [0, 1, 2].map(|k| mesh.positions()[face[k] as usize].coords);
        let area = mesh.area_vector(face).norm();
        for [u, v, w] in [
            [1.0, 1.0, 1.0],
            [4.0, 1.0, 1.0],
            [1.0, 4.0, 1.0],
            [1.0, 1.0, 4.0],
            [2.0, 2.0, 0.5],
            [0.5, 2.0, 2.0],
            [2.0, 0.5, 2.0],
        ] {
            points.push(Point3::from((a * u + b * v + c * w) / (u + v + w)));
            weights.push(area);
        }
    }
    (points, weights)
}

/// How many pairs of triangles, one of them behind the first `kept`, run through each other, decided without rounding. Those in one
/// plane do not count.
fn crossings(mesh: &Mesh, kept: usize) -> usize {
    let place = |vertex: u32| mesh.positions()[vertex as usize];
    let low = |face: &[u32]| place(face[0]).inf(&place(face[1])).inf(&place(face[2]));
    let high = |face: &[u32]| place(face[0]).sup(&place(face[1])).sup(&place(face[2]));
    let mut sorted: Vec<(usize, &[u32])> = mesh.faces().iter().enumerate().collect();
    sorted.sort_by(|a, b| low(a.1).x.total_cmp(&low(b.1).x));
    let mut count = 0;
    for (index, &(number, a)) in sorted.iter().enumerate() {
        let (low_a, high_a) = (low(a), high(a));
        for &(other, b) in &sorted[index + 1..] {
            if low(b).x > high_a.x {
                break;
            }
            let is_near = (1..3).all(|k| low(b)[k] <= high_a[k] && low_a[k] <= high(b)[k]);
            let is_filled = number.max(other) >= kept;
            if is_filled
                && is_near
                && (has_edge_through(a, b, place) || has_edge_through(b, a, place))
            {
                count += 1;
            }
        }
    }
    count
}

/// Whether an edge of a triangle, that has no vertex of the other one, runs through that.
fn has_edge_through(a: &[u32], b: &[u32], place: impl Fn(u32) -> Point3<f64>) -> bool {
    let side = |corners: [u32; 4]| {
        let [a, b, c, d] = corners.map(|vertex| {
            let p = place(vertex);
            Coord3D { x: p.x, y: p.y, z: p.z }
        });
        orient3d(a, b, c, d)
    };
    (0..3)
        .map(|k| [a[k], a[(k + 1) % 3]])
        .filter(|ends| !ends.iter().any(|end| b.contains(end)))
        .any(|[p, q]| {
            let [from, to] = [p, q].map(|end| side([b[0], b[1], b[2], end]));
            let turns = (0..3).map(|k| side([p, q, b[k], b[(k + 1) % 3]]));
            let turns: Vec<f64> = turns.collect();
            from * to < 0.0
                && (turns.iter().all(|&turn| turn >= 0.0) || turns.iter().all(|&turn| turn <= 0.0))
        })
}
