//! Measures the distance of a filled hole from the original surface, and checks that the result is a manifold surface.

use maquette::Progress;
use maquette::value::{Mesh, TriangleTree};
use maquette_nodes::fill::{FillMethod, HoleChoice, fill_holes};
use nalgebra::{Point3, Vector3};
use robust::{Coord3D, orient3d};

use crate::cases::Case;

/// The measured quality of a filled mesh. All distances are divided by the mean length of edges.
pub(crate) struct Verdict {
    /// The root mean square (`rms`) and the maximum (`most`) of the distances from points all over the filled part to the original surface.
    pub(crate) rms: f64,
    pub(crate) most: f64,
    /// The root mean square (`back_rms`) and the maximum (`back_most`) of the distances from the removed vertices to the filled mesh.
    pub(crate) back_rms: f64,
    pub(crate) back_most: f64,
    pub(crate) open: usize,
    pub(crate) added: usize,
    /// True if the filled mesh has as many border edges as the original, so no hole is left.
    pub(crate) is_tight: bool,
    pub(crate) is_manifold: bool,
    /// The number of intersecting pairs of triangles that involve the filled part.
    pub(crate) crossings: usize,
}

/// Measures the mesh `filled`. It must begin with the vertices and faces of the mesh of the case.
pub(crate) fn judge(case: &Case, filled: &Mesh) -> Verdict {
    let (data, kept) = (case.holed.positions().len(), case.holed.faces().len());
    let there = TriangleTree::new(&case.truth);
    let (samples, weights) = samples(filled, kept);
    fn squares(tree: &TriangleTree, points: &[Point3<f64>]) -> Vec<f64> {
        tree.nearest_to_all(points).into_iter().flatten().map(|place| place.distance_sq).collect()
    }
    let distances = squares(&there, &samples);
    let sum: f64 = distances.iter().zip(&weights).map(|(d, w)| d * w).sum();
    fn largest(squares: &[f64], case_edge: f64) -> f64 {
        squares.iter().copied().fold(0.0, f64::max).sqrt() / case_edge
    }
    let back = squares(&TriangleTree::new(filled), &case.truth.positions()[data..]);
    fn open(mesh: &Mesh) -> usize {
        mesh.edges().faces.iter().filter(|&&faces| faces == 1).count()
    }
    // Without a hole to fill, `fill_holes` only checks that the mesh is a manifold surface.
    let no_hole = HoleChoice::Loops(Vec::new());
    Verdict {
        rms: (sum / weights.iter().sum::<f64>()).sqrt() / case.edge,
        most: largest(&distances, case.edge),
        back_rms: (back.iter().sum::<f64>() / back.len() as f64).sqrt() / case.edge,
        back_most: largest(&back, case.edge),
        open: open(filled),
        added: filled.positions().len() - data,
        is_tight: open(filled) == open(&case.truth),
        is_manifold: fill_holes(filled, &no_hole, &FillMethod::Flat, &Progress::silent()).is_ok(),
        crossings: crossings(filled, kept),
    }
}

/// Two measures of the shape of a part of a mesh. Also used for the ratios of these measures between two parts.
pub(crate) struct Character {
    /// The root mean square of the distances between the vertices and their smoothed positions.
    pub(crate) roughness: f64,
    /// The 10th, 25th, 50th, 75th and 90th percentiles of the dihedral angles.
    pub(crate) bends: [f64; 5],
}

/// Returns three ratios of the shape measures: filled part to original part, filled part to neighborhood, and original part to
/// neighborhood. The neighborhood is a zone of kept vertices around the hole. Its width in rings of vertices is the diameter of the hole.
pub(crate) fn characters(case: &Case, filled: &Mesh) -> [Character; 3] {
    let data = case.holed.positions().len();
    let new = |vertex: usize| data <= vertex;
    let around = neighborhood(case);
    fn measure(mesh: &Mesh, is_in: &dyn Fn(usize) -> bool, touches: bool) -> Character {
        Character { roughness: roughness(mesh, is_in), bends: bends(mesh, is_in, touches) }
    }
    let [own, there] = [filled, &case.truth].map(|mesh| measure(mesh, &new, true));
    let near = measure(&case.truth, &|vertex| around[vertex], false);
    fn ratio(a: &Character, b: &Character) -> Character {
        Character {
            roughness: a.roughness / b.roughness,
            bends: std::array::from_fn(|k| a.bends[k] / b.bends[k]),
        }
    }
    [ratio(&own, &there), ratio(&own, &near), ratio(&there, &near)]
}

/// Marks the vertices of the original mesh that are in the neighborhood of the removed part. This is a zone around the part whose width in
/// rings of vertices is the diameter of the part.
fn neighborhood(case: &Case) -> Vec<bool> {
    let data = case.holed.positions().len();
    let edges = case.truth.edges().vertices;
    fn steps(from: &dyn Fn(usize) -> bool, edges: &[[u32; 2]], case_truth: &Mesh) -> Vec<usize> {
        let mut steps: Vec<usize> = (0..case_truth.positions().len())
            .map(|v| if from(v) { 0 } else { usize::MAX })
            .collect();
        for ring in 0.. {
            let before = steps.clone();
            for &[a, b] in edges {
                for [a, b] in [[a, b], [b, a]].map(|ends| ends.map(|end| end as usize)) {
                    if before[a] == ring && before[b] == usize::MAX {
                        steps[b] = ring + 1;
                    }
                }
            }
            if before == steps {
                break;
            }
        }
        steps
    }
    let depth = steps(&|vertex| vertex < data, &edges, &case.truth).into_iter().max().unwrap_or(0);
    let out = steps(&|vertex| data <= vertex, &edges, &case.truth);
    out.into_iter().map(|ring| 0 < ring && ring <= 2 * depth).collect()
}

/// The number of smoothing steps. Each moves every vertex halfway to the mean of its neighbors.
const STEPS: usize = 4;

fn roughness(mesh: &Mesh, is_in: &dyn Fn(usize) -> bool) -> f64 {
    let edges = mesh.edges().vertices;
    let mut degrees = vec![0.0_f64; mesh.positions().len()];
    edges.iter().flatten().for_each(|&vertex| degrees[vertex as usize] += 1.0);
    let mut smooth = mesh.positions().to_vec();
    for _ in 0..STEPS {
        let mut steps = vec![Vector3::zeros(); smooth.len()];
        for [a, b] in edges.iter().map(|ends| ends.map(|end| end as usize)) {
            steps[a] += smooth[b] - smooth[a];
            steps[b] += smooth[a] - smooth[b];
        }
        for ((point, step), degree) in smooth.iter_mut().zip(steps).zip(&degrees) {
            *point += step / (2.0 * degree.max(1.0));
        }
    }
    let normals = mesh.vertex_normals();
    let each = mesh.positions().iter().zip(&smooth).zip(&normals).enumerate();
    let part = each.filter(|(vertex, _)| is_in(*vertex));
    let far: Vec<f64> = part.map(|(_, ((p, q), normal))| (p - q).dot(normal)).collect();
    (far.iter().map(|far| far * far).sum::<f64>() / far.len() as f64).sqrt()
}

/// Returns percentiles of the dihedral angles in a part of a mesh. The part consists of the faces whose vertices are all in it; if
/// `touches` is true, of those with at least one vertex in it.
fn bends(mesh: &Mesh, is_in: &dyn Fn(usize) -> bool, touches: bool) -> [f64; 5] {
    let mut sides: Vec<([u32; 2], Vector3<f64>)> = Vec::new();
    for face in mesh.faces().iter().filter(|face| {
        let mut within = face.iter().map(|&vertex| is_in(vertex as usize));
        if touches { within.any(|is| is) } else { within.all(|is| is) }
    }) {
        let normal = mesh.area_vector(face).normalize();
        sides.extend(
            (0..face.len())
                .map(|k: usize| [face[k], face[(k + 1) % face.len()]])
                .map(|[a, b]| ([a.min(b), a.max(b)], normal)),
        );
    }
    sides.sort_by_key(|side| side.0);
    let pairs = sides.windows(2).filter(|pair| pair[0].0 == pair[1].0);
    fn angle(a: Vector3<f64>, b: Vector3<f64>) -> f64 {
        libm::atan2(a.cross(&b).norm(), a.dot(&b))
    }
    let mut angles: Vec<f64> = pairs.map(|pair| angle(pair[0].1, pair[1].1)).collect();
    angles.sort_by(f64::total_cmp);
    [0.1, 0.25, 0.5, 0.75, 0.9].map(|share| angles[(share * angles.len() as f64) as usize])
}

/// Returns sample points on all faces from the index `kept` on. Each has a weight proportional to the area that it represents.
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

/// Counts the intersecting pairs of triangles of which at least one has an index from `kept` on. The geometric predicates are exact.
/// Coplanar pairs do not count.
fn crossings(mesh: &Mesh, kept: usize) -> usize {
    let places = mesh.positions();
    fn low(face: &[u32], places: &[Point3<f64>]) -> Point3<f64> {
        let [a, b, c] = [0, 1, 2].map(|k| places[face[k] as usize]);
        a.inf(&b).inf(&c)
    }
    fn high(face: &[u32], places: &[Point3<f64>]) -> Point3<f64> {
        let [a, b, c] = [0, 1, 2].map(|k| places[face[k] as usize]);
        a.sup(&b).sup(&c)
    }
    let mut sorted: Vec<(usize, &[u32])> = mesh.faces().iter().enumerate().collect();
    sorted.sort_by(|a, b| low(a.1, places).x.total_cmp(&low(b.1, places).x));
    let mut count = 0;
    for (index, &(number, a)) in sorted.iter().enumerate() {
        let (low_a, high_a) = (low(a, places), high(a, places));
        for &(other, b) in &sorted[index + 1..] {
            if low(b, places).x > high_a.x {
                break;
            }
            let is_near =
                (1..3).all(|k| low(b, places)[k] <= high_a[k] && low_a[k] <= high(b, places)[k]);
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

/// Returns true if an edge of triangle `a` intersects triangle `b`. Edges that share a vertex with `b` do not count.
fn has_edge_through(a: &[u32], b: &[u32], place: impl Fn(u32) -> Point3<f64>) -> bool {
    let side = |corners: [u32; 4]| {
        let [a, b, c, d] = corners.map(|vertex| {
            let p = places[vertex as usize];
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
