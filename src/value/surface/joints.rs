//! Seams and poles of a surface: places where different parameters have the same point, at which a tessellation is joined.

use nalgebra::{Point3, Unit, Vector3};

use super::super::{Attribute, Faces, KnotVector, Mesh, MeshError};
use super::tessellate::divide_spans;
use super::{ParameterDirection, Surface};
use crate::mesh::diagonal;
use crate::union_find::UnionFind;

/// The maximum distance between points that count as one, as a fraction of the diagonal of the control points' bounding box.
const SAME_POINT: f64 = 1e-9;

/// The maximum difference of unit normals at one vertex that counts as rounding: where normals differ more, the surface has an edge or a
/// tip.
const SAME_NORMAL: f64 = 1e-2;

/// The distance from a pole at which its normal is taken, as a fraction of the domain. The normal differs by about as much from that at the
/// pole, and the tangents are exact to ten digits.
const BESIDE_POLE: f64 = 5e-6;

/// The minimum number of quads around a surface that is joined at its seam. Two would lie back to back.
pub(super) const MIN_AROUND: usize = 3;

/// The joints of a surface.
pub(super) struct Joints<'a> {
    surface: &'a Surface,
    tolerance: f64,
    /// True if the first and the last row, of constant u, have equal points. `is_closed_v` is true if the first and last column have.
    pub(super) is_closed_u: bool,
    pub(super) is_closed_v: bool,
}

impl<'a> Joints<'a> {
    pub(super) fn new(surface: &'a Surface) -> Self {
        let tolerance = SAME_POINT * diagonal(surface.net.points());
        let mut joints = Self { surface, tolerance, is_closed_u: false, is_closed_v: false };
        fn ends(knots: &KnotVector) -> [f64; 2] {
            <[f64; 2]>::from(knots.domain())
        }
        let [first, last] = ends(&surface.u).map(|u| joints.line(ParameterDirection::U, u));
        joints.is_closed_u = joints.agree(&first, &last);
        let [first, last] = ends(&surface.v).map(|v| joints.line(ParameterDirection::V, v));
        joints.is_closed_v = joints.agree(&first, &last);
        joints
    }

    /// The points of a line of the surface on which the parameter along `fixed` has the value `at`.
    fn line(&self, fixed: ParameterDirection, at: f64) -> Vec<Point3<f64>> {
        // Two pieces of the same knots that agree at more points than they have coefficients are equal.
        fn samples(knots: &KnotVector) -> Vec<f64> {
            divide_spans(knots, 2 * (knots.degree() + 1))
        }
        match fixed {
            ParameterDirection::U => self.surface.grid(&[at], &samples(&self.surface.v)),
            ParameterDirection::V => self.surface.grid(&samples(&self.surface.u), &[at]),
        }
    }

    fn agree(&self, a: &[Point3<f64>], b: &[Point3<f64>]) -> bool {
        self.tolerance > 0.0 && a.iter().zip(b).all(|(a, b)| (a - b).norm() <= self.tolerance)
    }

    /// Returns true if two vertices of a tessellation are at the same point.
    pub(super) fn is_close(&self, open: &OpenMesh, a: u32, b: u32) -> bool {
        self.agree(&[open.points[a as usize]], &[open.points[b as usize]])
    }

    /// The normal at a pole, of the surface before or after the pole, or zero if there is none. The parameter along `fixed` is the same
    /// everywhere at the pole. The normal is taken a little beside the pole, where the tangents span a plane.
    pub(super) fn normal_beside(
        &self,
        fixed: ParameterDirection,
        [u, v]: [f64; 2],
        is_before: bool,
    ) -> Vector3<f64> {
        fn beside(knots: &KnotVector, at: f64, is_before: bool) -> f64 {
            let (start, end) = knots.domain();
            at + BESIDE_POLE * if is_before { start - end } else { end - start }
        }
        let normal = match fixed {
            ParameterDirection::U => self.surface.normal(beside(&self.surface.u, u, is_before), v),
            ParameterDirection::V => self.surface.normal(u, beside(&self.surface.v, v, is_before)),
        };
        normal.map_or(Vector3::zeros(), Unit::into_inner)
    }

    /// Returns true if the line on which the parameter along `fixed` has the value `at` is a single point: a pole.
    pub(super) fn is_pole(&self, fixed: ParameterDirection, at: f64) -> bool {
        let line = self.line(fixed, at);
        self.agree(&line, &vec![line[0]; line.len()])
    }
}

impl Surface {
    /// Returns true if different parameters at the ends of the domain have the same point: the surface is closed in a direction, or a
    /// border is a single point. A tessellation is joined there.
    pub fn has_joints(&self) -> bool {
        let joints = Joints::new(self);
        let is_pole = |fixed, knots: &KnotVector| {
            <[f64; 2]>::from(knots.domain()).into_iter().any(|at| joints.is_pole(fixed, at))
        };
        joints.is_closed_u
            || joints.is_closed_v
            || is_pole(ParameterDirection::U, &self.u)
            || is_pole(ParameterDirection::V, &self.v)
    }
}

/// A tessellation before vertices at seams and poles are joined, with one vertex for each pair of parameters.
pub(super) struct OpenMesh {
    pub(super) points: Vec<Point3<f64>>,
    pub(super) normals: Vec<Vector3<f64>>,
    /// The parameters of the vertices, scaled to 0..1.
    pub(super) uv: Vec<[f64; 2]>,
    pub(super) faces: Faces,
}

impl OpenMesh {
    /// Sets the normal of a vertex, or adds a vertex that differs only by its normal. Returns the vertex.
    pub(super) fn set_normal(&mut self, vertex: u32, normal: Vector3<f64>, is_new: bool) -> u32 {
        if !is_new {
            self.normals[vertex as usize] = normal;
            return vertex;
        }
        self.points.push(self.points[vertex as usize]);
        self.uv.push(self.uv[vertex as usize]);
        self.normals.push(normal);
        self.points.len() as u32 - 1
    }

    /// The mesh without joints. Its attributes are `uv` and `normal` of vertices.
    pub(super) fn into_mesh(self) -> Result<Mesh, MeshError> {
        let normals = self.normals.into_iter().map(<[f64; 3]>::from);
        Mesh::new(self.points, self.faces)?
            .with_vertex("uv", Attribute::Pair(self.uv.into()))?
            .with_vertex("normal", Attribute::Vector(normals.collect()))
    }

    /// The mesh in which the vertices of each set are one, namely the first. Corners that meet in a face become one, with the mean of their
    /// parameters, and faces without area are left out.
    ///
    /// The attribute `uv` belongs to corners, and so does `normal` if the surface has an edge or a tip at a joint.
    pub(super) fn join(self, joined: &mut UnionFind) -> Result<Mesh, MeshError> {
        let mut list = CornerList::with_capacity(self.faces.len(), self.faces.corners().len());
        for face in self.faces.iter() {
            list.add_face(face.iter().map(|&vertex| (joined.find(vertex), vertex)));
        }
        if list.sides.is_empty() {
            return self.into_mesh();
        }
        let Self { points, normals, uv, faces } = self;
        drop(faces);
        let CornerList { sides, vertices: mut corners, origins } = list;
        let mut is_used = vec![false; points.len()];
        corners.iter().for_each(|&vertex| is_used[vertex as usize] = true);
        let mut joined_points = Vec::with_capacity(points.len());
        let mut numbers = vec![0; points.len()];
        for vertex in (0..points.len()).filter(|&vertex| is_used[vertex]) {
            numbers[vertex] = joined_points.len() as u32;
            joined_points.push(points[vertex]);
        }
        corners.iter_mut().for_each(|corner| *corner = numbers[*corner as usize]);
        drop((points, is_used, numbers));
        fn corner_normal([a, b]: [u32; 2], normals: &[Vector3<f64>]) -> Vector3<f64> {
            match a == b {
                true => normals[a as usize],
                false => unit_or_zero(normals[a as usize] + normals[b as usize]),
            }
        }
        let mut means = vec![Vector3::zeros(); joined_points.len()];
        for (&vertex, &origin) in corners.iter().zip(&origins) {
            means[vertex as usize] += corner_normal(origin, &normals);
        }
        means.iter_mut().for_each(|sum| *sum = unit_or_zero(*sum));
        let is_smooth = corners.iter().zip(&origins).all(|(&vertex, &origin)| {
            let normal = corner_normal(origin, &normals);
            normal == Vector3::zeros() || (means[vertex as usize] - normal).norm() <= SAME_NORMAL
        });
        let corner_normals = (!is_smooth).then(|| {
            origins.iter().map(|&origin| corner_normal(origin, &normals).into()).collect::<Vec<_>>()
        });
        let uv = origins.iter().map(|origin| {
            let [a, b] = origin.map(|vertex| uv[vertex as usize]);
            [a[0].midpoint(b[0]), a[1].midpoint(b[1])]
        });
        let mesh = Mesh::new(joined_points, Faces::polygons(&sides, corners)?)?
            .with_corner("uv", Attribute::Pair(uv.collect()))?;
        match corner_normals {
            Some(normals) => mesh.with_corner("normal", Attribute::Vector(normals.into())),
            None => {
                let means = means.into_iter().map(<[f64; 3]>::from);
                mesh.with_vertex("normal", Attribute::Vector(means.collect()))
            }
        }
    }
}

/// The corners of the joined faces.
struct CornerList {
    sides: Vec<usize>,
    /// For each corner, the first vertex of its set.
    vertices: Vec<u32>,
    /// For each corner, its vertex in the open mesh. If two corners became one, both, the lower one first.
    origins: Vec<[u32; 2]>,
}

impl CornerList {
    fn with_capacity(faces: usize, corners: usize) -> Self {
        Self {
            sides: Vec::with_capacity(faces),
            vertices: Vec::with_capacity(corners),
            origins: Vec::with_capacity(corners),
        }
    }

    /// Adds a face of three or four corners, unless fewer than three of them differ. Each corner is given by the first vertex of its set
    /// and by its own vertex.
    fn add_face(&mut self, corners: impl Iterator<Item = (u32, u32)>) {
        let before = self.vertices.len();
        for (first, vertex) in corners {
            if self.vertices.len() > before && self.vertices.last() == Some(&first) {
                self.merge(self.origins.len() - 1, vertex);
            } else {
                self.vertices.push(first);
                self.origins.push([vertex; 2]);
            }
        }
        if self.vertices.len() - before > 1
            && self.vertices[before] == self.vertices[self.vertices.len() - 1]
        {
            self.vertices.pop();
            let [vertex, _] = self.origins.pop().unwrap_or_default();
            self.merge(before, vertex);
        }
        match self.vertices.len() - before {
            sides @ 3.. => self.sides.push(sides),
            _ => {
                self.vertices.truncate(before);
                self.origins.truncate(before);
            }
        }
    }

    fn merge(&mut self, corner: usize, vertex: u32) {
        let [first, _] = self.origins[corner];
        self.origins[corner] = [first.min(vertex), first.max(vertex)];
    }
}

fn unit_or_zero(vector: Vector3<f64>) -> Vector3<f64> {
    vector.try_normalize(0.0).unwrap_or_else(Vector3::zeros)
}

#[cfg(test)]
mod tests {
    use super::super::super::{ControlNet, Extent, Topology};
    use super::*;

    /// Returns the surface of revolution of a profile of arcs or, if `is_round` is false, of straight lines; around the z axis. Each point
    /// has the distance from the axis and the height.
    fn revolved(profile: &[[f64; 2]], is_round: bool) -> Surface {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let around = [
            [1., 0.],
            [1., 1.],
            [0., 1.],
            [-1., 1.],
            [-1., 0.],
            [-1., -1.],
            [0., -1.],
            [1., -1.],
            [1., 0.],
        ];
        let (mut points, mut weights) = (Vec::new(), Vec::new());
        for (row, [radius, z]) in profile.iter().enumerate() {
            for (column, [x, y]) in around.iter().enumerate() {
                points.push(Point3::new(radius * x, radius * y, *z));
                let is_middle = is_round && row % 2 == 1;
                weights.push([1.0, half][usize::from(is_middle)] * [1.0, half][column % 2]);
            }
        }
        let net = ControlNet::new(profile.len(), 9, points).unwrap().with_weights(weights).unwrap();
        Surface::new(net, arcs(profile.len(), is_round), arcs(9, true)).unwrap()
    }

    /// Returns the knots of arcs of a quarter circle each, or of straight lines.
    fn arcs(count: usize, is_round: bool) -> KnotVector {
        if !is_round {
            return KnotVector::uniform(count, 2).unwrap();
        }
        let last = (count / 2) as f64;
        let inner = (1..count / 2).flat_map(|k| [k as f64; 2]);
        let knots = [0.0; 3].into_iter().chain(inner).chain([last; 3]).collect();
        KnotVector::new(2, knots).unwrap()
    }

    fn ball() -> Surface {
        revolved(&[[0., -1.], [1., -1.], [1., 0.], [1., 1.], [0., 1.]], true)
    }

    /// Returns a torus: both directions are closed.
    fn ring() -> Surface {
        let [low, high] = [2.0, 4.0];
        let profile = [
            [high, 0.],
            [high, 1.],
            [3., 1.],
            [low, 1.],
            [low, 0.],
            [low, -1.],
            [3., -1.],
            [high, -1.],
            [high, 0.],
        ];
        revolved(&profile, true)
    }

    /// Checks that a mesh is manifold, oriented and without faces that visit a vertex or a place twice.
    fn check(mesh: &Mesh) -> Topology {
        let counts = Topology::from_mesh(mesh);
        assert_eq!((counts.non_manifold, counts.misoriented), (0, 0));
        for face in mesh.faces().iter() {
            assert!(mesh.area_vector(face).norm() > 0.0);
        }
        assert!(Extent::from_mesh(mesh).shortest > 0.0);
        counts
    }

    #[test]
    fn a_ball_is_closed_and_has_its_normals_at_the_poles_too() {
        for mesh in [
            ball().tessellate(0, 0),
            ball().tessellate(7, 5),
            ball().tessellate(2, 3),
            ball().tessellate_within(0.01),
            ball().tessellate_within(10.0),
        ] {
            let mesh = mesh.unwrap();
            let counts = check(&mesh);
            assert_eq!((counts.boundary, counts.euler(), counts.components), (0, 2, 1));
            let normals = mesh.vertex().vectors("normal").unwrap();
            let side = Extent::from_mesh(&mesh).volume.signum();
            for (point, normal) in mesh.positions().iter().zip(normals.iter()) {
                assert!((side * point.coords - Vector3::from(*normal)).norm() <= 1e-5, "{point}");
            }
            let uv = mesh.corner().pairs("uv").unwrap();
            assert!(uv.iter().any(|[_, v]| *v == 1.0) && uv.iter().any(|[_, v]| *v == 0.0));
            // No face has parameters from both sides of the seam.
            for face in 0..mesh.faces().len() {
                let corners = mesh.faces().first_corner(face)..mesh.faces().first_corner(face + 1);
                let vs = uv[corners].iter().map(|[_, v]| *v);
                let (low, high) = vs.fold((1.0f64, 0.0f64), |(a, b), v| (a.min(v), b.max(v)));
                assert!(high - low <= 0.5, "{face}");
            }
        }
    }

    #[test]
    fn a_ring_is_closed_in_both_directions() {
        for mesh in
            [ring().tessellate(0, 0), ring().tessellate(3, 4), ring().tessellate_within(0.05)]
        {
            let counts = check(&mesh.unwrap());
            assert_eq!((counts.boundary, counts.euler()), (0, 0));
        }
        let open = ring().tessellate(2, 8).unwrap();
        assert_eq!(
            Topology::from_mesh(&open).boundary,
            16,
            "two quads around would be back to back"
        );
    }

    #[test]
    fn a_cone_has_a_normal_for_each_corner_at_its_tip() {
        let cone = revolved(&[[0., 2.], [1., 0.]], false);
        for mesh in [cone.tessellate(3, 12), cone.tessellate_within(0.01)] {
            let mesh = mesh.unwrap();
            assert_eq!(check(&mesh).euler(), 1);
            let normals = mesh.corner().vectors("normal").unwrap();
            // At the tip, the mean of two columns.
            let heights = normals.iter().map(|normal| normal[2].abs() - 1.0 / 5f64.sqrt());
            assert!(heights.clone().all(|height| (-1e-9..0.02).contains(&height)));
            assert!(heights.filter(|height| *height < 1e-9).count() >= 24);
        }
    }

    #[test]
    fn cones_that_touch_at_their_tips_stay_apart() {
        let glass = revolved(&[[0., 0.], [1., 1.], [0., 2.], [1., 3.], [0., 4.]], false);
        for mesh in [glass.tessellate(4, 8), glass.tessellate(8, 8), glass.tessellate_within(0.05)]
        {
            let mesh = mesh.unwrap();
            let counts = check(&mesh);
            assert_eq!((counts.components, counts.boundary, counts.euler()), (2, 0, 4));
            // At the tips the normals are on the side of the faces, also between the parts.
            let normals = mesh.corner().vectors("normal").unwrap();
            let corners = mesh.faces().corners();
            for face in 0..mesh.faces().len() {
                let of_face = mesh.area_vector(mesh.faces().face(face)).normalize();
                for corner in mesh.faces().first_corner(face)..mesh.faces().first_corner(face + 1) {
                    let point = mesh.positions()[corners[corner] as usize];
                    let is_side = of_face.dot(&Vector3::from(normals[corner])) > 0.7;
                    assert!(is_side || point.x * point.x + point.y * point.y > 1e-18, "{face}");
                }
            }
        }
    }

    #[test]
    fn an_open_surface_keeps_vertices_row_by_row() {
        let tube = revolved(&[[1., 0.], [1., 1.], [1., 2.]], false);
        let mesh = tube.tessellate(2, 6).unwrap();
        assert_eq!((mesh.positions().len(), check(&mesh).boundary), (18, 12));
        assert_eq!(mesh.positions()[7], tube.point(1.0, 4.0 / 6.0));
        assert_eq!(tube.tessellate_open(2, 6).unwrap().positions().len(), 21);
    }
}
