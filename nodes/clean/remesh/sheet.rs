//! Nearest points of a surface, on the wall to which a vertex belongs.

use std::iter;

use maquette_value::parallel::*;
use maquette_value::{Mesh, NearestPoint, TriangleTree, closest_on_triangle};
use nalgebra::{Point3, Vector3};

use super::net::{NONE, previous};

/// Two points are one if their squared distance is below this fraction of the squared distance to the surface.
const EQUAL: f64 = 1e-9;

/// Bound of rounding errors of positions, as a fraction of the coordinates.
const ROUNDING: f64 = 1e-13;

/// A surface that may be folded into walls near each other. The nearest point is searched from a triangle on, so that it is on the wall of
/// that triangle.
pub(super) struct Sheet<'a> {
    mesh: &'a Mesh,
    tree: TriangleTree,
    /// The vertices, the corners among those of all faces, and the face of each triangle.
    triangles: Vec<[u32; 3]>,
    corners: Vec<[u32; 3]>,
    parents: Vec<u32>,
    /// The opposite half-edge of each half-edge.
    twins: Vec<u32>,
}

/// The point of a triangle that is nearest to another point.
#[derive(Clone, Copy)]
struct Foot {
    triangle: u32,
    square: f64,
    barycentric: [f64; 3],
}

/// A point of the surface for a vertex.
pub(super) struct Landing {
    pub place: Point3<f64>,
    /// The normal of the triangle that contains the point. Its length is twice the triangle's area.
    pub normal: Vector3<f64>,
    pub triangle: u32,
    /// True if another wall is nearer.
    pub has_nearer_wall: bool,
}

impl<'a> Sheet<'a> {
    /// `twins` are the opposite half-edges of the mesh's triangles.
    pub(super) fn new(mesh: &'a Mesh, twins: Vec<u32>) -> Self {
        let parents = (0u32..).zip(mesh.faces().iter());
        let parents = parents.flat_map(|(parent, face)| iter::repeat_n(parent, face.len() - 2));
        Self {
            mesh,
            tree: TriangleTree::new(mesh),
            triangles: mesh.triangles().into_owned(),
            corners: mesh.triangle_corners(),
            parents: parents.collect(),
            twins,
        }
    }

    /// The face of each triangle.
    pub(super) fn parents(&self) -> &[u32] {
        &self.parents
    }

    /// Returns for each point the nearest point on the wall of the triangle with the same index in `starts`. `None` if the distance
    /// overflows.
    pub(super) fn land(&self, points: &[Point3<f64>], starts: &[u32]) -> Vec<Option<Landing>> {
        self.feet(points, starts)
            .into_par_iter()
            .with_min_len(256)
            .map(|foot| {
                let (foot, has_nearer_wall) = foot?;
                let [a, b, c] = self.places(foot.triangle);
                let (ab, ac) = (b - a, c - a);
                let place = a + ab * foot.barycentric[1] + ac * foot.barycentric[2];
                let (normal, triangle) = (ab.cross(&ac), foot.triangle);
                Some(Landing { place, normal, triangle, has_nearer_wall })
            })
            .collect()
    }

    /// Returns the same points as [`land`](Self::land). A point whose distance overflows gets the first face.
    pub(super) fn nearest(&self, points: &[Point3<f64>], starts: &[u32]) -> Vec<NearestPoint> {
        self.feet(points, starts)
            .into_par_iter()
            .with_min_len(256)
            .map(|foot| {
                let Some((foot, _)) = foot else {
                    let barycentric = [1.0, 0.0, 0.0];
                    let (distance_sq, corners) = (f64::INFINITY, [0; 3]);
                    return NearestPoint { distance_sq, face: 0, corners, barycentric };
                };
                NearestPoint {
                    distance_sq: foot.square,
                    face: self.parents[foot.triangle as usize],
                    corners: self.corners[foot.triangle as usize],
                    barycentric: foot.barycentric,
                }
            })
            .collect()
    }

    /// Returns for each point the nearest point on the wall of its start triangle, and true if the nearest point of the whole surface is on
    /// another wall. `None` if the distance overflows.
    fn feet(&self, points: &[Point3<f64>], starts: &[u32]) -> Vec<Option<(Foot, bool)>> {
        let walks = points.par_iter().zip(starts).with_min_len(256);
        let own: Vec<Foot> =
            walks.map(|(&point, &start): (&Point3<f64>, &u32)| self.walk(point, start)).collect();
        let squares: Vec<f64> = own.iter().map(|foot| foot.square).collect();
        let nearer = self.tree.nearest_below(points, &squares);
        own.par_iter()
            .zip(&nearer)
            .with_min_len(256)
            .map(|(&own, nearer): (&Foot, &Option<NearestPoint>)| match nearer {
                Some(nearer) => Some(self.choose(own, nearer)),
                None => own.square.is_finite().then_some((own, false)),
            })
            .collect()
    }

    /// Chooses between the end of a walk and the nearest point of the whole surface. Returns true as well if the latter is on another wall.
    fn choose(&self, own: Foot, nearest: &NearestPoint) -> (Foot, bool) {
        let first = self.parents.partition_point(|&parent| parent < nearest.face);
        let triangle = self.corners[first..].iter().position(|it| *it == nearest.corners);
        let global = Foot {
            triangle: (first + triangle.unwrap_or_default()) as u32,
            square: nearest.distance_sq,
            barycentric: nearest.barycentric,
        };
        // A walk can end too early, where the surface is rough. It then meets the other walk, which comes from the nearest point.
        let place = self.place(&own);
        let gap = (self.place(&global) - place).norm_squared();
        let rounding = ROUNDING * ROUNDING * place.coords.norm_squared();
        let equal = EQUAL * gap.max(own.square) + rounding;
        if gap <= equal || self.walk(place, global.triangle).square <= equal {
            (global, false)
        } else {
            (own, global.square < own.square)
        }
    }

    /// Walks from a triangle to neighbors that are nearer to a point until there are none.
    fn walk(&self, point: Point3<f64>, start: u32) -> Foot {
        let mut foot = self.foot(point, start);
        loop {
            let before = foot.square;
            let first = 3 * foot.triangle;
            match foot.barycentric.map(|weight| weight != 0.0) {
                [true, true, false] => self.cross_side(point, first, &mut foot),
                [false, true, true] => self.cross_side(point, first + 1, &mut foot),
                [true, false, true] => self.cross_side(point, first + 2, &mut foot),
                [true, false, false] => self.go_around(point, first, &mut foot),
                [false, true, false] => self.go_around(point, first + 1, &mut foot),
                [false, false, true] => self.go_around(point, first + 2, &mut foot),
                [true, true, true] | [false, false, false] => {}
            }
            // The comparison is also false if the distance is NaN.
            let is_nearer = foot.square < before;
            if !is_nearer {
                return foot;
            }
        }
    }

    /// Replaces `foot` by the nearest point of the triangle across a half-edge if that one is nearer.
    fn cross_side(&self, point: Point3<f64>, h: u32, foot: &mut Foot) {
        self.try_triangle(point, self.twins[h as usize], foot);
    }

    /// Replaces `foot` by the nearest point of the triangles around the start of a half-edge if that one is nearer.
    fn go_around(&self, point: Point3<f64>, h: u32, foot: &mut Foot) {
        self.visit_fan(h, |h| self.try_triangle(point, h, foot));
    }

    /// Replaces `foot` by the nearest point of a half-edge's triangle if that one is nearer.
    fn try_triangle(&self, point: Point3<f64>, h: u32, foot: &mut Foot) {
        if h != NONE {
            let other = self.foot(point, h / 3);
            if other.square < foot.square {
                *foot = other;
            }
        }
    }

    /// Visits a half-edge of each triangle around the start of a half-edge.
    fn visit_fan(&self, start: u32, mut see: impl FnMut(u32)) {
        let mut h = self.twins[previous(start) as usize];
        while h != NONE && h != start {
            see(h);
            h = self.twins[previous(h) as usize];
        }
        if h == start {
            return;
        }
        // The walk has reached a border. Visit the remaining triangles in the other direction.
        let mut h = self.twins[start as usize];
        while h != NONE {
            see(h);
            h = self.twins[super::net::next(h) as usize];
        }
    }

    fn foot(&self, point: Point3<f64>, triangle: u32) -> Foot {
        let (square, barycentric) = closest_on_triangle(point, self.places(triangle));
        Foot { triangle, square, barycentric }
    }

    fn place(&self, foot: &Foot) -> Point3<f64> {
        let [a, b, c] = self.places(foot.triangle);
        a + (b - a) * foot.barycentric[1] + (c - a) * foot.barycentric[2]
    }

    fn places(&self, triangle: u32) -> [Point3<f64>; 3] {
        self.triangles[triangle as usize].map(|vertex| self.mesh.positions()[vertex as usize])
    }
}
