//! Membranes and thin plates through the rim of a hole: the shapes of a soap film and of a bent elastic sheet.
//!
//! Kobbelt, Campagna, Vorsatz and Seidel, "Interactive multi-resolution modeling on arbitrary meshes" (1998), with the cotangent weights of
//! Pinkall and Polthier, "Computing discrete minimal surfaces and their conjugates" (1993). The term that gives a thin plate evenly varying
//! curvature is from Schneider and Kobbelt, "Geometric fairing of irregular meshes for free-form surface design" (2001).

use maquette_base::linear::cholesky::{Cholesky, Dissection, Links, Symmetric};
use maquette_base::topology::lists::Lists;
use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::join;
use nalgebra::{Point3, Vector3};

use crate::border::rim::Rim;
use crate::triangles::triangulation::{NONE, Triangulation, area_vector};

/// The energy that the shape of a fill minimizes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Energy {
    /// The area. The minimal surface meets the surface around the hole at an angle.
    Membrane,
    /// The bending, also across the rim. The fill continues the surrounding surface smoothly, and its curvature fades where normals
    /// diverge.
    ThinPlate,
    /// The bending relative to the current surface as rest shape. Curvature varies as evenly as possible, and a hole in a ball is filled
    /// spherically.
    EvenPlate,
}

/// Maximum absolute value of a cotangent in the weights. A limit below 2 would change the weights of common angles (27 degrees). With a
/// limit far above 2, one sliver triangle outweighs all other triangles.
const MAX_COTANGENT: f64 = 5.0;

/// Minimum area of a vertex divided by the mean vertex area; smaller areas are replaced by this minimum.
const MIN_AREA: f64 = 0.05;

/// Moves the inner vertices of `triangulation` to minimize the energy, which is approximated with the cotangents and areas of the current
/// triangles. Returns false, without moving anything, if the equations have no solution.
///
/// # Errors
/// Returns an error if the evaluation is cancelled.
pub(crate) fn fair(
    triangulation: &mut Triangulation,
    rim: &Rim,
    energy: Energy,
    progress: &Progress<'_>,
) -> Result<bool, CancelledError> {
    match solve(triangulation, rim, energy, progress)? {
        Some(points) if points.iter().flat_map(|p| p.iter()).all(|x| x.is_finite()) => {
            triangulation.points = points;
            Ok(true)
        }
        _ => Ok(false),
    }
}

/// The discrete Laplacian of a fill and the triangles around it, with one row per vertex.
struct Laplacian {
    starts: Vec<u32>,
    columns: Vec<u32>,
    weights: Vec<f64>,
    /// The area of each vertex; infinite for a vertex that faces do not surround completely, so that its row has no weight.
    areas: Vec<f64>,
    /// The unit normal at each vertex.
    normals: Vec<Vector3<f64>>,
}

impl Laplacian {
    fn new(triangulation: &Triangulation, rim: &Rim) -> Self {
        let count = triangulation.points.len();
        let fixed = triangulation.fixed as u32;
        let outside = rim.triangles.iter().map(|face| {
            // The vertices in `rim.ring` get the indices after all vertices of the triangulation.
            face.map(|vertex| if vertex < fixed { vertex } else { vertex - fixed + count as u32 })
        });
        let inside =
            triangulation.corners.as_chunks::<3>().0.iter().filter(|face| face[0] != NONE).copied();
        let mut areas = vec![0.0; count];
        let mut normals = vec![Vector3::zeros(); count];
        let mut links: Vec<(u32, u32, f64)> = Vec::with_capacity(12 * count);
        for face in inside.chain(outside) {
            let points = face.map(|vertex: u32| {
                let vertex = vertex as usize;
                if vertex < count { triangulation.points[vertex] } else { rim.ring[vertex - count] }
            });
            let area = area_vector(points);
            let double = area.norm();
            for k in 0..3 {
                let (a, b) = (face[(k + 1) % 3], face[(k + 2) % 3]);
                let (u, v) = (points[(k + 1) % 3] - points[k], points[(k + 2) % 3] - points[k]);
                let cotangent = u.dot(&v) / double.max(f64::MIN_POSITIVE);
                let weight = cotangent.clamp(-MAX_COTANGENT, MAX_COTANGENT) / 2.0;
                for (from, to) in [(a, b), (b, a)] {
                    if (from as usize) < count {
                        links.push((from, to, weight));
                    }
                }
                if (face[k] as usize) < count {
                    areas[face[k] as usize] += double / 6.0;
                    normals[face[k] as usize] += area;
                }
            }
        }
        normals.iter_mut().for_each(|sum| *sum = sum.try_normalize(0.0).unwrap_or_default());
        let mut laplacian =
            Self { starts: Vec::new(), columns: Vec::new(), weights: Vec::new(), areas, normals };
        laplacian.gather(count, &links);
        laplacian.limit_areas();
        laplacian
    }

    /// Builds the rows from `links`. An edge contributes one link for each of its faces, each with half of the edge's weight.
    fn gather(&mut self, count: usize, links: &[(u32, u32, f64)]) {
        let links =
            Lists::group(count, || links.iter().map(|&(from, to, weight)| (from, (to, weight))));
        self.starts.push(0);
        for row in 0..count {
            let first = self.columns.len();
            let mut halves = 0usize;
            for &(column, weight) in links.list(row) {
                match self.columns[first..].iter().position(|&known| known == column) {
                    Some(index) => {
                        self.weights[first + index] += weight;
                        halves += 1;
                    }
                    None => {
                        self.columns.push(column);
                        self.weights.push(weight);
                    }
                }
            }
            if halves < self.columns.len() - first {
                self.areas[row] = f64::INFINITY;
            }
            let sum: f64 = self.weights[first..].iter().sum();
            self.columns.push(row as u32);
            self.weights.push(-sum);
            self.starts.push(self.columns.len() as u32);
        }
    }

    fn limit_areas(&mut self) {
        let known: Vec<f64> = self.areas.iter().copied().filter(|area| area.is_finite()).collect();
        let min = MIN_AREA * known.iter().sum::<f64>() / known.len().max(1) as f64;
        self.areas.iter_mut().for_each(|area| *area = area.max(min).max(f64::MIN_POSITIVE));
    }

    /// Returns the elimination order of the unknowns. `unknowns` maps each vertex to the index of its unknown; `vertices` lists the
    /// vertices that have an unknown.
    fn dissection(&self, vertices: &[usize], unknowns: &[u32], energy: Energy) -> Dissection {
        let (mut starts, mut neighbors) = (vec![0], Vec::with_capacity(8 * vertices.len()));
        for &vertex in vertices {
            let columns = self.row(vertex).map(|(column, _)| unknowns[column]);
            neighbors.extend(columns.filter(|&unknown| unknown != NONE));
            starts.push(neighbors.len() as u32);
        }
        let reach = match energy {
            Energy::Membrane => 1,
            Energy::ThinPlate | Energy::EvenPlate => 2,
        };
        Dissection::new(Links { starts: &starts, neighbors: &neighbors }, reach)
    }

    fn row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> {
        let entries = self.starts[row] as usize..self.starts[row + 1] as usize;
        let columns = self.columns[entries.clone()].iter().map(|&column| column as usize);
        columns.zip(self.weights[entries].iter().copied())
    }

    /// Returns, for each vertex, twice the mean curvature of the current surface.
    fn curvatures(&self, position: impl Fn(usize) -> Vector3<f64>) -> Vec<f64> {
        (0..self.areas.len())
            .map(|row: usize| {
                let sum: Vector3<f64> = self.row(row).map(|(column, w)| position(column) * w).sum();
                sum.dot(&self.normals[row]) / self.areas[row]
            })
            .collect()
    }

    /// Returns the part of the curvature vectors' Laplacian at a vertex that is caused by the rotation of the normals. It equals the
    /// Laplacian of the curvature vectors if the Laplacian of their lengths is 0.
    fn normal_turn(&self, vertex: usize, curvatures: &[f64]) -> Vector3<f64> {
        let own = self.normals[vertex];
        let row = self.row(vertex);
        row.map(|(other, w)| (self.normals[other] - own) * (w * curvatures[other])).sum()
    }
}

fn solve(
    triangulation: &Triangulation,
    rim: &Rim,
    energy: Energy,
    progress: &Progress<'_>,
) -> Result<Option<Vec<Point3<f64>>>, CancelledError> {
    progress.check()?;
    let laplacian = Laplacian::new(triangulation, rim);
    progress.check()?;
    let count = triangulation.points.len();
    let mut unknowns = vec![NONE; count + rim.ring.len()];
    let mut vertices = Vec::new();
    for vertex in
        (triangulation.fixed..count).filter(|&vertex| triangulation.leaving[vertex] != NONE)
    {
        unknowns[vertex] = vertices.len() as u32;
        vertices.push(vertex);
    }
    if vertices.is_empty() {
        return Ok(None);
    }
    // Make coordinates relative to the rim's centroid; otherwise digits would be lost if the hole is far from the origin.
    let sum: Vector3<f64> = rim.points.iter().map(|point| point.coords).sum();
    let origin = Point3::from(sum / rim.len() as f64);
    let ((matrix, mut right), dissection) = join(
        || {
            equations(
                &laplacian,
                &vertices,
                &unknowns,
                |vertex: usize| {
                    if vertex < count {
                        triangulation.points[vertex] - origin
                    } else {
                        rim.ring[vertex - count] - origin
                    }
                },
                energy,
            )
        },
        || laplacian.dissection(&vertices, &unknowns, energy),
    );
    let Some(factors) = Cholesky::with_ordering(&matrix, &dissection, progress)? else {
        return Ok(None);
    };
    factors.solve(&mut right);
    let mut points = triangulation.points.clone();
    for (&vertex, solution) in vertices.iter().zip(right) {
        points[vertex] = origin + Vector3::from(solution);
    }
    Ok(Some(points))
}

/// Returns the linear system that minimizes an energy: the matrix and the right sides. The unknowns are the positions of `vertices`,
/// numbered by `unknowns`; all other vertices stay at the positions given by `position`.
fn equations(
    laplacian: &Laplacian,
    vertices: &[usize],
    unknowns: &[u32],
    position: impl Fn(usize) -> Vector3<f64>,
    energy: Energy,
) -> (Symmetric, Vec<[f64; 3]>) {
    let count = laplacian.areas.len();
    let curvatures = match energy {
        Energy::EvenPlate => Some(laplacian.curvatures(&position)),
        Energy::Membrane | Energy::ThinPlate => None,
    };
    let mut matrix = Symmetric { starts: vec![0], indices: Vec::new(), entries: Vec::new() };
    let mut right = Vec::with_capacity(vertices.len());
    let mut indices = vec![NONE; vertices.len()];
    for &vertex in vertices {
        let first = matrix.indices.len();
        let mut known = Vector3::zeros();
        let mut add = |matrix: &mut Symmetric, column: usize, entry: f64| {
            let unknown = unknowns[column];
            if unknown == NONE {
                known -= position(column) * entry;
                return;
            }
            let at = indices[unknown as usize];
            if at != NONE && at as usize >= first {
                matrix.entries[at as usize] += entry;
            } else {
                indices[unknown as usize] = matrix.indices.len() as u32;
                matrix.indices.push(unknown);
                matrix.entries.push(entry);
            }
        };
        match energy {
            Energy::Membrane => {
                laplacian
                    .row(vertex)
                    .for_each(|(column, weight)| add(&mut matrix, column, -weight));
            }
            Energy::ThinPlate | Energy::EvenPlate => {
                // The weights are symmetric: the neighbor's row has the same entry at `vertex` as the row of `vertex` has at the neighbor.
                for (row, weight) in laplacian.row(vertex).filter(|(row, _)| *row < count) {
                    let scale = weight / laplacian.areas[row];
                    if scale != 0.0 {
                        laplacian
                            .row(row)
                            .for_each(|(column, other)| add(&mut matrix, column, scale * other));
                    }
                }
            }
        }
        if let Some(curvatures) = &curvatures {
            known += laplacian.normal_turn(vertex, curvatures);
        }
        matrix.starts.push(matrix.indices.len() as u32);
        right.push([known.x, known.y, known.z]);
    }
    (matrix, right)
}
