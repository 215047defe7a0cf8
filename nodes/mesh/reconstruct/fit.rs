//! Moves the vertices of the skin so that its faces, not its vertices, lie in the middle of the points.
//!
//! A mesh whose vertices are on a curved surface lies inside of it: its edges are chords. The vertices here minimize the sum of squared
//! distances from the points to the planes of the faces, as in Hoppe, DeRose, Duchamp, McDonald and Stuetzle, "Mesh optimization" (1993),
//! section 4.1, without changes of the connectivity. The springs along the edges act on the moves and not on the lengths, so that they do
//! not shrink the mesh.

use maquette_base::topology::lists::Lists;
use maquette_node::{CancelledError, Error, Progress};
use maquette_value::parallel::*;
use maquette_value::{Mesh, NearestPoint, TriangleTree};
use nalgebra::{Point3, Vector3};

use super::cloud::Cloud;
use super::contour::Skin;
use super::pieces::Pieces;
use super::relax::Neighbors;

/// Number of rounds; each finds the nearest faces of the points again.
const ROUNDS: usize = 5;

/// Maximum number of conjugate gradient steps of a round.
const STEPS: usize = 30;

/// The residual, relative to the initial one, at which the iteration stops.
const TOLERANCE: f64 = 1e-3;

/// Minimum stiffness of the springs along edges. For comparison, the points around a vertex have a stiffness of 1.
const STIFFNESS: f64 = 0.05;

/// Maximum number of points for each vertex; of denser points, some are left out.
const POINTS_PER_VERTEX: usize = 32;

/// Minimum cosine of the angle between the normals of a point and of a face; at larger angles, they belong to different sheets.
const SAME_SHEET: f64 = 0.3;

/// Maximum distance of a point from its face, in edges.
const REACH: f64 = 2.0;

/// Number of times that crossing faces are looked for, and of these, the number of times that their vertices are smoothed.
const UNTANGLING_ROUNDS: usize = 10;
const SMOOTHING_ROUNDS: usize = 5;

/// A point that pulls the skin.
struct Target {
    normal: Vector3<f64>,
    weight: f64,
}

/// The equation of a point: the sum of `shares` times the moves of `vertices`, along `normal`, should be `gap`.
struct Equation {
    vertices: [u32; 3],
    shares: [f64; 3],
    normal: Vector3<f64>,
    gap: f64,
}

impl Equation {
    fn along_normal(&self, moves: &[Vector3<f64>]) -> f64 {
        let parts = self.vertices.iter().zip(self.shares);
        parts.map(|(&vertex, share)| share * moves[vertex as usize].dot(&self.normal)).sum()
    }
}

/// Moves the vertices so that the skin has the least squared distance from the points. Returns the points that the skin misses before the
/// last round.
pub(super) fn fit(
    skin: &mut Skin,
    pieces: &Pieces,
    cloud: &Cloud,
    net: &[Point3<f64>],
    progress: &Progress<'_>,
) -> Result<Missed, Error> {
    if skin.quads.is_empty() {
        return Ok(Missed::default());
    }
    let edge = pieces.pyramid.cube.edge_at(pieces.skin_depth);
    let (points, targets) = targets(pieces, cloud, edge, skin.positions.len());
    let neighbors = Neighbors::new(skin);
    let stiffness = stiffness(pieces, edge);
    let mut missed = Missed::default();
    for round in 0..ROUNDS {
        let mesh = Mesh::new(skin.positions.clone(), skin.faces(false)?)?;
        let nearest = TriangleTree::new(&mesh).nearest_to_all(&points);
        missed = Missed::new(&points, &nearest, edge);
        let equations = equations(&mesh, &nearest, &points, &targets, edge);
        progress.tick((round as f64 + 0.5) / ROUNDS as f64)?;
        let system = System::new(&equations, &neighbors, stiffness);
        let moves = system.solve(progress)?;
        apply(skin, &mesh, moves, 0.5 * edge);
        progress.tick((round + 1) as f64 / ROUNDS as f64)?;
    }
    untangle(skin, &neighbors, net, progress)?;
    Ok(missed)
}

/// Moves the vertices of faces that run through each other to the mean of their neighbors and, if that does not help, to their places `net`
/// in the surface net, where faces of different cells do not meet.
fn untangle(
    skin: &mut Skin,
    neighbors: &Neighbors,
    net: &[Point3<f64>],
    progress: &Progress<'_>,
) -> Result<(), Error> {
    for round in 0..UNTANGLING_ROUNDS {
        let mesh = Mesh::new(skin.positions.clone(), skin.faces(false)?)?;
        let crossing = mesh.crossings(|| progress.check())?;
        if crossing.is_empty() {
            break;
        }
        let mut vertices: Vec<u32> = crossing
            .iter()
            .flatten()
            .flat_map(|&face| mesh.faces().face(face as usize).iter().copied())
            .collect();
        vertices.sort_unstable();
        vertices.dedup();
        for vertex in vertices {
            let near = neighbors.neighbors(vertex as usize);
            skin.positions[vertex as usize] = if round < SMOOTHING_ROUNDS {
                let sum: Vector3<f64> =
                    near.iter().map(|&other| mesh.positions()[other as usize].coords).sum();
                Point3::from(sum / near.len() as f64)
            } else {
                net[vertex as usize]
            };
        }
    }
    Ok(())
}

/// Returns the stiffness of the springs along edges, so that it averages more points where they have more noise.
fn stiffness(pieces: &Pieces, edge: f64) -> f64 {
    let noise = pieces.noise / edge;
    let ratio = edge / pieces.distance;
    let per_vertex = ratio * ratio;
    // The solution averages points over an area of about 12 squared edges times the stiffness: the mean of the membrane's Green's function.
    let noise = 30.0 * noise;
    STIFFNESS + noise * noise / (12.0 * per_vertex)
}

/// Returns the positions of the points, and their normals and weights. The weights around a vertex add up to about 1.
fn targets(
    pieces: &Pieces,
    cloud: &Cloud,
    edge: f64,
    vertices: usize,
) -> (Vec<Point3<f64>>, Vec<Target>) {
    let pyramid = &pieces.pyramid;
    let step = pyramid.order.len().div_ceil(POINTS_PER_VERTEX * vertices).max(1);
    let (mut points, mut targets) = (Vec::new(), Vec::new());
    for (cell, surfel) in pieces.surfels.iter().enumerate() {
        if surfel.normal == Vector3::zeros() {
            continue;
        }
        let count = pyramid.finest().moments[cell].count;
        let area = (surfel.area / count * step as f64 / (edge * edge)).min(1.0);
        let of_cell = pyramid.starts[cell] as usize..pyramid.starts[cell + 1] as usize;
        for place in of_cell.filter(|place| place % step == 0) {
            let point = pyramid.order[place] as usize;
            points.push(cloud.positions[point]);
            let weight = area * cloud.weights.get(point).copied().unwrap_or(1.0);
            targets.push(Target { normal: surfel.normal, weight });
        }
    }
    (points, targets)
}

/// Points that are farther than half an edge from the skin.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Missed {
    /// The fraction of all points.
    pub(super) fraction: f64,
    pub(super) farthest: Option<Point3<f64>>,
}

impl Missed {
    fn new(points: &[Point3<f64>], nearest: &[Option<NearestPoint>], edge: f64) -> Self {
        let (mut count, mut most) = (0, 0.25 * edge * edge);
        let (limit, mut farthest) = (most, None);
        for (point, near) in points.iter().zip(nearest) {
            let square = near.as_ref().map_or(0.0, |near| near.distance_sq);
            count += usize::from(square > limit);
            if square > most {
                (most, farthest) = (square, Some(*point));
            }
        }
        Self { fraction: count as f64 / nearest.len().max(1) as f64, farthest }
    }
}

/// Returns the equations of those points whose nearest face belongs to their sheet of the surface.
fn equations(
    mesh: &Mesh,
    nearest: &[Option<NearestPoint>],
    points: &[Point3<f64>],
    targets: &[Target],
    edge: f64,
) -> Vec<Equation> {
    let normals: Vec<Vector3<f64>> =
        mesh.faces().iter().map(|face| mesh.area_vector(face)).collect();
    let places = 0..points.len();
    places
        .into_par_iter()
        .filter_map(|k: usize| {
            let (near, target) = (nearest[k]?, &targets[k]);
            let across = normals[near.face as usize].try_normalize(0.0)?.dot(&target.normal);
            if across < SAME_SHEET || near.distance_sq > REACH * REACH * edge * edge {
                return None;
            }
            let root = target.weight.sqrt();
            let gap = (points[k] - near.position(mesh)).dot(&target.normal);
            Some(Equation {
                vertices: near.corners.map(|corner| mesh.faces().corners()[corner as usize]),
                shares: near.barycentric,
                normal: target.normal * root,
                gap: gap * root,
            })
        })
        .collect()
}

/// The equations of all points, and the springs between neighbors.
struct System<'a> {
    equations: &'a [Equation],
    /// For each vertex, the equations that contain it, each with the position of the vertex in the equation.
    of_vertices: Lists<(u32, u8)>,
    neighbors: &'a Neighbors,
    stiffness: f64,
}

impl<'a> System<'a> {
    fn new(equations: &'a [Equation], neighbors: &'a Neighbors, stiffness: f64) -> Self {
        let of_vertices = Lists::group_all(neighbors.len(), equations.len(), |number| {
            let vertices = (0u8..).zip(equations[number].vertices);
            vertices.map(move |(k, vertex)| (vertex, (number as u32, k)))
        });
        Self { equations, of_vertices, neighbors, stiffness }
    }

    /// Returns, for each vertex, the sum over its equations of the value of the equation times its gradient.
    fn gather(&self, values: &[f64]) -> Vec<Vector3<f64>> {
        (0..self.neighbors.len())
            .into_par_iter()
            .map(|vertex: usize| {
                let mut sum = Vector3::zeros();
                for &(number, k) in self.of_vertices.list(vertex) {
                    let equation = &self.equations[number as usize];
                    let value = equation.shares[usize::from(k)] * values[number as usize];
                    sum += equation.normal * value;
                }
                sum
            })
            .collect()
    }

    fn left_sides(&self, moves: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let values: Vec<f64> =
            self.equations.par_iter().map(|equation| equation.along_normal(moves)).collect();
        let mut sums = self.gather(&values);
        let places = 0..moves.len();
        sums.par_iter_mut().zip(places).for_each(|(sum, vertex): (&mut Vector3<f64>, usize)| {
            let own = moves[vertex];
            let mut springs = Vector3::zeros();
            for &other in self.neighbors.neighbors(vertex) {
                springs += own - moves[other as usize];
            }
            *sum += springs * self.stiffness + own * (1e-3 * self.stiffness);
        });
        sums
    }

    /// Solves the normal equations by conjugate gradients: Hestenes and Stiefel (1952).
    fn solve(&self, progress: &Progress<'_>) -> Result<Vec<Vector3<f64>>, CancelledError> {
        let gaps: Vec<f64> = self.equations.iter().map(|equation| equation.gap).collect();
        let mut residual = self.gather(&gaps);
        let mut moves = vec![Vector3::zeros(); residual.len()];
        let mut way = residual.clone();
        let first = dot(&residual, &residual);
        let mut squared = first;
        for _ in 0..STEPS {
            progress.check()?;
            if squared <= TOLERANCE * TOLERANCE * first {
                break;
            }
            let left = self.left_sides(&way);
            let length = squared / dot(&way, &left);
            for vertex in 0..moves.len() {
                moves[vertex] += way[vertex] * length;
                residual[vertex] -= left[vertex] * length;
            }
            let last = squared;
            squared = dot(&residual, &residual);
            for (way, residual) in way.iter_mut().zip(&residual) {
                *way = residual + *way * (squared / last);
            }
        }
        Ok(moves)
    }
}

fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

/// Moves the vertices by at most `most`. Where a face would turn over, its vertices move less, or not at all.
fn apply(skin: &mut Skin, before: &Mesh, mut moves: Vec<Vector3<f64>>, most: f64) {
    for step in &mut moves {
        *step *= most / step.norm().max(most);
    }
    for _ in 0..8 {
        let moved: Vec<Point3<f64>> =
            before.positions().iter().zip(&moves).map(|(at, step)| at + step).collect();
        let mut is_calm = true;
        for face in before.faces().iter() {
            let [a, b, c] = [0, 1, 2].map(|k| moved[face[k] as usize]);
            let normal = (b - a).cross(&(c - a));
            let old = before.area_vector(face);
            if normal.dot(&old) < 0.3 * normal.norm() * old.norm() {
                is_calm = false;
                face.iter().for_each(|&vertex| moves[vertex as usize] *= 0.5);
            }
        }
        if is_calm {
            skin.positions = moved;
            return;
        }
    }
}
