//! The linear system that makes handles reach their targets. Its matrix depends on the handles' positions, deviations and weights only.
//!
//! With `M_ji` the weight of handle i at the position of handle j, the coefficients `V` solve `M V = T` for the targets `T`, one column per
//! axis.

use maquette_base::linear::lu::Lu;
use maquette_node::{Error, bail};
use maquette_value::Encoder;
use maquette_value::Memo;
use nalgebra::{Matrix3, Point3, Vector3};

use super::deformation::Affine;
use super::layout::Layout;
use crate::Mode;

/// The factored linear system for the coefficients of the handles.
///
/// The affine form adds a polynomial `a_0 + sum_k a_k p_k(x)` to the Gaussians. The coefficients `c` of the Gaussians then have no constant
/// and no linear part. `M` are the weights, `D` the displacements of the handles, `P` the values of the polynomial's functions at the
/// handles, `PT` and `MT` are transposed matrices, `r` are the residuals, and `l` is the regularization:
///
/// ```text
/// M  P   c     D            with regularization:   l I   M    P    r / l     D
/// PT 0   a  =  0                                    MT   -l I  0    c      =  0
///                                                   PT    0    0    a         0
/// ```
///
/// The system on the right solves the least-squares problem `|M c + P a - D|^2 + l^2 |c|^2`. It does not square the matrix, as the normal
/// equations do, so its condition number is that of the problem and not the square.
#[derive(Clone, Debug)]
pub(crate) struct System {
    lu: Lu,
    handles: usize,
    regularized: bool,
    pub(crate) polynomial: Polynomial,
}

/// The linear functions of the affine form: 1, and `direction . (x - origin) / scale` for each direction.
#[derive(Clone, Debug, Default)]
pub(crate) struct Polynomial {
    pub(crate) origin: Point3<f64>,
    pub(crate) directions: Vec<Vector3<f64>>,
    pub(crate) scale: f64,
    /// The number of functions, including the constant 1: 0 if there is no polynomial, otherwise one more than the number of directions.
    pub(crate) terms: usize,
}

/// The solution of the linear system for one right side.
#[derive(Clone, Debug)]
pub(crate) struct Solution {
    /// The coefficients of the Gaussians, one per handle.
    pub(crate) coefficients: Vec<f64>,
    /// One coefficient per function of the polynomial.
    pub(crate) polynomial: Vec<f64>,
}

/// Condition number of the linear system above which no digit of a solution is reliable.
const MAX_CONDITION: f64 = 1e12;

/// Minimum extent of the handles along a direction of the polynomial, divided by their whole extent; directions with less are omitted.
const FLAT_RATIO: f64 = 1e-9;

impl System {
    /// Builds and factors the system.
    ///
    /// # Errors
    /// Returns an error if the system is singular.
    pub(crate) fn new(layout: &Layout) -> Result<Self, Error> {
        let n = layout.positions.len();
        let polynomial = match layout.mode {
            Mode::Affine => Polynomial::from_points(&layout.positions),
            Mode::Displacement | Mode::Absolute => Polynomial::default(),
        };
        let (lambda, regularized) = (layout.regularize, layout.regularize > 0.0);
        // The indices of the first rows of r, c and a in the documented system. The equations with M, MT and PT begin at the same indices.
        let c = if regularized { n } else { 0 };
        let a = c + n;
        let size = a + polynomial.terms;
        let mut matrix = vec![0.0; size * size];
        let gaussians = layout.gaussians();
        for (row, &at) in layout.positions.iter().enumerate() {
            for (column, weight) in gaussians.weights(at).into_iter().enumerate() {
                matrix[row * size + c + column] = weight;
                if regularized {
                    matrix[(c + column) * size + row] = weight;
                }
            }
            for (term, value) in polynomial.values(at).into_iter().enumerate() {
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
        let max_condition = if regularized { f64::MAX } else { MAX_CONDITION };
        if condition > max_condition {
            bail!(
                "the handles cannot all reach their targets: the condition number is {condition:.1e}; use smaller deviations, fewer \
                 handles or `regularize`"
            );
        }
        Ok(Self { lu, handles: n, regularized, polynomial })
    }

    /// Like [`System::new`], with the signature that the cache expects.
    pub(crate) fn memo(layout: &Layout) -> Result<Self, Error> {
        Self::new(layout)
    }

    /// Returns the estimated condition number in the 1-norm.
    pub(crate) fn condition(&self) -> f64 {
        self.lu.condition()
    }

    /// Solves the system for the right side `right`, which has one number per handle.
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
    /// Returns as many linear functions as the positions can distinguish: fewer than three directions if the positions are coplanar. Each
    /// direction points to the position that is farthest from the span of the previous directions.
    fn from_points(positions: &[Point3<f64>]) -> Self {
        let count = positions.len() as f64;
        let mean = positions.iter().map(|position| position.coords / count).sum::<Vector3<f64>>();
        let mut rest: Vec<Vector3<f64>> =
            positions.iter().map(|position| position.coords - mean).collect();
        let (mut directions, mut scale) = (Vec::new(), 0.0);
        for _ in 0..3 {
            let longest = rest.iter().fold(Vector3::zeros(), |best: Vector3<f64>, rest| {
                if rest.norm_squared() > best.norm_squared() { *rest } else { best }
            });
            let length = longest.norm();
            if directions.is_empty() {
                scale = length;
            }
            if length.is_nan() || length <= FLAT_RATIO * scale {
                break;
            }
            let direction = longest / length;
            rest.iter_mut().for_each(|rest| *rest -= direction * direction.dot(rest));
            directions.push(direction);
        }
        Self { origin: mean.into(), terms: 1 + directions.len(), directions, scale }
    }

    /// Returns the values of the linear functions at a position.
    pub(crate) fn values(&self, position: Point3<f64>) -> Vec<f64> {
        if self.terms == 0 {
            return Vec::new();
        }
        let linear = self.directions.iter().map(|d| d.dot(&(position - self.origin)) / self.scale);
        std::iter::once(1.0).chain(linear).collect()
    }

    /// Returns the affine map whose three coordinates are the combinations of the functions with the coefficients in `axes`; `None` if
    /// there are no functions.
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

/// The system is cached for new targets of the same handles.
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
