//! Planes with an upper side.

use maquette_value::Mesh;
use nalgebra::{Matrix3, Point3, SymmetricEigen, Unit, Vector3};

use super::keep_error::KeepError;

/// A flat mesh is off its plane by no more than this share of its size.
const MOST_BENT: f64 = 0.1;

/// A plane with an upper side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Towards its upper side.
    pub normal: Unit<Vector3<f64>>,
    /// How far above the origin it is, in mm.
    pub offset: f64,
}

impl Plane {
    /// The plane through a point; none if the normal has no direction.
    pub fn through(point: Point3<f64>, normal: Vector3<f64>) -> Option<Self> {
        let normal = Unit::try_new(normal, 1e-300)?;
        let offset = normal.dot(&point.coords);
        offset.is_finite().then_some(Self { normal, offset })
    }

    /// How far above the plane a point is, in mm.
    pub fn height(&self, point: &Point3<f64>) -> f64 {
        self.normal.dot(&point.coords) - self.offset
    }

    /// The same plane with its sides exchanged.
    #[must_use]
    pub fn turned(&self) -> Self {
        Self { normal: -self.normal, offset: -self.offset }
    }

    /// The plane on which a flat mesh lies, its upper side where the faces look: through the middle of the corners, by the sum of the
    /// faces' area vectors.
    ///
    /// # Errors
    /// If the faces have no area together, or the mesh is not flat.
    pub fn of_mesh(mesh: &Mesh) -> Result<Self, KeepError> {
        let normal = mesh.faces().iter().map(|face| mesh.area_vector(face)).sum();
        let corners = mesh.faces().corners();
        let count = corners.len().max(1) as f64;
        fn at(&vertex: &u32, mesh: &Mesh) -> Point3<f64> {
            mesh.positions()[vertex as usize]
        }
        let middle = corners.iter().map(|it| at(it, mesh).coords).sum::<Vector3<f64>>() / count;
        let middle = Point3::from(middle);
        let plane = Self::through(middle, normal).ok_or(KeepError::NoPlane)?;
        fn mean(
            square: &dyn Fn(Point3<f64>) -> f64,
            count: f64,
            corners: &maquette_value::Column<u32>,
            mesh: &Mesh,
        ) -> f64 {
            (corners.iter().map(|it| square(at(it, mesh))).sum::<f64>() / count).sqrt()
        }
        let off = mean(&|at| plane.height(&at) * plane.height(&at), count, corners, mesh);
        let size = mean(&|at| (at - middle).norm_squared(), count, corners, mesh);
        if MOST_BENT * size < off {
            return Err(KeepError::NotFlat { off, size });
        }
        Ok(plane)
    }

    /// The plane that is nearest to some points by the squares of their distances: through their mean, across the axis along which they
    /// spread least. None of fewer than three points, or if they lie on a line.
    ///
    /// Pearson, "On lines and planes of closest fit to systems of points in space" (1901).
    pub fn nearest(points: &[Point3<f64>]) -> Option<Self> {
        if points.len() < 3 {
            return None;
        }
        let mean = points.iter().map(|point| point.coords).sum::<Vector3<f64>>();
        let mean = mean / points.len() as f64;
        let spread = points.iter().map(|point| {
            let from_mean = point.coords - mean;
            from_mean * from_mean.transpose()
        });
        let spread = SymmetricEigen::new(spread.sum::<Matrix3<f64>>());
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| spread.eigenvalues[a].total_cmp(&spread.eigenvalues[b]));
        let [_, middle, most] = order.map(|axis| spread.eigenvalues[axis]);
        if middle <= 1e-12 * most {
            return None;
        }
        Self::through(mean.into(), spread.eigenvectors.column(order[0]).into_owned())
    }

    /// Two directions on the plane that make a right-handed system with its normal.
    pub fn axes(&self) -> [Vector3<f64>; 2] {
        // The axis that is least along the normal.
        let least = self.normal.iamin();
        let along = Vector3::ith(least, 1.0);
        let first = (along - *self.normal * self.normal.dot(&along)).normalize();
        [first, self.normal.cross(&first)]
    }
}
