//! The first hit of a ray on a mesh.
//!
//! Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection" (2013), here in double precision. Two triangles that share an edge use
//! the same numbers for that edge, so no ray passes between them.

use nalgebra::{Point3, Vector3};

use super::{Bounds, LEAF, Triangle, TriangleTree};
use crate::Mesh;

/// A hit of a ray on a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// The ray parameter of the hit, in multiples of the direction's length.
    pub along: f64,
    /// The face that the ray hits.
    pub face: u32,
    /// The corners of the triangle that the ray hits, as indices among the corners of all faces.
    pub corners: [u32; 3],
    /// The barycentric coordinates of the hit.
    barycentric: [f64; 3],
}

impl RayHit {
    /// The barycentric coordinates of the hit.
    pub fn barycentric(&self) -> [f64; 3] {
        self.barycentric
    }

    /// The position of the hit.
    pub fn position(&self, mesh: &Mesh) -> Point3<f64> {
        let vertices = self.corners.map(|corner| mesh.faces().corners()[corner as usize]);
        let weighed = vertices.iter().zip(self.barycentric);
        Point3::from(weighed.fold(Vector3::zeros(), |sum, (&vertex, fraction)| {
            sum + mesh.positions()[vertex as usize].coords * fraction
        }))
    }
}

impl TriangleTree {
    /// The first triangle that a ray hits, from either side. At equal distances it is the triangle of the face with the lowest index.
    /// `None` if the ray hits nothing, has no direction, or is not finite.
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
            // The child of the node that is nearer to the ray's origin is visited first.
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
        let is_earlier = other.along < self.along
            || other.along == self.along && (other.face, other.corners) < (self.face, self.corners);
        if is_earlier { other } else { self }
    }
}

/// A ray, and a permutation of the axes that makes z the dominant axis: `axes[2]` is the axis along which the direction is longest.
struct Ray {
    origin: Point3<f64>,
    direction: Vector3<f64>,
    axes: [usize; 3],
    /// The steps in x and y per step of z, and the ray parameter per step of z.
    shear: [f64; 3],
}

impl Ray {
    /// Builds the ray. Returns `None` if a number is not finite or the direction is zero.
    fn new(origin: Point3<f64>, direction: Vector3<f64>) -> Option<Self> {
        let along = direction.iamax();
        let axes = [(along + 1) % 3, (along + 2) % 3, along];
        let [x, y, z] = axes.map(|axis| direction[axis]);
        let shear = [x / z, y / z, 1.0 / z];
        let is_one = shear.iter().chain(&origin.coords).chain(&direction).all(|x| x.is_finite());
        is_one.then_some(Self { origin, direction, axes, shear })
    }

    /// The ray parameter at which the ray enters a box, or 0 if the ray begins inside the box. `None` if the ray misses the box.
    fn enters(&self, [low, high]: &Bounds) -> Option<f64> {
        // The factor compensates for rounding, because a box that is hit must not be missed.
        const SLACK: f64 = 1.0 + 4.0 * f64::EPSILON;
        let (mut enters, mut leaves) = (0.0, f64::INFINITY);
        for axis in 0..3 {
            let (low, high) = (f64::from(low[axis]), f64::from(high[axis]));
            let (origin, step) = (self.origin[axis], self.direction[axis]);
            // An empty box, whose minimum exceeds its maximum, is never hit.
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

    /// The hit on a triangle. The names of variables are those of Woop, Benthin and Wald (2013).
    fn hit(&self, triangle: &Triangle) -> Option<RayHit> {
        let [a, b, c] = triangle.positions.map(|corner| {
            let [x, y, z] = self.axes.map(|axis| corner[axis] - self.origin[axis]);
            [x - self.shear[0] * z, y - self.shear[1] * z, self.shear[2] * z]
        });
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        let weights = [u, v, w];
        if weights.iter().any(|x| *x < 0.0) && weights.iter().any(|x| 0.0 < *x) {
            return None;
        }
        let det = u + v + w;
        let along = (u * a[2] + v * b[2] + w * c[2]) / det;
        // If the triangle has no area as seen along the ray, the quotients are not finite. Such a triangle is not hit.
        let is_met = det != 0.0 && 0.0 <= along && along.is_finite();
        let barycentric = [u / det, v / det, w / det];
        let Triangle { face, corners, .. } = *triangle;
        is_met.then_some(RayHit { along, face, corners, barycentric })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Faces;
    use crate::mesh::tests::sheet;
    use crate::rng::Random;

    /// Finds the hit by testing all triangles.
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
    fn the_tree_finds_the_same_hits_as_a_full_scan() {
        let mut random = Random(7);
        let mut number = |size: f64| (random.even() - 0.5) * size;
        let mut corners = Vec::new();
        for k in 0..600 {
            let middle = Vector3::new(number(20.0), number(20.0), number(20.0));
            let mut corner =
                || Point3::from(middle + Vector3::new(number(3.0), number(3.0), number(3.0)));
            let mut corner = [corner(), corner(), corner()];
            match k % 10 {
                // Degenerate triangles: one is a line, one is a point.
                0 => corner[2] = nalgebra::center(&corner[0], &corner[1]),
                1 => corner = [corner[0]; 3],
                // The triangle is parallel to the x and y axes.
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
            // The ray aims exactly at a vertex, where it runs along edges of boxes and triangles.
            if k % 5 == 0 {
                to = mesh.positions()[k % mesh.positions().len()] - origin;
            }
            let hit = tree.first_hit(origin, to);
            assert_eq!(hit, slowly(&tree, origin, to), "{origin} {to}");
            if let Some(hit) = hit {
                let off = (origin + to * hit.along - hit.position(&mesh)).norm();
                assert!(off < 1e-9, "{off}");
                met += 1;
            }
        }
        assert!((300..2900).contains(&met), "{met}");
    }

    #[test]
    fn no_ray_passes_between_two_faces() {
        let mesh = sheet([20, 20], 4, |k| f64::from(k * k % 17) / 50.0);
        let tree = TriangleTree::new(&mesh);
        let from = Point3::new(9.3, 8.7, 30.1);
        let mut fans = [0; 2];
        for k in (21..380).filter(|k| (1..18).contains(&(k % 20))) {
            let [a, b] = [mesh.positions()[k], mesh.positions()[k + 1]];
            for fraction in [0.0, 0.25, 0.3, 1.0] {
                let to = a + (b - a) * fraction;
                let hit = tree.first_hit(from, to - from).unwrap();
                assert!((hit.position(&mesh) - to).norm() < 1e-9, "{to}");
                let vertices = hit.corners.map(|corner| mesh.faces().corners()[corner as usize]);
                assert!(vertices.iter().all(|v| mesh.faces().face(hit.face as usize).contains(v)));
                fans[hit.corners[1] as usize % 4 - 1] += 1;
                // The rays run straight down, along the sides of the tree's boxes.
                let above = Point3::new(to.x, to.y, 5.0);
                assert!(tree.first_hit(above, -Vector3::z()).is_some(), "{above}");
                assert!(tree.first_hit(above, Vector3::z()).is_none());
            }
        }
        assert!(fans.iter().all(|&count| count > 0), "{fans:?}");
        // The rays are in the plane of a face, and one of them runs along an edge.
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
    fn invalid_rays_hit_nothing() {
        let one = triangles(vec![
            Point3::new(-1.0, -1.0, 0.0),
            Point3::new(1.0, -1.0, 0.0),
            Point3::new(0.0, 1.0, 0.0),
        ]);
        let tree = TriangleTree::new(&one);
        fn hit(origin: [f64; 3], to: [f64; 3], tree: &TriangleTree) -> Option<RayHit> {
            tree.first_hit(origin.into(), to.into())
        }
        // The rays come from both sides, with directions of any length.
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
