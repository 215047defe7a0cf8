//! Evaluates a deformation at all points of an object: positions, normals and folds.

use std::ops::Range;

use maquette_node::{CancelledError, Progress};
use maquette_value::memory::huge_vec;
use maquette_value::parallel::*;
use nalgebra::{Matrix3, Point3, Vector3};

/// Computes the new positions of a chunk of points and, if requested, their derivatives. The first argument is the index of the first
/// point.
pub(crate) type Evaluate<'a> =
    dyn Fn(usize, &[Point3<f64>], &mut [Point3<f64>], Option<&mut [Matrix3<f64>]>) + Sync + 'a;

/// The results that are requested in addition to the positions.
#[derive(Clone, Copy, Default)]
pub(crate) struct FieldRequest<'a> {
    /// The original normals at the points; `Some` requests transformed normals.
    pub(crate) normals: Option<&'a [[f64; 3]]>,
    /// True to request the points at which space is folded over.
    pub(crate) folds: bool,
    /// True to request the derivatives at all points.
    pub(crate) jacobians: bool,
}

/// The deformed points. Results that were not requested are empty.
#[derive(Default)]
pub(crate) struct Field {
    /// The rows of points (ranges of indices) that the field contains; all other points keep their positions. `None` if it contains all
    /// points.
    pub(crate) rows: Option<Vec<Range<u32>>>,
    pub(crate) positions: Vec<Point3<f64>>,
    pub(crate) normals: Vec<[f64; 3]>,
    /// For each point, 1 if space is folded over at the point, that is, the determinant of the derivatives is not greater than 0.
    pub(crate) folded: Vec<u8>,
    /// The minimum determinant of the derivatives over all points; infinite if there are no points.
    pub(crate) min_determinant: f64,
    pub(crate) jacobians: Vec<Matrix3<f64>>,
}

/// The number of points that one task moves if only positions are requested: at least about 0.1 ms of work.
pub(crate) const CHUNK_SIZE: usize = 8192;

/// Evaluates a deformation at `points`; `evaluate` gets up to `chunk` points at once.
///
/// # Errors
/// Returns an error if the evaluation is cancelled.
pub(crate) fn evaluate_field(
    points: &[Point3<f64>],
    chunk: usize,
    request: FieldRequest<'_>,
    evaluate: &Evaluate<'_>,
    progress: &Progress<'_>,
) -> Result<Field, CancelledError> {
    fn count(request: bool, points: &[Point3<f64>]) -> usize {
        if request { points.len() } else { 0 }
    }
    let mut field = Field {
        rows: None,
        positions: huge_vec(points.len()),
        normals: huge_vec(count(request.normals.is_some(), points)),
        folded: huge_vec(count(request.folds, points)),
        min_determinant: f64::INFINITY,
        jacobians: huge_vec(count(request.jacobians, points)),
    };
    let with_derivatives = request.folds || request.jacobians || request.normals.is_some();
    let n_chunks = points.len().div_ceil(chunk);
    let min_determinant: Result<Vec<f64>, CancelledError> = points
        .par_chunks(chunk)
        .zip(field.positions.par_chunks_mut(chunk))
        .zip(optional_chunks(&mut field.normals, chunk, n_chunks))
        .zip(optional_chunks(&mut field.folded, chunk, n_chunks))
        .zip(optional_chunks(&mut field.jacobians, chunk, n_chunks))
        .enumerate()
        // Each task reuses one buffer, since allocating memory for each chunk would cost more than the computation.
        .map_init(Vec::new, |own, (index, ((((points, moved), normals), folded), jacobians))| {
            progress.check()?;
            let first = index * chunk;
            if !with_derivatives {
                evaluate(first, points, moved, None);
                return Ok(f64::INFINITY);
            }
            let derivatives = match jacobians {
                Some(jacobians) => jacobians,
                None => {
                    own.resize(points.len(), Matrix3::zeros());
                    &mut own[..]
                }
            };
            evaluate(first, points, moved, Some(derivatives));
            if let Some((normals, given)) = normals.zip(request.normals) {
                let given = &given[first..][..normals.len()];
                let pairs = given.iter().zip(&*derivatives);
                for (normal, (given, derivative)) in normals.iter_mut().zip(pairs) {
                    *normal = transform_normal(derivative, given);
                }
            }
            let mut min_determinant = f64::INFINITY;
            for (flag, derivative) in folded.into_iter().flatten().zip(derivatives) {
                let determinant = derivative.determinant();
                *flag = u8::from(determinant <= 0.0);
                min_determinant = min_determinant.min(determinant);
            }
            Ok(min_determinant)
        })
        .collect();
    field.min_determinant = min_determinant?.into_iter().fold(f64::INFINITY, f64::min);
    Ok(field)
}

impl Field {
    /// Expands the field from its rows to all points, and the transformed normals to all `normals` if there are any.
    pub(crate) fn expand(self, points: &[Point3<f64>], normals: Option<&[[f64; 3]]>) -> Self {
        let rows = self.rows.as_deref();
        Self {
            positions: scatter_rows(rows, self.positions, || points.to_vec()),
            normals: scatter_rows(rows, self.normals, || normals.unwrap_or_default().to_vec()),
            folded: scatter_rows(rows, self.folded, || vec![0; points.len()]),
            rows: None,
            ..self
        }
    }
}

/// Returns a copy of `all` in which the items in `rows` are replaced by `items`, one row after the other.
pub(crate) fn scatter_rows<T: Copy>(
    rows: Option<&[Range<u32>]>,
    items: Vec<T>,
    all: impl FnOnce() -> Vec<T>,
) -> Vec<T> {
    let Some(rows) = rows else { return items };
    let (mut all, mut rest) = (all(), &items[..]);
    for row in rows {
        let (items, rest_items) = rest.split_at(row.len().min(rest.len()));
        all[row.start as usize..][..items.len()].copy_from_slice(items);
        rest = rest_items;
    }
    all
}

/// Returns the chunks of a list as `Some`; for an empty list, `None` repeated `n_chunks` times.
fn optional_chunks<T>(list: &mut [T], chunk: usize, n_chunks: usize) -> Vec<Option<&mut [T]>> {
    let mut parts: Vec<_> = list.chunks_mut(chunk).map(Some).collect();
    parts.resize_with(n_chunks, || None);
    parts
}

/// Returns the unit normal of the deformed surface. Derivatives transform tangents, and their cofactors transform normals. Returns zero if
/// the transformed normal vanishes.
pub(crate) fn transform_normal(derivative: &Matrix3<f64>, normal: &[f64; 3]) -> [f64; 3] {
    let [x, y, z] = [0, 1, 2].map(|row| derivative.row(row).transpose());
    let normal = Vector3::from(*normal);
    let transformed =
        Vector3::new(y.cross(&z).dot(&normal), z.cross(&x).dot(&normal), x.cross(&y).dot(&normal));
    transformed.try_normalize(0.0).unwrap_or_default().into()
}
