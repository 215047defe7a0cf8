//! The curvature at borders, where neighbors are on one side only.

use maquette_base::topology::flat_faces::FlatFaces;
use maquette_value::Mesh;
use maquette_value::parallel::*;
use nalgebra::{Cholesky, Const, Point3, SMatrix, SVector, Vector3};

use super::bending::Bending;
use super::discrete::{MIN_POINTS, Neighbors, normals};

/// Minimum number of points for fitting a cubic surface, which has 9 coefficients.
const MIN_CUBIC_POINTS: usize = 14;

/// Maximum difference of the principal curvatures of the two fitted surfaces, as a fraction of the larger principal curvature.
const MAX_DIFFERENCE: f64 = 0.15;

/// Maximum standard error of the curvature of the cubic surface, as a fraction of the larger principal curvature.
const MAX_ERROR: f64 = 0.1;

/// Surfaces that bend by less than this angle, in radians, over the neighborhood count as flat: fractions of this curvature are allowed.
const FLAT: f64 = 0.3;

/// Decrease of the weights of points with their squared distance, in sizes of the neighborhood, when a cubic surface is fitted.
const DECREASE: f64 = 2.0;

/// Returns the curvature at the marked vertices of a mesh, in their order; `None` where the vertices nearby do not determine it to about
/// 15 %.
///
/// A quadratic surface takes the cubic part of a surface for curvature if all points are on one side; a cubic surface is spoiled by noise
/// and by coarse faces. Where both agree, the result is their mean, with twice the weight for the cubic surface.
pub(super) fn fit_borders(
    mesh: &Mesh,
    flat: &FlatFaces,
    is_at_border: &[bool],
) -> Vec<Option<Bending>> {
    let neighbors = Neighbors::of_independent(&mesh.edges(), mesh.positions().len(), flat);
    let normals = normals(mesh, flat);
    let vertices: Vec<u32> = (0..mesh.positions().len() as u32)
        .filter(|&vertex| is_at_border[vertex as usize])
        .collect();
    vertices
        .par_iter()
        .with_min_len(64)
        .map(|&vertex: &u32| {
            let (middle, normal) = (mesh.positions()[vertex as usize], normals[vertex as usize]);
            let near = neighbors.positions_around(mesh, vertex, MIN_POINTS);
            let quadratic = Bending::of_points(middle, normal, &near)?;
            let wide = neighbors.positions_around(mesh, vertex, MIN_CUBIC_POINTS);
            let first = CubicFit::new(middle, normal, &wide)?;
            let cubic = CubicFit::new(middle, first.normal, &wide)?;
            let size = near.iter().map(|point| (point - middle).norm()).fold(0.0, f64::max);
            blend(&quadratic, &cubic, FLAT / size)
        })
        .collect()
}

/// Returns the mean of two estimates of a curvature; `None` if they differ. Differences are relative to the largest principal curvature, or
/// to `least`, in 1/mm.
fn blend(quadratic: &Bending, cubic: &CubicFit, least: f64) -> Option<Bending> {
    let all = quadratic.principal.into_iter().chain(cubic.bending.principal);
    let largest = all.fold(least, |largest, curvature| largest.max(curvature.abs()));
    let [first, second] =
        [0, 1].map(|k| (quadratic.principal[k] - cubic.bending.principal[k]).abs());
    let is_sure =
        first.max(second) <= MAX_DIFFERENCE * largest && cubic.error <= MAX_ERROR * largest;
    let [k1, k2] =
        [0, 1].map(|k| (quadratic.principal[k] + 2.0 * cubic.bending.principal[k]) / 3.0);
    is_sure.then(|| Bending {
        gaussian: k1 * k2,
        mean: (k1 + k2) / 2.0,
        principal: [k1, k2],
        ..cubic.bending
    })
}

/// The curvature of a cubic surface through a point, fitted to points around it.
struct CubicFit {
    bending: Bending,
    /// The standard error of the curvature, in 1/mm.
    error: f64,
    normal: Vector3<f64>,
}

impl CubicFit {
    /// Fits a cubic height field over the plane perpendicular to `normal` by weighted least squares. `None` if the points do not determine
    /// it.
    fn new(middle: Point3<f64>, normal: Vector3<f64>, around: &[Point3<f64>]) -> Option<Self> {
        let normal = normal.try_normalize(0.0)?;
        let first = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).try_normalize(0.0)?;
        let second = normal.cross(&first);
        let size = around.iter().map(|point| (point - middle).norm()).fold(0.0, f64::max);
        let freedom = around.len().checked_sub(9).filter(|&freedom| freedom > 0 && size > 0.0)?;
        // The terms of a point, its height, and its weight.
        let rows: Vec<(SVector<f64, 9>, f64, f64)> = around
            .iter()
            .map(|point| {
                let to = (point - middle) / size;
                let [x, y] = [to.dot(&first), to.dot(&second)];
                let terms = [x * x, x * y, y * y, x, y, x * x * x, x * x * y, x * y * y, y * y * y];
                (terms.into(), to.dot(&normal), libm::exp(-DECREASE * to.norm_squared()))
            })
            .collect();
        let (mut matrix, mut right) = (SMatrix::<f64, 9, 9>::zeros(), SVector::<f64, 9>::zeros());
        for (terms, height, weight) in &rows {
            matrix += terms * terms.transpose() * *weight;
            right += terms * (height * weight);
        }
        let inverse = Cholesky::<f64, Const<9>>::new(matrix)?.inverse();
        // The product of the traces is at least the ratio of the largest and the smallest eigenvalue.
        if inverse.trace() * matrix.trace() > 1e9 {
            return None;
        }
        let fit = inverse * right;
        let squares = rows.iter().map(|(terms, height, weight)| {
            let off = terms.dot(&fit) - height;
            off * off * weight
        });
        let variance = squares.sum::<f64>() / freedom as f64;
        // The second derivatives are twice the coefficients of the squares, and once that of the product.
        let errors = [4.0 * inverse[(0, 0)], inverse[(1, 1)], 4.0 * inverse[(2, 2)]];
        let error = (variance * errors.into_iter().fold(0.0, f64::max)).sqrt() / size;
        let tangents = [first + normal * fit[3], second + normal * fit[4]];
        let seconds = [2.0 * fit[0], fit[1], 2.0 * fit[2]].map(|bend| normal * (bend / size));
        let bending = Bending::of_derivatives(tangents, seconds)?;
        Some(Self { bending, error, normal: tangents[0].cross(&tangents[1]) })
    }
}
