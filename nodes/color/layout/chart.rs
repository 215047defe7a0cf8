//! Charts: pieces of a surface that are flattened into the plane.

use maquette_base::linear::cholesky::{Cholesky, Symmetric};
use maquette_base::topology::lists::Lists;
use maquette_base::topology::union_find::UnionFind;
use maquette_value::Mesh;
use maquette_value::parallel::*;
use nalgebra::{Matrix2, Point3, Vector2, Vector3};

use super::sides::NONE;

/// Faces connected by their sides, and the positions of their corners in the plane.
pub(super) struct Chart {
    /// The indices of the chart's faces in the mesh, in ascending order.
    pub(super) faces: Vec<u32>,
    /// The chart's vertex at each corner of the faces, face by face. Corners share a vertex only if the faces around it are connected
    /// within the chart; a seam within the chart may therefore open.
    pub(super) corners: Vec<u32>,
    /// The polygons divided as fans, with the indices of the chart's vertices; degenerate triangles are left out.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Positions of the chart's vertices in space, in mm.
    positions: Vec<Point3<f64>>,
    /// Positions of the chart's vertices in the plane, in mm.
    pub(super) flat: Vec<Vector2<f64>>,
}

/// Triangles whose height is less than this fraction of their longest side are degenerate.
const THIN: f64 = 1e-9;

impl Chart {
    /// Returns the chart of the given faces, which are in ascending order, projected along the mean normal of the chart.
    pub(super) fn new(mesh: &Mesh, opposites: &[u32], of_corner: &[u32], faces: Vec<u32>) -> Self {
        let all = mesh.faces();
        let mut starts = Vec::with_capacity(faces.len());
        let mut own = Vec::new();
        for &face in &faces {
            starts.push(own.len() as u32);
            let first = all.first_corner(face as usize) as u32;
            own.extend(first..first + all.face(face as usize).len() as u32);
        }
        // Maps each corner of the mesh to the chart's corner.
        fn place(
            corner: u32,
            faces: &[u32],
            starts: &[u32],
            of_corner: &[u32],
            all: &maquette_value::Faces,
        ) -> Option<u32> {
            let face = of_corner[corner as usize];
            let chart_face = faces.binary_search(&face).ok()?;
            Some(starts[chart_face] + corner - all.first_corner(face as usize) as u32)
        }
        fn next(corner: u32, of_corner: &[u32], all: &maquette_value::Faces) -> u32 {
            let face = of_corner[corner as usize] as usize;
            let (first, count) = (all.first_corner(face) as u32, all.face(face).len() as u32);
            if corner + 1 < first + count { corner + 1 } else { first }
        }
        let mut sets = UnionFind::new(own.len());
        for (at, &corner) in (0u32..).zip(&own) {
            let opposite = opposites[corner as usize];
            if opposite == NONE || opposite < corner {
                continue;
            }
            let Some(other) = place(opposite, &faces, &starts, of_corner, all) else { continue };
            let ends = [next(corner, of_corner, all), next(opposite, of_corner, all)].map(|it| {
                place(it, &faces, &starts, of_corner, all).expect("of a face of the chart")
            });
            sets.union(at, ends[1]);
            sets.union(ends[0], other);
        }
        let (corners, firsts) = sets.into_labels();
        let positions: Vec<_> = firsts
            .iter()
            .map(|&at| mesh.positions()[all.corners()[own[at as usize] as usize] as usize])
            .collect();
        let end = own.len() as u32;
        let ends = starts[1..].iter().chain([&end]);
        let fans = starts
            .iter()
            .zip(ends)
            .flat_map(|(&start, &end)| (start + 1..end - 1).map(move |k| [start, k, k + 1]));
        let triangles = fans.map(|fan| fan.map(|at| corners[at as usize]));
        let triangles: Vec<_> = triangles
            .filter(|triangle| {
                let [a, b, c] = triangle.map(|it| positions[it as usize]);
                let longest =
                    (b - a).norm_squared().max((c - b).norm_squared()).max((a - c).norm_squared());
                THIN * longest < (b - a).cross(&(c - a)).norm()
            })
            .collect();
        let sum = faces
            .iter()
            .map(|&face| mesh.area_vector(all.face(face as usize)))
            .sum::<Vector3<f64>>();
        let normal = sum.try_normalize(0.0).unwrap_or_else(Vector3::z);
        let aside = Vector3::ith(normal.iamin(), 1.0);
        let right = aside.cross(&normal).normalize();
        let up = normal.cross(&right);
        let flat =
            positions.iter().map(|at| Vector2::new(right.dot(&at.coords), up.dot(&at.coords)));
        let flat = flat.collect();
        Self { faces, corners, triangles, positions, flat }
    }

    /// Flattens the chart with minimum stretch. Returns `None` if the equations have no solution.
    ///
    /// As rigid as possible: Liu, Zhang, Xu, Gotsman and Gortler, "A local/global approach to mesh parameterization" (2008), section 4.
    /// Each triangle is rotated to fit its flat position best (equation 5). Then all vertices move where the rotated triangles pull them
    /// (equation 6); the matrix of these equations is the cotangent Laplacian.
    pub(super) fn relax(&self) -> Option<Vec<Vector2<f64>>> {
        let triangles = self.triangles.par_iter().with_min_len(MIN_PART);
        let shapes: Vec<_> = triangles.map(|it| self.shape(*it)).collect();
        let count = self.flat.len();
        let lists = Lists::group(count, || {
            self.triangles.iter().zip(&shapes).flat_map(|(triangle, shape)| {
                [0, 1, 2].into_iter().flat_map(move |k| {
                    let [a, b] = [triangle[(k + 1) % 3], triangle[(k + 2) % 3]];
                    [(a, (b, shape.cotangents[k])), (b, (a, shape.cotangents[k]))]
                })
            })
        });
        // The first vertex is fixed, which makes the solution unique; a vertex without triangles stays.
        fn hold(own: usize, lists: &Lists<(u32, f64)>) -> f64 {
            let sum: f64 = lists.list(own).iter().map(|entry| entry.1).sum();
            if own == 0 || lists.list(own).is_empty() { sum.abs().max(1.0) } else { 0.0 }
        }
        let mut matrix = Symmetric { starts: vec![0], indices: Vec::new(), entries: Vec::new() };
        for own in 0..count {
            let mut row = lists.list(own).to_vec();
            row.sort_unstable_by_key(|entry| entry.0);
            let sum: f64 = row.iter().map(|entry| entry.1).sum();
            matrix.indices.push(own as u32);
            matrix.entries.push(sum + hold(own, &lists));
            for entries in row.chunk_by(|a, b| a.0 == b.0) {
                matrix.indices.push(entries[0].0);
                matrix.entries.push(-entries.iter().map(|entry| entry.1).sum::<f64>());
            }
            matrix.starts.push(matrix.indices.len() as u32);
        }
        let factors = Cholesky::new(&matrix)?;
        // For each vertex the sides of triangles that end there: 6 t + 2 k for the first end of side k of triangle t, one more for its
        // second end.
        let sides = Lists::group(count, || {
            (0u32..).zip(&self.triangles).flat_map(|(index, triangle)| {
                (0..6)
                    .map(move |end| (triangle[(end / 2 + 1 + end % 2) % 3], 6 * index + end as u32))
            })
        });
        let holds: Vec<f64> = (0..count).map(|own| hold(own, &lists)).collect();
        let (sides, holds) = (&sides, &holds);
        let mut flat = self.flat.clone();
        for _ in 0..STEPS {
            let placed = &flat;
            // The pull on the first end of each side; the pull on the second end is opposite.
            let of_triangles: Vec<[Vector2<f64>; 3]> = self
                .triangles
                .par_iter()
                .zip(&shapes)
                .with_min_len(MIN_PART)
                .map(|(triangle, shape)| {
                    let turn = shape.turn(triangle.map(|it| placed[it as usize]));
                    [0, 1, 2].map(|k: usize| {
                        let [i, j] = [(k + 1) % 3, (k + 2) % 3];
                        turn * (shape.corners[i] - shape.corners[j]) * shape.cotangents[k]
                    })
                })
                .collect();
            let of_triangles = &of_triangles;
            let mut pulls: Vec<[f64; 2]> = (0..count)
                .into_par_iter()
                .with_min_len(MIN_PART)
                .map(|own| {
                    let held = placed[own] * holds[own];
                    let list = sides.list(own).iter();
                    let sum = list.fold(held, |sum, &side| {
                        let pull = of_triangles[side as usize / 6][side as usize % 6 / 2];
                        if side.is_multiple_of(2) { sum + pull } else { sum - pull }
                    });
                    [sum.x, sum.y]
                })
                .collect();
            factors.solve(&mut pulls);
            flat = pulls.into_iter().map(Vector2::from).collect();
        }
        flat.iter().all(|at| at.iter().all(|x| x.is_finite())).then_some(flat)
    }

    fn shape(&self, triangle: [u32; 3]) -> Shape {
        let [a, b, c] = triangle.map(|it| self.positions[it as usize]);
        let (side, other) = (b - a, c - a);
        let length = side.norm();
        let along = side.dot(&other) / length;
        let twice = side.cross(&other).norm();
        let corners =
            [Vector2::zeros(), Vector2::new(length, 0.0), Vector2::new(along, twice / length)];
        Shape {
            corners,
            cotangents: [0, 1, 2].map(|k: usize| {
                let [own, next, last] = [k, (k + 1) % 3, (k + 2) % 3].map(|it| corners[it]);
                (next - own).dot(&(last - own)) / twice
            }),
        }
    }
}

/// Minimum number of items for which a part of a loop is worth it.
const MIN_PART: usize = 2048;

/// Number of steps of relaxation: a few suffice for a nearly flat chart.
const STEPS: usize = 20;

/// The undistorted shape of a triangle, in the triangle's own plane.
struct Shape {
    corners: [Vector2<f64>; 3],
    /// The cotangents of the triangle's angles.
    cotangents: [f64; 3],
}

impl Shape {
    /// Returns the rotation that fits the shape best to the triangle's flat position `lies`.
    fn turn(&self, lies: [Vector2<f64>; 3]) -> Matrix2<f64> {
        let (mut cos, mut sin) = (0.0, 0.0);
        for k in 0..3 {
            let [i, j] = [(k + 1) % 3, (k + 2) % 3];
            let [own, there] = [self.corners[i] - self.corners[j], lies[i] - lies[j]];
            cos += self.cotangents[k] * own.dot(&there);
            sin += self.cotangents[k] * own.perp(&there);
        }
        let length = (cos * cos + sin * sin).sqrt();
        let (cos, sin) = if length > 0.0 { (cos / length, sin / length) } else { (1.0, 0.0) };
        Matrix2::new(cos, -sin, sin, cos)
    }
}
