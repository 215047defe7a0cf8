//! Projection of points into the picture of a camera.

use maquette_value::{Mesh, Pinhole};
use nalgebra::{Matrix3, Matrix3x4, Matrix4, Point3, SMatrix, SVector, Vector2, Vector3, Vector4};

use super::super::atlas::corner_uv;

/// A camera, given by its projection matrix `P`: the camera sees a point `x` at the pixel `P (x, 1)`, in homogeneous coordinates whose
/// third component is the depth.
pub(super) struct Camera {
    matrix: Matrix3x4<f64>,
    /// The center of the camera in homogeneous coordinates, whose last component is 0 for a camera at infinity.
    center: Vector4<f64>,
}

/// Maximum root mean square reprojection error, in pixels, of a camera that is computed from texture coordinates.
const MAX_REPROJECTION_ERROR: f64 = 2.0;

/// Maximum number of vertices used to find a camera.
const MAX_VERTICES: usize = 3000;

/// Minimum ratio of the second smallest to the largest eigenvalue of the equations for the camera. If the ratio is smaller, the camera is
/// not unique.
const MIN_EIGENVALUE: f64 = 1e-11;

impl Camera {
    /// Returns the pinhole camera of a capture that was moved by `motion`; `None` if the motion is not invertible.
    pub(super) fn from_pinhole(pinhole: &Pinhole, motion: &Matrix4<f64>) -> Option<Self> {
        let Pinhole { focal, center } = pinhole;
        let own = Matrix3::new(focal[0], 0.0, center[0], 0.0, focal[1], center[1], 0.0, 0.0, 1.0);
        let back = motion.try_inverse()?;
        Some(Self::from_matrix(own * back.fixed_rows::<3>(0)))
    }

    /// Returns the camera that sees each vertex at its texture coordinates in the picture of `size` pixels.
    ///
    /// The direct linear transformation: Abdel-Aziz and Karara, "Direct linear transformation from comparator coordinates into object space
    /// coordinates in close-range photogrammetry" (1971). Points and pixels are normalized first, which is necessary according to Hartley,
    /// "In defense of the eight-point algorithm" (1997).
    ///
    /// # Errors
    /// Returns the reason as an error if the vertices do not determine the camera.
    pub(super) fn from_texture_coordinates(mesh: &Mesh, size: [usize; 2]) -> Result<Self, String> {
        let uv = corner_uv(mesh).ok_or("there are none")?;
        let corners = mesh.faces().corners();
        let step = corners.len().div_ceil(MAX_VERTICES).max(1);
        let size = size.map(|size| size as f64);
        let pairs = (0..corners.len()).step_by(step).map(|corner| {
            let [u, v] = uv[corner];
            let pixel = Vector2::new(u * size[0] - 0.5, (1.0 - v) * size[1] - 0.5);
            (mesh.positions()[corners[corner] as usize].coords, pixel)
        });
        let pairs = Vec::from_iter(pairs);
        let count = pairs.len() as f64;
        let place = pairs.iter().map(|it| it.0).sum::<Vector3<f64>>() / count;
        let pixel = pairs.iter().map(|it| it.1).sum::<Vector2<f64>>() / count;
        let far =
            (pairs.iter().map(|it| (it.0 - place).norm_squared()).sum::<f64>() / count).sqrt();
        let wide =
            (pairs.iter().map(|it| (it.1 - pixel).norm_squared()).sum::<f64>() / count).sqrt();
        if !(0.0 < far && 0.0 < wide && (far + wide).is_finite()) {
            return Err("all vertices are in one place".into());
        }
        let mut squares = SMatrix::<f64, 12, 12>::zeros();
        for (at, seen) in &pairs {
            let (at, seen) = ((at - place) / far, (seen - pixel) / wide);
            for axis in 0..2 {
                let mut row = SVector::<f64, 12>::zeros();
                row.fixed_rows_mut::<4>(4 * axis).copy_from(&at.push(1.0));
                row.fixed_rows_mut::<4>(8).copy_from(&(at.push(1.0) * -seen[axis]));
                squares += row * row.transpose();
            }
        }
        let eigen = squares
            .try_symmetric_eigen(f64::EPSILON, 10_000)
            .ok_or("their equations have no solution")?;
        let mut order: Vec<_> = (0..12).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        if eigen.eigenvalues[order[1]] < MIN_EIGENVALUE * eigen.eigenvalues[order[11]] {
            return Err("all vertices lie in a plane".into());
        }
        let best = eigen.eigenvectors.column(order[0]).into_owned();
        let own = Matrix3x4::from_row_slice(best.as_slice());
        let to_pixels = Matrix3::new(wide, 0.0, pixel.x, 0.0, wide, pixel.y, 0.0, 0.0, 1.0);
        let from_places = Matrix4::new_scaling(1.0 / far) * Matrix4::new_translation(&-place);
        let camera = Self::from_matrix(to_pixels * own * from_places);
        let off = pairs.iter().map(|(at, seen)| match camera.pixel(Point3::from(*at)) {
            Some(pixel) => (Vector2::from(pixel) - seen).norm_squared(),
            None => f64::INFINITY,
        });
        let off = (off.sum::<f64>() / count).sqrt();
        match off <= MAX_REPROJECTION_ERROR {
            true => Ok(camera),
            false => {
                Err(format!("no camera sees them there: the best one is off by {off:.1} pixels"))
            }
        }
    }

    fn from_matrix(matrix: Matrix3x4<f64>) -> Self {
        // The components of the center are the null space of the matrix: determinants of the matrix without one of its columns.
        fn determinant_without(k: usize, matrix: &Matrix3x4<f64>) -> f64 {
            matrix.remove_column(k).determinant()
        }
        let center = Vector4::new(
            determinant_without(0, &matrix),
            -determinant_without(1, &matrix),
            determinant_without(2, &matrix),
            -determinant_without(3, &matrix),
        );
        Self { matrix, center: center / center.amax() }
    }

    /// Returns the pixel (column, row) at which the camera sees a point; `None` for a point in the camera's own plane.
    pub(super) fn pixel(&self, place: Point3<f64>) -> Option<[f64; 2]> {
        let [x, y, z] = (self.matrix * place.to_homogeneous()).into();
        let pixel = [x / z, y / z];
        pixel.iter().all(|x| x.is_finite()).then_some(pixel)
    }

    /// Returns a direction along the line from a point to the camera. For one camera, the direction points towards the camera at all
    /// points, or away from the camera at all points.
    pub(super) fn direction_to_camera(&self, place: Point3<f64>) -> Vector3<f64> {
        let direction = self.center.xyz() - place.coords * self.center.w;
        direction.try_normalize(0.0).unwrap_or_default()
    }
}
