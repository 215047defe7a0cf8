//! Planes with an upper and a lower side.

use maquette_node::{Error, bail};
use maquette_value::Mesh;
use nalgebra::{Matrix3, Point3, SymmetricEigen, Unit, Vector3};

/// The maximum deviation of a flat mesh from its plane, as a fraction of the mesh's size. The deviation is the root mean square distance of
/// the corners from the plane, the size that from the centroid.
const MAX_RELATIVE_DEVIATION: f64 = 0.1;

/// A plane with an upper and a lower side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// The unit normal. It points to the upper side.
    pub normal: Unit<Vector3<f64>>,
    /// The signed distance of the plane from the origin along the normal, in mm.
    pub offset: f64,
}

impl Plane {
    /// Returns the plane through a point; `None` if the normal is zero.
    pub fn from_point_and_normal(point: Point3<f64>, normal: Vector3<f64>) -> Option<Self> {
        let normal = Unit::try_new(normal, 1e-300)?;
        let offset = normal.dot(&point.coords);
        offset.is_finite().then_some(Self { normal, offset })
    }

    /// The signed height of a point above the plane, in mm.
    pub fn height(&self, point: &Point3<f64>) -> f64 {
        self.normal.dot(&point.coords) - self.offset
    }

    /// Returns the same plane with its upper and lower side exchanged.
    #[must_use]
    pub fn flip(&self) -> Self {
        Self { normal: -self.normal, offset: -self.offset }
    }

    /// Returns the plane of a flat mesh. It contains the centroid of the corners, and its normal has the direction of the sum of the faces'
    /// area vectors.
    ///
    /// # Errors
    /// If the sum of the area vectors is zero, or the mesh is not flat.
    pub fn from_mesh(mesh: &Mesh) -> Result<Self, Error> {
        let normal = mesh.faces().iter().map(|face| mesh.area_vector(face)).sum();
        let corners = mesh.faces().corners();
        let count = corners.len().max(1) as f64;
        let positions = corners.iter().map(|&vertex| mesh.positions()[vertex as usize]);
        let middle = positions.clone().map(|point| point.coords).sum::<Vector3<f64>>() / count;
        let middle = Point3::from(middle);
        let Some(plane) = Self::from_point_and_normal(middle, normal) else {
            bail!("the mesh at the port `plane` has no area, so it has no plane");
        };
        let heights_sq = positions.clone().map(|point| plane.height(&point) * plane.height(&point));
        let off = (heights_sq.sum::<f64>() / count).sqrt();
        let distances_sq = positions.map(|point| (point - middle).norm_squared());
        let size = (distances_sq.sum::<f64>() / count).sqrt();
        if MAX_RELATIVE_DEVIATION * size < off {
            bail!(
                "the mesh at the port `plane` is not flat: its corners are {off:.3} mm from their plane and {size:.3} mm from their center (root mean square); connect a flat mesh, such as `plane` of `DominantPlane`"
            );
        }
        Ok(plane)
    }

    /// Returns the least-squares plane of some points. It contains their mean, and its normal is the direction of least variance. Returns
    /// `None` for fewer than three points or for points on a line.
    ///
    /// Pearson, "On lines and planes of closest fit to systems of points in space" (1901).
    pub fn fit(points: &[Point3<f64>]) -> Option<Self> {
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
        let [_, middle, max] = order.map(|axis| spread.eigenvalues[axis]);
        if middle <= 1e-12 * max {
            return None;
        }
        Self::from_point_and_normal(mean.into(), spread.eigenvectors.column(order[0]).into_owned())
    }

    /// Returns two unit vectors in the plane. Together with the normal they form a right-handed system.
    pub fn axes(&self) -> [Vector3<f64>; 2] {
        // Start with the coordinate axis that has the largest angle with the normal.
        let smallest = self.normal.iamin();
        let along = Vector3::ith(smallest, 1.0);
        let first = (along - *self.normal * self.normal.dot(&along)).normalize();
        [first, self.normal.cross(&first)]
    }
}
