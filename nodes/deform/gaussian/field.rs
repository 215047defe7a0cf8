//! A deformation on all points of an object: where they go, how their normals turn, where space is turned inside out.

use std::ops::Range;

use maquette_node::{Cancelled, Progress};
use maquette_value::memory::huge_vec;
use maquette_value::parallel::*;
use nalgebra::{Matrix3, Point3, Vector3};

/// Where the points from a first one on go, and the derivatives there if they are wanted.
pub(crate) type Evaluate<'a> =
    dyn Fn(usize, &[Point3<f64>], &mut [Point3<f64>], Option<&mut [Matrix3<f64>]>) + Sync + 'a;

/// What is wanted beside the positions.
#[derive(Clone, Copy, Default)]
pub(crate) struct Wanted<'a> {
    /// Normals at the points, to be turned.
    pub(crate) normals: Option<&'a [[f64; 3]]>,
    /// Where the deformation folds over.
    pub(crate) folds: bool,
    /// All derivatives.
    pub(crate) jacobians: bool,
}

/// The deformed points; what was not wanted is empty.
#[derive(Default)]
pub(crate) struct Field {
    /// Which points they are, if not all; the others stay.
    pub(crate) rows: Option<Vec<Range<u32>>>,
    pub(crate) positions: Vec<Point3<f64>>,
    pub(crate) normals: Vec<[f64; 3]>,
    /// 1 where the determinant of the derivatives is not greater than 0.
    pub(crate) folded: Vec<u8>,
    /// The least determinant; infinite without points.
    pub(crate) least: f64,
    pub(crate) jacobians: Vec<Matrix3<f64>>,
}

/// Points that one task moves where nothing else is asked for: some 0.1 ms of work at least.
pub(crate) const CHUNK: usize = 8192;

/// The field of a deformation on `points`, `chunk` of which are given to `evaluate` at once.
///
/// # Errors
/// If the evaluation is told to stop.
pub(crate) fn field(
    points: &[Point3<f64>],
    chunk: usize,
    wanted: Wanted<'_>,
    evaluate: &Evaluate<'_>,
    progress: &Progress<'_>,
) -> Result<Field, Cancelled> {
    fn count(wanted: bool, points: &[Point3<f64>]) -> usize {
        if wanted { points.len() } else { 0 }
    }
    let mut field = Field {
        rows: None,
        positions: huge_vec(points.len()),
        normals: huge_vec(count(wanted.normals.is_some(), points)),
        folded: huge_vec(count(wanted.folds, points)),
        least: f64::INFINITY,
        jacobians: huge_vec(count(wanted.jacobians, points)),
    };
    let with_derivatives = wanted.folds || wanted.jacobians || wanted.normals.is_some();
    let n_chunks = points.len().div_ceil(chunk);
    let least: Result<Vec<f64>, Cancelled> = points
        .par_chunks(chunk)
        .zip(field.positions.par_chunks_mut(chunk))
        .zip(parts(&mut field.normals, chunk, n_chunks))
        .zip(parts(&mut field.folded, chunk, n_chunks))
        .zip(parts(&mut field.jacobians, chunk, n_chunks))
        .enumerate()
        // Fresh memory for each chunk would cost more than the work on it.
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
            if let Some((normals, given)) = normals.zip(wanted.normals) {
                let given = &given[first..][..normals.len()];
                let pairs = given.iter().zip(&*derivatives);
                for (normal, (given, derivative)) in normals.iter_mut().zip(pairs) {
                    *normal = turned(derivative, given);
                }
            }
            let mut least = f64::INFINITY;
            for (flag, derivative) in folded.into_iter().flatten().zip(derivatives) {
                let determinant = derivative.determinant();
                *flag = u8::from(determinant <= 0.0);
                least = least.min(determinant);
            }
            Ok(least)
        })
        .collect();
    field.least = least?.into_iter().fold(f64::INFINITY, f64::min);
    Ok(field)
}

impl Field {
    /// The same with all points, and their normals if these were wanted.
    pub(crate) fn of_all(self, points: &[Point3<f64>], normals: Option<&[[f64; 3]]>) -> Self {
        let rows = self.rows.as_deref();
        Self {
            positions: spread(rows, self.positions, || points.to_vec()),
            normals: spread(rows, self.normals, || normals.unwrap_or_default().to_vec()),
            folded: spread(rows, self.folded, || vec![0; points.len()]),
            rows: None,
            ..self
        }
    }
}

/// The items of all points, of which those in the rows become these, one row after the other.
pub(crate) fn spread<T: Copy>(
    rows: Option<&[Range<u32>]>,
    items: Vec<T>,
    all: impl FnOnce() -> Vec<T>,
) -> Vec<T> {
    let Some(rows) = rows else { return items };
    let (mut all, mut rest) = (all(), &items[..]);
    for row in rows {
        let (items, behind) = rest.split_at(row.len().min(rest.len()));
        all[row.start as usize..][..items.len()].copy_from_slice(items);
        rest = behind;
    }
    all
}

/// The chunks of a list; nothing for each chunk of one that is not wanted.
fn parts<T>(list: &mut [T], chunk: usize, n_chunks: usize) -> Vec<Option<&mut [T]>> {
    let mut parts: Vec<_> = list.chunks_mut(chunk).map(Some).collect();
    parts.resize_with(n_chunks, || None);
    parts
}

/// A unit normal behind the deformation: what is tangential moves by the derivatives, what is normal to it by their cofactors.
/// Zero where these vanish.
pub(crate) fn turned(derivative: &Matrix3<f64>, normal: &[f64; 3]) -> [f64; 3] {
    let [x, y, z] = [0, 1, 2].map(|row| derivative.row(row).transpose());
    let normal = Vector3::from(*normal);
    let turned =
        Vector3::new(y.cross(&z).dot(&normal), z.cross(&x).dot(&normal), x.cross(&y).dot(&normal));
    turned.try_normalize(0.0).unwrap_or_default().into()
}
