//! Computes a rigid motion from pairs of points.

use maquette_node::{Error, bail};
use nalgebra::{Isometry3, Matrix3, Matrix4, Point3, Quaternion, SymmetricEigen, UnitQuaternion};

/// Computes the rigid motion that moves the first point of each pair as close as possible to the second: it minimizes the sum of the
/// squared distances.
///
/// Horn, "Closed-form solution of absolute orientation using unit quaternions" (1987), section 4.A. The result is always a rotation, never
/// a reflection.
pub(super) fn fit_motion(pairs: &[[Point3<f64>; 2]]) -> Isometry3<f64> {
    let count = pairs.len().max(1) as f64;
    fn mean(side: usize, count: f64, pairs: &[[Point3<f64>; 2]]) -> nalgebra::Vector3<f64> {
        pairs.iter().map(|pair| pair[side].coords / count).sum::<nalgebra::Vector3<f64>>()
    }
    let (from, to) = (mean(0, count, pairs), mean(1, count, pairs));
    let s = pairs
        .iter()
        .map(|pair| (pair[0].coords - from) * (pair[1].coords - to).transpose())
        .sum::<Matrix3<f64>>();
    let [x, y, z] = [s[(1, 2)] - s[(2, 1)], s[(2, 0)] - s[(0, 2)], s[(0, 1)] - s[(1, 0)]];
    let [xy, zx, yz] = [s[(0, 1)] + s[(1, 0)], s[(2, 0)] + s[(0, 2)], s[(1, 2)] + s[(2, 1)]];
    let [a, b, c] = [s[(0, 0)], s[(1, 1)], s[(2, 2)]];
    #[rustfmt::skip]
    let n = Matrix4::new(
        a + b + c, x, y, z,
        x, a - b - c, xy, zx,
        y, xy, b - a - c, yz,
        z, zx, yz, c - a - b,
    );
    let eigen = SymmetricEigen::new(n);
    let q = eigen.eigenvectors.column(eigen.eigenvalues.imax());
    let turn = UnitQuaternion::new_normalize(Quaternion::new(q[0], q[1], q[2], q[3]));
    Isometry3::from_parts((to - turn * from).into(), turn)
}

/// The maximum root mean square distance of the pairs after the motion, as a fraction of the spread of the points. Points picked by hand
/// are more accurate than this.
const MAX_RELATIVE_ERROR: f64 = 0.1;

/// Computes the motion from pairs that the user has picked. Also returns the root mean square distance of the pairs after the motion, in
/// mm.
///
/// # Errors
/// If there are fewer than three pairs, a coordinate is not finite, the points are on a line, or the pairs contradict each other.
pub(super) fn fit_picked_pairs(pairs: &[[Point3<f64>; 2]]) -> Result<(Isometry3<f64>, f64), Error> {
    if pairs.len() < 3 {
        bail!("expected at least 3 pairs of points, found {}", pairs.len());
    }
    let mut min_spread = f64::INFINITY;
    for side in 0..2 {
        let mean = pairs.iter().map(|pair| pair[side].coords).sum::<nalgebra::Vector3<f64>>()
            / pairs.len() as f64;
        let spread = pairs
            .iter()
            .map(|pair| {
                let off = pair[side].coords - mean;
                off * off.transpose() / pairs.len() as f64
            })
            .sum::<Matrix3<f64>>();
        if let Some(value) = spread.iter().find(|x| !x.is_finite()) {
            bail!("`pairs` is {value}, expected coordinates of moderate size");
        }
        let mut along = SymmetricEigen::new(spread).eigenvalues;
        along.as_mut_slice().sort_by(f64::total_cmp);
        min_spread = min_spread.min(spread.trace().sqrt());
        // Both values are squared lengths, so the limit is a millionth of the length.
        if along[1] <= 1e-12 * along[2] {
            let [off, along] = [along[1], along[2]].map(|square| square.max(0.0).sqrt());
            bail!(
                "the points of the pairs are on a line: their standard deviation is {off:.3e} mm across and {along:.3e} mm along it; add a pair beside the line"
            );
        }
    }
    let motion = fit_motion(pairs);
    let apart: Vec<_> = pairs.iter().map(|[from, onto]| (motion * from - onto).norm()).collect();
    let off = (apart.iter().map(|off| off * off).sum::<f64>() / pairs.len() as f64).sqrt();
    if MAX_RELATIVE_ERROR * min_spread < off {
        let worst = (0..apart.len()).max_by(|&a, &b| apart[a].total_cmp(&apart[b])).unwrap_or(0);
        let (most, worst) = (apart[worst], worst + 1);
        bail!(
            "the pairs contradict each other: after the best motion their distance is {off:.3} mm (root mean square) for points that spread over {min_spread:.3} mm, and pair {worst} is {most:.3} mm apart; check its points, the units of both scans, and that neither is mirrored"
        );
    }
    Ok((motion, off))
}
