//! What makes handles reach their targets: a linear system that depends on their layout alone.
//!
//! With `M_ji` the share that handle i has of the place of handle j, the coefficients solve `M V = T`, one column per axis.

use maquette_base::linear::lu::Lu;
use maquette_node::Error;
use maquette_value::Encoder;
use maquette_value::Memo;
use nalgebra::{Matrix3, Point3, Vector3};

use super::deformation::Affine;
use super::layout::Layout;
use crate::{FfdError, Mode};

/// The factored system of a layout.
///
/// In the affine form a polynomial `a_0 + sum_k a_k p_k(x)` stands beside the Gaussians, whose coefficients `c` then have no
/// constant and no linear part of their own:
///
/// ```text
/// M  P   c     D            with regularization:   l I   M    P    r / l     D
/// PT 0   a  =  0                                    MT   -l I  0    c      =  0
///                                                   PT    0    0    a         0
/// ```
///
/// The right system is the least-squares problem `|M c + P a - D|^2 + l^2 |c|^2` without squares of numbers: its condition
/// is that of the problem, not its square.
#[derive(Clone, Debug)]
pub(crate) struct System {
    lu: Lu,
    handles: usize,
    regularized: bool,
    pub(crate) polynomial: Polynomial,
}

/// The linear functions beside the Gaussians: 1, and `direction . (x - origin) / scale` for each direction.
#[derive(Clone, Debug, Default)]
pub(crate) struct Polynomial {
    pub(crate) origin: Point3<f64>,
    pub(crate) directions: Vec<Vector3<f64>>,
    pub(crate) scale: f64,
    /// How many functions there are: 0, or one more than directions.
    pub(crate) terms: usize,
}

/// What a right side of the system comes to.
#[derive(Clone, Debug)]
pub(crate) struct Solution {
    /// One per handle.
    pub(crate) coefficients: Vec<f64>,
    /// One per function of the polynomial.
    pub(crate) polynomial: Vec<f64>,
}

/// From this condition on a solution has no digits left that could be trusted.
const MOST_CONDITION: f64 = 1e12;

/// A direction in which all handles are within this share of their extent is none.
const FLAT: f64 = 1e-9;

impl System {
    /// Builds and factors the system.
    ///
    /// # Errors
    /// If it is singular.
    pub(crate) fn new(layout: &Layout) -> Result<Self, FfdError> {
        let n = layout.at.len();
        let polynomial = match layout.mode {
            Mode::Affine => Polynomial::through(&layout.at),
            Mode::Displacement | Mode::Absolute => Polynomial::default(),
        };
        let (lambda, regularized) = (layout.regularize, layout.regularize > 0.0);
        // Where the rows of r, c and a begin; the rows of the equations of M, MT and PT, too.
        let c = if regularized { n } else { 0 };
        let a = c + n;
        let size = a + polynomial.terms;
        let mut matrix = vec![0.0; size * size];
        let gaussians = layout.gaussians();
        for (row, &at) in layout.at.iter().enumerate() {
            for (column, share) in gaussians.shares(at).into_iter().enumerate() {
                matrix[row * size + c + column] = share;
                if regularized {
                    matrix[(c + column) * size + row] = share;
                }
            }
            for (term, value) in polynomial.at(at).into_iter().enumerate() {
                matrix[row * size + a + term] = value;
                matrix[(a + term) * size + row] = value;
            }
            if regularized {
                matrix[row * size + row] = lambda;
                matrix[(c + row) * size + c + row] = -lambda;
            }
        }
        let lu = Lu::new(size, matrix);
        let condition = lu.condition();
        let most = if regularized { f64::MAX } else { MOST_CONDITION };
        if condition > most {
            return Err(FfdError::Singular { condition });
        }
        Ok(Self { lu, handles: n, regularized, polynomial })
    }

    /// [`System::new`], to be remembered.
    pub(crate) fn memo(layout: &Layout) -> Result<Self, Error> {
        Ok(Self::new(layout)?)
    }

    /// The estimate of the condition in the 1-norm.
    pub(crate) fn condition(&self) -> f64 {
        self.lu.condition()
    }

    /// What takes each handle to its number in `right`.
    pub(crate) fn solve(&self, right: impl Iterator<Item = f64>) -> Solution {
        let mut all: Vec<f64> = right.collect();
        all.resize(self.lu_size(), 0.0);
        let solution = self.lu.solve(&all);
        let first = if self.regularized { self.handles } else { 0 };
        let (coefficients, polynomial) = solution[first..].split_at(self.handles);
        Solution { coefficients: coefficients.to_vec(), polynomial: polynomial.to_vec() }
    }

    fn lu_size(&self) -> usize {
        let per_handle = if self.regularized { 2 } else { 1 };
        self.handles * per_handle + self.polynomial.terms
    }
}

impl Polynomial {
    /// As many linear functions as the places tell apart: directions are taken one after the other to the place that is
    /// farthest from all that the ones before span.
    fn through(places: &[Point3<f64>]) -> Self {
        let count = places.len() as f64;
        let mean = places.iter().map(|place| place.coords / count).sum::<Vector3<f64>>();
        let mut rest: Vec<Vector3<f64>> = places.iter().map(|place| place.coords - mean).collect();
        let (mut directions, mut scale) = (Vec::new(), 0.0);
        for _ in 0..3 {
            let longest = rest.iter().fold(Vector3::zeros(), |best: Vector3<f64>, rest| {
                if rest.norm_squared() > best.norm_squared() { *rest } else { best }
            });
            let length = longest.norm();
            if directions.is_empty() {
                scale = length;
            }
            if length.is_nan() || length <= FLAT * scale {
                break;
            }
            let direction = longest / length;
            rest.iter_mut().for_each(|rest| *rest -= direction * direction.dot(rest));
            directions.push(direction);
        }
        Self { origin: mean.into(), terms: 1 + directions.len(), directions, scale }
    }

    /// The functions' values at a place.
    pub(crate) fn at(&self, place: Point3<f64>) -> Vec<f64> {
        if self.terms == 0 {
            return Vec::new();
        }
        let linear = self.directions.iter().map(|d| d.dot(&(place - self.origin)) / self.scale);
        std::iter::once(1.0).chain(linear).collect()
    }

    /// The affine map of three combinations of the functions, one per axis; none without functions.
    pub(crate) fn combine(&self, axes: [&[f64]; 3]) -> Option<Affine> {
        (self.terms > 0).then(|| Affine {
            origin: self.origin.coords,
            shift: Vector3::from(axes.map(|terms| terms[0])),
            linear: Matrix3::from_columns(&axes.map(|terms| -> Vector3<f64> {
                let linear = self.directions.iter().zip(&terms[1..]);
                linear.map(|(direction, term)| direction * (term / self.scale)).sum()
            }))
            .transpose(),
        })
    }
}

/// Remembered for the next targets of the same handles.
impl Memo for System {
    const NAME: &'static str = "HandleSystem";

    fn encode(&self, to: &mut Encoder) {
        to.memo(&self.lu).counts(&[self.handles, self.polynomial.terms]);
        to.plain(&u8::from(self.regularized));
    }

    fn size(&self) -> usize {
        self.lu.size()
    }
}
