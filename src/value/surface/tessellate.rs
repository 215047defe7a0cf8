//! Tessellation of a surface into evenly spaced quads.

use nalgebra::Point3;

use super::super::{Faces, KnotVector, Mesh, MeshError};
use super::joints::{Joints, MIN_AROUND, OpenMesh};
use super::{ParameterDirection, Surface};
use crate::mesh::diagonal;
use crate::union_find::UnionFind;

/// The maximum distance between the mesh and the surface, as a fraction of the diagonal of the control points' bounding box. At 1/1000 the
/// distance is invisible in a picture of 1000 pixels.
const CHORD: f64 = 1e-3;

/// The maximum number of quads that is chosen in one direction, unless there are more spans. A surface that needs more quads, such as that
/// of a net of random points, cannot be approximated by any reasonable number of them.
const MAX_QUADS: usize = 4096;

impl Surface {
    /// A mesh of `u` x `v` quads, which are evenly spaced in the domain. If a number is 0, it is chosen: every span that is not empty is
    /// divided into equally many quads, enough to keep the mesh within 1/1000 of the diagonal of the control points' bounding box from the
    /// surface.
    ///
    /// Vertices are stored row by row, and each row runs along v. Faces are counter-clockwise seen from the side of `S_u x S_v`, which is
    /// the outside if the net came from a capture. The vertex attributes are `uv`, the parameters scaled to 0..1, and `normal`, the exact
    /// normals.
    ///
    /// A surface that is closed in a direction has one row of vertices at its seam, if it has at least three quads around. A row or column
    /// in one place, a pole, is one vertex, around which there are triangles. Then `uv` belongs to corners: at the far side of a seam it is
    /// 1, and at a pole each triangle has the mean of its two columns. Normals belong to corners, too, if the surface has an edge at its
    /// seam or a tip at a pole.
    ///
    /// # Errors
    /// If there are more quads than a mesh can hold, or a point is not finite because the net's numbers are too large.
    pub fn tessellate(&self, u: usize, v: usize) -> Result<Mesh, MeshError> {
        let (open, us, vs) = self.open_grid(u, v)?;
        Ok(self.join_grid(open, [&us, &vs])?.with_frame(self.net.frame().copied()))
    }

    /// The mesh of [`tessellate`](Self::tessellate) for the given `u` and `v` with one vertex for each pair of parameters: its seams are
    /// open.
    ///
    /// # Errors
    /// The errors of [`tessellate`](Self::tessellate).
    pub fn tessellate_open(&self, u: usize, v: usize) -> Result<Mesh, MeshError> {
        Ok(self.open_grid(u, v)?.0.into_mesh()?.with_frame(self.net.frame().copied()))
    }

    /// The mesh of quads without joints, and the parameters of its rows and columns.
    fn open_grid(&self, u: usize, v: usize) -> Result<(OpenMesh, Vec<f64>, Vec<f64>), MeshError> {
        fn corners(u: usize, v: usize) -> usize {
            u.saturating_mul(v).saturating_mul(4)
        }
        fn check(count: usize) -> Result<(), MeshError> {
            match count < u32::MAX as usize {
                true => Ok(()),
                false => Err(MeshError::TooLarge { what: "corners", count }),
            }
        }
        check(corners(u.max(1), v.max(1)))?;
        let us =
            if u == 0 { self.choose_parameters(ParameterDirection::U) } else { even(&self.u, u) };
        let vs =
            if v == 0 { self.choose_parameters(ParameterDirection::V) } else { even(&self.v, v) };
        check(corners(us.len(), vs.len()))?;
        let (points, normals) = self.normal_grid(&us, &vs);
        let (unit_u, unit_v) = (to_unit(&self.u, &us), to_unit(&self.v, &vs));
        let uv = unit_u.iter().flat_map(|&u| unit_v.iter().map(move |&v| [u, v])).collect();
        let faces = quads(us.len(), vs.len())?;
        Ok((OpenMesh { points, normals, uv, faces }, us, vs))
    }

    /// Joins a grid of quads at seams and poles. At a pole between two rows or columns both sides remain separate.
    fn join_grid(&self, mut open: OpenMesh, [us, vs]: [&[f64]; 2]) -> Result<Mesh, MeshError> {
        let (rows, columns) = (us.len(), vs.len());
        let joints = Joints::new(self);
        fn vertex(row: usize, column: usize, columns: usize) -> u32 {
            (row * columns + column) as u32
        }
        // The points of the grid decide quickly for most lines that they are not poles.
        let poles_u: Vec<usize> = (0..rows)
            .filter(|row| {
                (1..columns).all(|column| {
                    joints.is_close(&open, vertex(*row, 0, columns), vertex(*row, column, columns))
                }) && joints.is_pole(ParameterDirection::U, us[*row])
            })
            .collect();
        let poles_v: Vec<usize> = (0..columns)
            .filter(|column| {
                (1..rows).all(|row| {
                    joints.is_close(
                        &open,
                        vertex(0, *column, columns),
                        vertex(row, *column, columns),
                    )
                }) && joints.is_pole(ParameterDirection::V, vs[*column])
            })
            .collect();
        let is_closed_u = joints.is_closed_u && MIN_AROUND < rows;
        let is_closed_v = joints.is_closed_v && MIN_AROUND < columns;
        if !is_closed_u && !is_closed_v && poles_u.is_empty() && poles_v.is_empty() {
            return open.into_mesh();
        }
        fn inner(poles: &[usize], end: usize) -> Vec<usize> {
            poles.iter().copied().filter(|&pole| 0 < pole && pole + 1 < end).collect()
        }
        let (inner_u, inner_v) = (inner(&poles_u, rows), inner(&poles_v, columns));
        let lines_u = poles_u
            .iter()
            .map(|&row| (row, 0 < row))
            .chain(inner_u.iter().map(|&row| (row, false)));
        let lines_v = poles_v.iter().map(|&column| (column, 0 < column));
        let lines_v = lines_v.chain(inner_v.iter().map(|&column| (column, false)));
        let mut pole_sets: Vec<Vec<u32>> = Vec::new();
        // The vertices before a pole, or after it if it is the first line, exist already. Those after an inner pole are added.
        for (k, (row, is_before)) in lines_u.enumerate() {
            let is_new = poles_u.len() <= k;
            let line = (0..columns).map(|column| {
                let normal =
                    joints.normal_beside(ParameterDirection::U, [us[row], vs[column]], is_before);
                open.set_normal(vertex(row, column, columns), normal, is_new)
            });
            pole_sets.push(line.collect());
        }
        let first_of_v = open.points.len() as u32;
        for (k, (column, is_before)) in lines_v.enumerate() {
            let is_new = poles_v.len() <= k;
            let line = (0..rows).map(|row| {
                let normal =
                    joints.normal_beside(ParameterDirection::V, [us[row], vs[column]], is_before);
                open.set_normal(vertex(row, column, columns), normal, is_new)
            });
            pole_sets.push(line.collect());
        }
        fn after(
            poles: &[usize],
            at: usize,
            first: u32,
            length: usize,
            index: usize,
        ) -> Option<u32> {
            poles.binary_search(&at).ok().map(|k| first + (k * length + index) as u32)
        }
        let first_of_u = (rows * columns) as u32;
        let mut corners = Vec::with_capacity(4 * (rows - 1) * (columns - 1));
        for row in 0..rows - 1 {
            for column in 0..columns - 1 {
                let ring =
                    [(row, column), (row + 1, column), (row + 1, column + 1), (row, column + 1)];
                corners.extend(ring.map(|(r, c)| {
                    let after_u = (r == row).then(|| after(&inner_u, r, first_of_u, columns, c));
                    let after_v = (c == column).then(|| after(&inner_v, c, first_of_v, rows, r));
                    after_u.flatten().or(after_v.flatten()).unwrap_or(vertex(r, c, columns))
                }));
            }
        }
        open.faces = Faces::uniform(4, corners)?;
        let mut joined = UnionFind::new(open.points.len());
        if is_closed_u {
            (0..columns).for_each(|column| {
                joined.union(vertex(0, column, columns), vertex(rows - 1, column, columns));
            });
        }
        if is_closed_v {
            (0..rows).for_each(|row| {
                joined.union(vertex(row, 0, columns), vertex(row, columns - 1, columns));
            });
        }
        for set in pole_sets {
            set.iter().for_each(|&vertex| joined.union(set[0], vertex));
        }
        open.join(&mut joined)
    }

    /// Parameters in one direction, close enough to keep the chords within the tolerance `CHORD` of the surface.
    ///
    /// The heights of chords are measured on two pieces per span. A height decreases with the square of the number of pieces.
    fn choose_parameters(&self, along: ParameterDirection) -> Vec<f64> {
        const PIECES: usize = 2;
        let (knots, across) = match along {
            ParameterDirection::U => (&self.u, &self.v),
            ParameterDirection::V => (&self.v, &self.u),
        };
        let fine = divide_spans(knots, 2 * PIECES);
        let lines = divide_spans(across, 2);
        // In either direction, a line has all the parameters `fine` along it and one constant parameter across it.
        let (grid, step, next_line) = match along {
            ParameterDirection::U => (self.grid(&fine, &lines), lines.len(), 1),
            ParameterDirection::V => (self.grid(&lines, &fine), 1, fine.len()),
        };
        let mut height = 0.0f64;
        for line in 0..lines.len() {
            fn at(
                k: usize,
                grid: &[Point3<f64>],
                line: usize,
                next_line: usize,
                step: usize,
            ) -> Point3<f64> {
                grid[line * next_line + k * step]
            }
            for k in (0..fine.len() - 1).step_by(2) {
                height = height.max(distance(
                    at(k + 1, &grid, line, next_line, step),
                    at(k, &grid, line, next_line, step),
                    at(k + 2, &grid, line, next_line, step),
                ));
            }
        }
        let allowed = CHORD * diagonal(self.net.points());
        let pieces = (PIECES as f64 * (height / allowed).sqrt()).ceil();
        let spans = (fine.len() - 1) / (2 * PIECES);
        // A flat or collapsed surface gives 0 or NaN, and the cast of NaN gives 0.
        divide_spans(knots, (pieces as usize).clamp(1, (MAX_QUADS / spans).max(1)))
    }
}

/// The parameters at the ends of `count` equal parts of the domain.
fn even(knots: &KnotVector, count: usize) -> Vec<f64> {
    let (start, end) = knots.domain();
    (0..=count)
        .map(|k| if k == count { end } else { start + (end - start) * (k as f64 / count as f64) })
        .collect()
}

/// The parameters at the ends of `pieces` equal parts of each span that is not empty.
pub(super) fn divide_spans(knots: &KnotVector, pieces: usize) -> Vec<f64> {
    let (start, end) = knots.domain();
    let mut at = vec![start];
    for (_, [low, high]) in knots.spans() {
        at.extend((1..pieces).map(|k| low + (high - low) * (k as f64 / pieces as f64)));
        at.push(high.min(end));
    }
    at
}

pub(super) fn to_unit(knots: &KnotVector, at: &[f64]) -> Vec<f64> {
    let (start, end) = knots.domain();
    at.iter().map(|u| (u - start) / (end - start)).collect()
}

/// The quads of a grid of vertices. If rows grow down and columns grow to the right, each quad is counter-clockwise, seen from the side of
/// "down" x "right".
fn quads(rows: usize, columns: usize) -> Result<Faces, MeshError> {
    let mut corners = Vec::with_capacity(4 * (rows - 1) * (columns - 1));
    for row in 0..rows - 1 {
        for column in 0..columns - 1 {
            let a = (row * columns + column) as u32;
            let below = a + columns as u32;
            corners.extend([a, below, below + 1, a + 1]);
        }
    }
    Faces::uniform(4, corners)
}

/// The distance of `point` from the line through `a` and `b`. If `a` and `b` coincide, the distance of `point` from `a`.
pub(super) fn distance(point: Point3<f64>, a: Point3<f64>, b: Point3<f64>) -> f64 {
    let spoke = point - a;
    match (b - a).try_normalize(0.0) {
        Some(direction) => (spoke - direction * spoke.dot(&direction)).norm(),
        None => spoke.norm(),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::super::super::ControlNet;
    use super::super::evaluate::tests::net;
    use super::*;

    /// The net of a capture: rows run down (y), columns run to the right (x), and the net bulges towards the sensor (-z).
    fn bulge() -> Surface {
        let net = net(6, 6, |row, column| {
            let (y, x) = (row - 2.5, column - 2.5);
            Point3::new(x, y, 700.0 + 0.1 * (x * x + y * y))
        });
        let knots = KnotVector::uniform(6, 3).unwrap();
        Surface::new(net, knots.clone(), knots).unwrap()
    }

    #[test]
    fn the_outside_of_a_capture_faces_the_sensor() {
        let mesh = bulge().tessellate(4, 5).unwrap();
        assert_eq!((mesh.positions().len(), mesh.faces().len()), (30, 20));
        assert!(mesh.faces().iter().all(|face| mesh.area_vector(face).z < 0.0));
        let normals = mesh.vertex().vectors("normal").unwrap();
        assert!(normals.iter().all(|normal| normal[2] < -0.5));
        assert_eq!(mesh.edges().misoriented, 0);
    }

    #[test]
    fn normals_and_texture_coordinates_are_exact() {
        let surface = bulge();
        let mesh = surface.tessellate(3, 2).unwrap();
        let uv = mesh.vertex().pairs("uv").unwrap();
        assert_eq!([uv[0], uv[2], uv[11]], [[0.0, 0.0], [0.0, 1.0], [1.0, 1.0]]);
        let normals = mesh.vertex().vectors("normal").unwrap();
        for ((at, normal), point) in uv.iter().zip(normals.iter()).zip(mesh.positions().iter()) {
            let [u, v] = at.map(|fraction| 4.0 * fraction);
            let exact = surface.normal(u, v).unwrap().into_inner();
            assert!((Vector3::from(*normal) - exact).norm() <= 1e-12);
            assert!((surface.point(u, v) - point).norm() <= 1e-12);
        }
    }

    #[test]
    fn an_automatic_tessellation_stays_within_a_thousandth() {
        let surface = bulge();
        let mesh = surface.tessellate(0, 0).unwrap();
        let allowed = CHORD * diagonal(surface.net.points());
        let n = 1 + (mesh.faces().len() as f64).sqrt() as usize;
        assert_eq!(n * n, mesh.positions().len());
        let us = even(surface.u(), 2 * (n - 1));
        let fine = surface.grid(&us, &us);
        fn grid_point(row: usize, column: usize, fine: &[Point3<f64>], us: &[f64]) -> Point3<f64> {
            fine[row * us.len() + column]
        }
        let mut highest = 0.0f64;
        for row in (1..us.len()).step_by(2) {
            for column in 0..us.len() {
                highest = highest.max(distance(
                    grid_point(row, column, &fine, &us),
                    grid_point(row - 1, column, &fine, &us),
                    grid_point(row + 1, column, &fine, &us),
                ));
            }
        }
        assert!(highest <= allowed, "{highest} {allowed}");
        assert!(highest >= allowed / 16.0, "needlessly fine: {highest} {allowed}");
    }

    #[test]
    fn a_flat_surface_needs_one_quad_per_span() {
        let net = net(4, 4, |y, x| Point3::new(x, y, 0.0));
        fn flat(order: usize, net: &ControlNet) -> Mesh {
            let knots = KnotVector::uniform(4, order).unwrap();
            Surface::new(net.clone(), knots.clone(), knots).unwrap().tessellate(0, 0).unwrap()
        }
        assert_eq!([2, 3, 4].map(|order| flat(order, &net).faces().len()), [9, 4, 1]);
    }

    #[test]
    fn a_mesh_that_no_index_can_count_is_refused() {
        assert!(matches!(bulge().tessellate(usize::MAX, 0), Err(MeshError::TooLarge { .. })));
        assert!(matches!(bulge().tessellate(1 << 20, 1 << 20), Err(MeshError::TooLarge { .. })));
    }

    #[test]
    fn the_largest_net_has_finite_points() {
        let huge = vec![Point3::new(3e38, -3e38, 3e38); 4];
        let line = KnotVector::uniform(2, 2).unwrap();
        let net = ControlNet::new(2, 2, huge).unwrap().with_weights(vec![3e38; 4]).unwrap();
        let surface = Surface::new(net, line.clone(), line).unwrap();
        assert!(surface.tessellate(0, 0).is_ok());
    }
}
