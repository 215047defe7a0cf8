//! Where a ray meets a mesh first.
//!
//! Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection" (2013), in double precision: two triangles that share an edge judge it
//! by the same numbers, so that no ray slips through between them.

use nalgebra::{Point3, Vector3};

use super::{Bounds, LEAF, Triangle, TriangleTree};
use crate::Mesh;

/// Where a ray meets a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// How far along the ray, in lengths of its direction.
    pub along: f64,
    /// The face.
    pub face: u32,
    /// The corners of its triangle, by index among the corners of all faces.
    pub corners: [u32; 3],
    /// How far each corner of the triangle weighs in the place.
    shares: [f64; 3],
}

impl RayHit {
    /// The weight of each corner of the triangle in the place.
    pub fn shares(&self) -> [f64; 3] {
        self.shares
    }

    /// The place.
    pub fn place(&self, mesh: &Mesh) -> Point3<f64> {
        let vertices = self.corners.map(|corner| mesh.faces().corners()[corner as usize]);
        let weighed = vertices.iter().zip(self.shares);
        Point3::from(weighed.fold(Vector3::zeros(), |sum, (&vertex, share)| {
            sum + mesh.positions()[vertex as usize].coords * share
        }))
    }
}

impl TriangleTree {
    /// Where a ray meets a triangle first, from whichever side; of several at the same distance the first face counts. None if it
    /// meets none, or its numbers are no ray.
    pub fn first_hit(&self, origin: Point3<f64>, direction: Vector3<f64>) -> Option<RayHit> {
        let ray = Ray::new(origin, direction)?;
        let mut best: Option<RayHit> = None;
        let mut stack = Vec::from_iter(ray.enters(&self.boxes[1]).map(|along| (1, along)));
        while let Some((node, along)) = stack.pop() {
            if best.is_some_and(|best| best.along < along) {
                continue;
            }
            if self.leaves <= node {
                let first = ((node - self.leaves) * LEAF).min(self.triangles.len());
                let last = (first + LEAF).min(self.triangles.len());
                for hit in self.triangles[first..last].iter().filter_map(|it| ray.hit(it)) {
                    best = Some(best.map_or(hit, |best| best.earlier(hit)));
                }
                continue;
            }
            let mut children = [2 * node, 2 * node + 1]
                .map(|child| ray.enters(&self.boxes[child]).map(|along| (child, along)));
            // The nearer one is looked into first.
            if children[0].is_some_and(|a| children[1].is_some_and(|b| a.1 < b.1)) {
                children.swap(0, 1);
            }
            stack.extend(children.into_iter().flatten());
        }
        best
    }
}

impl RayHit {
    fn earlier(self, other: Self) -> Self {
        let order = |hit: &Self| (hit.face, hit.corners);
        match other.along < self.along || other.along == self.along && order(&other) < order(&self)
        {
            true => other,
            false => self,
        }
    }
}

/// A ray, and the axes in which it runs along z: `axes[2]` is the one along which it goes farthest.
struct Ray {
    origin: Point3<f64>,
    direction: Vector3<f64>,
    axes: [usize; 3],
    /// How far x and y go aside for each step of z, and what one step of z is of the ray.
    shear: [f64; 3],
}

impl Ray {
    /// None if a number is not finite, or it goes nowhere.
    fn new(origin: Point3<f64>, direction: Vector3<f64>) -> Option<Self> {
        let along = direction.iamax();
        let axes = [(along + 1) % 3, (along + 2) % 3, along];
        let [x, y, z] = axes.map(|axis| direction[axis]);
        let shear = [x / z, y / z, 1.0 / z];
        let is_one = shear.iter().chain(&origin.coords).chain(&direction).all(|x| x.is_finite());
        is_one.then_some(Self { origin, direction, axes, shear })
    }

    /// How far along the ray it enters a box, or 0 if it begins inside; none if it misses it.
    fn enters(&self, [low, high]: &Bounds) -> Option<f64> {
        // Whatever the roundings were, a box that is met is not missed.
        const SLACK: f64 = 1.0 + 4.0 * f64::EPSILON;
        let (mut enters, mut leaves) = (0.0, f64::INFINITY);
        for axis in 0..3 {
            let (low, high) = (f64::from(low[axis]), f64::from(high[axis]));
            let (origin, step) = (self.origin[axis], self.direction[axis]);
            // The box of no triangle.
            if high < low {
                return None;
            }
            if step == 0.0 {
                if origin < low || high < origin {
                    return None;
                }
                continue;
            }
            let (a, b) = ((low - origin) / step, (high - origin) / step);
            enters = f64::max(enters, f64::min(a, b));
            leaves = f64::min(leaves, f64::max(a, b) * SLACK);
        }
        (enters <= leaves).then_some(enters)
    }

    /// Where it meets a triangle. The letters are those of the paper.
    fn hit(&self, triangle: &Triangle) -> Option<RayHit> {
        let [a, b, c] = triangle.places.map(|corner| {
            let [x, y, z] = self.axes.map(|axis| corner[axis] - self.origin[axis]);
            [x - self.shear[0] * z, y - self.shear[1] * z, self.shear[2] * z]
        });
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        fn has(is: fn(&f64) -> bool, u: f64, v: f64, w: f64) -> bool {
            [u, v, w].iter().any(is)
        }
        if has(|x| *x < 0.0, u, v, w) && has(|x| 0.0 < *x, u, v, w) {
            return None;
        }
        let det = u + v + w;
        let along = (u * a[2] + v * b[2] + w * c[2]) / det;
        // A triangle without an area as the ray sees it: the quotients are not finite.
        let is_met = det != 0.0 && 0.0 <= along && along.is_finite();
        let shares = [u / det, v / det, w / det];
        let Triangle { face, corners, .. } = *triangle;
        is_met.then_some(RayHit { along, face, corners, shares })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Faces;
    use crate::random::Random;

    /// What a look at all triangles finds.
    fn slowly(tree: &TriangleTree, origin: Point3<f64>, to: Vector3<f64>) -> Option<RayHit> {
        let ray = Ray::new(origin, to)?;
        tree.triangles.iter().filter_map(|triangle| ray.hit(triangle)).reduce(RayHit::earlier)
    }

    fn triangles(corners: Vec<Point3<f64>>) -> Mesh {
        let faces = (0..corners.len() as u32 / 3).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]);
        let faces = Faces::triangles(faces.collect());
        Mesh::new(corners, faces).unwrap()
    }

    #[test]
    fn the_tree_meets_what_a_look_at_all_triangles_meets() {
        let mut random = Random(7);
        let mut number = |size: f64| (random.even() - 0.5) * size;
        let mut corners = Vec::new();
        for k in 0..600 {
            let middle = Vector3::new(number(20.0), number(20.0), number(20.0));
            let mut corner =
                || Point3::from(middle + Vector3::new(number(3.0), number(3.0), number(3.0)));
            let mut corner = [corner(), corner(), corner()];
            match k % 10 {
                // Without an area: a line, a point.
                0 => corner[2] = nalgebra::center(&corner[0], &corner[1]),
                1 => corner = [corner[0]; 3],
                // In a plane of two axes.
                2 => corner.iter_mut().for_each(|corner| corner.z = 1.0),
                _ => {}
            }
            corners.extend(corner);
        }
        let mesh = triangles(corners);
        let tree = TriangleTree::new(&mesh);
        let mut met = 0;
        for k in 0..3000 {
            let origin = Point3::new(number(30.0), number(30.0), number(30.0));
            let mut to = Vector3::new(number(1.0), number(1.0), number(1.0));
            if k % 3 == 0 {
                to[k / 3 % 3] = 0.0;
            }
            // Straight at a vertex, of which the line of sight is an edge of boxes and triangles.
            if k % 5 == 0 {
                to = mesh.positions()[k % mesh.positions().len()] - origin;
            }
            let hit = tree.first_hit(origin, to);
            assert_eq!(hit, slowly(&tree, origin, to), "{origin} {to}");
            if let Some(hit) = hit {
                let off = (origin + to * hit.along - hit.place(&mesh)).norm();
                assert!(off < 1e-9, "{off}");
                met += 1;
            }
        }
        assert!((300..2900).contains(&met), "{met}");
    }

    #[test]
    fn no_ray_slips_through_between_two_faces() {
        fn at(k: u32) -> Point3<f64> {
            let bump = f64::from(k * k % 17) / 50.0;
            Point3::new(f64::from(k % 20), f64::from(k / 20), bump)
        }
        let quads = (0..19).flat_map(|row| (0..19).map(move |column| row * 20 + column));
        let quads = quads.flat_map(|a: u32| [a, a + 1, a + 21, a + 20]);
        let faces = Faces::polygons(&[4; 19 * 19], quads.collect()).unwrap();
        let mesh = Mesh::new((0..400).map(at).collect::<Vec<_>>(), faces).unwrap();
        let tree = TriangleTree::new(&mesh);
        let from = Point3::new(9.3, 8.7, 30.1);
        let mut fans = [0; 2];
        for (a, b) in (21..380).filter(|k| (1..18).contains(&(k % 20))).map(|k| (at(k), at(k + 1)))
        {
            for share in [0.0, 0.25, 0.3, 1.0] {
                let to = a + (b - a) * share;
                let hit = tree.first_hit(from, to - from).unwrap();
                assert!((hit.place(&mesh) - to).norm() < 1e-9, "{to}");
                let vertices = hit.corners.map(|corner| mesh.faces().corners()[corner as usize]);
                assert!(vertices.iter().all(|v| mesh.faces().face(hit.face as usize).contains(v)));
                fans[hit.corners[1] as usize % 4 - 1] += 1;
                // Straight down, along the faces of the tree's boxes.
                let above = Point3::new(to.x, to.y, 5.0);
                assert!(tree.first_hit(above, -Vector3::z()).is_some(), "{above}");
                assert!(tree.first_hit(above, Vector3::z()).is_none());
            }
        }
        assert!(fans.iter().all(|&count| count > 0), "{fans:?}");
        // Along the plane of a face, and along an edge in it.
        let flat = triangles(vec![
            Point3::origin(),
            Point3::new(1.0, 0.0, 0.0),
            Point3::new(0.0, 1.0, 0.0),
        ]);
        let tree = TriangleTree::new(&flat);
        for y in [0.0, 0.3] {
            assert!(tree.first_hit(Point3::new(-1.0, y, 0.0), Vector3::x()).is_none());
        }
    }

    #[test]
    fn what_is_no_ray_meets_nothing() {
        let one = triangles(vec![
            Point3::new(-1.0, -1.0, 0.0),
            Point3::new(1.0, -1.0, 0.0),
            Point3::new(0.0, 1.0, 0.0),
        ]);
        let tree = TriangleTree::new(&one);
        fn hit(origin: [f64; 3], to: [f64; 3], tree: &TriangleTree) -> Option<RayHit> {
            tree.first_hit(origin.into(), to.into())
        }
        // From both sides, at any length of the direction.
        for scale in [1e-200, 1.0, -1.0, 1e200] {
            let hit = hit([0.0, 0.0, scale], [0.0, 0.0, -scale], &tree).unwrap();
            assert_eq!((hit.along, hit.face), (1.0, 0));
        }
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(hit([0.0, 0.0, bad], [0.0, 0.0, 1.0], &tree), None);
            assert_eq!(hit([0.0, 0.0, 1.0], [0.0, 0.0, bad], &tree), None);
        }
        assert_eq!(hit([0.0; 3], [0.0; 3], &tree), None);
        let none = TriangleTree::new(&Mesh::new(Vec::new(), Faces::triangles(Vec::new())).unwrap());
        assert_eq!(none.first_hit(Point3::origin(), Vector3::x()), None);
    }
}
