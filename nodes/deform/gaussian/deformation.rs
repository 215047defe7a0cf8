//! A deformation of space by Gaussians, evaluated at many points.
//!
//! ```text
//! x' = P(x) + S / W    W = b + sum_i v_i    S = sum_i v_i V_i    v_i = w_i G_i(x)
//! J  = P'   + (sum_i v_i V_i l_i^T - S (sum_i v_i l_i)^T / W) / W        l_i = grad ln G_i
//! ```
//!
//! `V_i` is the coefficient of Gaussian i, `w_i` its weight, `b` the background, `P` the base map and `J` the matrix of derivatives of x'.
//! The weights of [`Gaussians`] are not normalized one by one: the sum S is divided once by W. At a point so far away that W underflows,
//! the sums are computed again with the greatest exponent subtracted from all exponents.

use std::f64::consts::LN_2;
use std::marker::PhantomData;

use maquette_value::simd;
use maquette_value::simd::{
    FusedKernel, Lanes, MulAdd, exp2, exp2_of_normal, exp2_roughly, widest_fused,
};
use nalgebra::{Matrix3, Point3, Vector3};

use super::gaussians::{Bump, Gaussians};

/// A Gaussian and its coefficient.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Term {
    pub(crate) bump: Bump,
    pub(crate) value: [f64; 3],
}

/// A deformation of space: the sum of a base map and weighted Gaussians.
#[derive(Clone, Debug)]
pub(crate) struct Deformation {
    pub(crate) terms: Vec<Term>,
    /// The weight `b` of the background, in units of the greatest weight.
    pub(crate) background: f64,
    pub(crate) base: Base,
}

/// The map `P`, which does not depend on Gaussians: `keep` times the point, plus an affine map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Base {
    pub(crate) keep: f64,
    pub(crate) affine: Option<Affine>,
}

/// An affine map: `shift + linear (x - origin)`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Affine {
    pub(crate) origin: Vector3<f64>,
    pub(crate) shift: Vector3<f64>,
    pub(crate) linear: Matrix3<f64>,
}

impl Base {
    /// Returns a base map that multiplies each point by `keep`: 1 keeps the point, 0 maps it to the origin.
    pub(crate) fn keep(keep: f64) -> Self {
        Self { keep, affine: None }
    }

    #[inline(always)]
    fn map(&self, x: Vector3<f64>) -> Vector3<f64> {
        match &self.affine {
            None => x * self.keep,
            Some(affine) => x * self.keep + (affine.shift + affine.linear * (x - affine.origin)),
        }
    }

    fn derivative(&self) -> Matrix3<f64> {
        let keep = Matrix3::identity() * self.keep;
        self.affine.map_or(keep, |affine| keep + affine.linear)
    }
}

/// Minimum reliable sum of powers. If the sum is less, some terms may have underflowed (the minimum power is 2^-1022), and the sum is
/// computed again.
const MIN_TOTAL: f64 = 1e-150;

/// The number of points that are computed together: enough for independent operations, and few enough to stay in registers.
const LANES: usize = 8;

impl Deformation {
    pub(crate) fn new(gaussians: Gaussians, values: Vec<[f64; 3]>, base: Base) -> Self {
        let terms = gaussians.bumps.into_iter().zip(values);
        let terms = terms.map(|(bump, value)| Term { bump, value }).collect();
        Self { terms, background: gaussians.background, base }
    }

    /// Computes the new positions of `points`, and the derivatives of the new coordinates (rows) with respect to the old ones.
    ///
    /// `terms` are the terms to use: all of them, or those that are relevant near these points.
    ///
    /// # Panics
    /// Panics if the slices have different lengths.
    pub(crate) fn apply(
        &self,
        terms: &[Term],
        points: &[Point3<f64>],
        moved: &mut [Point3<f64>],
        jacobians: Option<&mut [Matrix3<f64>]>,
    ) {
        assert_eq!(points.len(), moved.len(), "one result per point");
        match jacobians {
            None if all_are_normal(terms, points) => {
                run::<NormalPower>(Positions(self, terms, points, moved));
            }
            None => run::<AnyPower>(Positions(self, terms, points, moved)),
            Some(jacobians) => {
                assert_eq!(points.len(), jacobians.len(), "one derivative per point");
                run::<AnyPower>(Jacobians { deformation: self, terms, points, moved, jacobians });
            }
        }
    }
}

impl Deformation {
    /// Computes the new positions of those `points` whose indices are `members`, and writes them into `moved` at the same indices. If
    /// `is_rough`, each power has a relative error of up to [`simd::MAX_ROUGH_ERROR`].
    pub(crate) fn apply_to(
        &self,
        terms: &[Term],
        members: &[u32],
        points: &[Point3<f64>],
        moved: &mut [Point3<f64>],
        is_rough: bool,
        buffer: &mut PointBuffer,
    ) {
        let scattered =
            ScatteredPoints { deformation: self, terms, members, points, moved, buffer };
        if is_rough { run::<RoughPower>(scattered) } else { run::<AnyPower>(scattered) }
    }

    #[inline(always)]
    fn moved_point<const N: usize>(
        &self,
        point: Point3<f64>,
        sums: &Sums<N, 0>,
        lane: usize,
    ) -> Point3<f64> {
        (self.base.map(point.coords) + sums.value(lane) * (1.0 / sums.total.0[lane])).into()
    }
}

/// A method of computing powers of 2: exact or approximate.
trait Power {
    fn power<F: MulAdd>(exponent: f64) -> f64;
}

struct AnyPower;

impl Power for AnyPower {
    #[inline(always)]
    fn power<F: MulAdd>(exponent: f64) -> f64 {
        exp2::<F>(exponent)
    }
}

/// Computes powers of 2 faster than [`AnyPower`]. Valid only if [`all_are_normal`] is true.
struct NormalPower;

impl Power for NormalPower {
    #[inline(always)]
    fn power<F: MulAdd>(exponent: f64) -> f64 {
        exp2_of_normal::<F>(exponent)
    }
}

struct RoughPower;

impl Power for RoughPower {
    #[inline(always)]
    fn power<F: MulAdd>(exponent: f64) -> f64 {
        exp2_roughly::<F>(exponent)
    }
}

/// A method of computing the exponent of a term. [`RoundShape`], for Gaussians with the same width along all axes, needs fewer operations,
/// and a list of only such Gaussians needs no branch.
trait Shape {
    /// Returns the exponent of 2 at a point, given by its offset from the center of the Gaussian.
    fn exponent<F: MulAdd>(bump: &Bump, offset: [f64; 3]) -> f64;
}

struct RoundShape;

impl Shape for RoundShape {
    #[inline(always)]
    fn exponent<F: MulAdd>(Bump { factor, level, .. }: &Bump, [dx, dy, dz]: [f64; 3]) -> f64 {
        F::mul_add(factor[0], F::mul_add(dz, dz, F::mul_add(dy, dy, dx * dx)), *level)
    }
}

struct StretchedShape;

impl Shape for StretchedShape {
    #[inline(always)]
    fn exponent<F: MulAdd>(Bump { factor, level, .. }: &Bump, [dx, dy, dz]: [f64; 3]) -> f64 {
        let [x, y, z] = [dx * factor[0], dy * factor[1], dz * factor[2]];
        F::mul_add(dx, x, *level) + F::mul_add(dz, z, dy * y)
    }
}

struct MixedShape;

impl Shape for MixedShape {
    #[inline(always)]
    fn exponent<F: MulAdd>(bump: &Bump, offset: [f64; 3]) -> f64 {
        let [round, stretched] =
            [RoundShape::exponent::<F>(bump, offset), StretchedShape::exponent::<F>(bump, offset)];
        if bump.is_round() { round } else { stretched }
    }
}

/// A computation over terms, generic in [`Power`] and [`Shape`].
trait Work {
    fn terms(&self) -> &[Term];
    fn run<P: Power, S: Shape, F: MulAdd>(self);
}

/// A computation with its [`Power`] and [`Shape`] chosen.
struct WorkKernel<W, P, S>(W, PhantomData<(P, S)>);

impl<W: Work, P: Power, S: Shape> FusedKernel for WorkKernel<W, P, S> {
    #[inline(always)]
    fn run<F: MulAdd>(self) {
        self.0.run::<P, S, F>();
    }
}

fn run<P: Power>(work: impl Work) {
    let (round, stretched) = (PhantomData::<(P, RoundShape)>, PhantomData::<(P, StretchedShape)>);
    let count = work.terms().iter().filter(|term| term.bump.is_round()).count();
    match work.terms().len() {
        all if count == all => widest_fused(WorkKernel(work, round)),
        _ if count == 0 => widest_fused(WorkKernel(work, stretched)),
        _ => widest_fused(WorkKernel(work, PhantomData::<(P, MixedShape)>)),
    }
}

/// Returns true if every power of a term at the points is a normal floating-point number. Returns false without a test if there are few
/// points, because the test would not pay.
fn all_are_normal(terms: &[Term], points: &[Point3<f64>]) -> bool {
    if points.len() < 512 {
        return false;
    }
    let first = points.first().copied().unwrap_or_default();
    let start = (first.coords, first.coords);
    let (low, high) = points
        .iter()
        .fold(start, |(low, high), point| (low.inf(&point.coords), high.sup(&point.coords)));
    fn min_exponent(
        Term { bump: Bump { center, factor, level }, .. }: &Term,
        low: Vector3<f64>,
        high: Vector3<f64>,
    ) -> f64 {
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let far = (low[axis] - center[axis]).abs().max((high[axis] - center[axis]).abs());
            far * (far * factor[axis])
        });
        level + x + y + z
    }
    // The margin of 1 is for sums that the kernel computes in another order.
    terms.iter().all(|term| min_exponent(term, low, high) > simd::MIN_EXPONENT + 1.0)
}

/// Computes new positions. The fields are the deformation, the terms to use, the points, and the results.
struct Positions<'a>(&'a Deformation, &'a [Term], &'a [Point3<f64>], &'a mut [Point3<f64>]);

impl Work for Positions<'_> {
    fn terms(&self) -> &[Term] {
        self.1
    }

    #[inline(always)]
    fn run<P: Power, S: Shape, F: MulAdd>(self) {
        let Self(deformation, terms, points, moved) = self;
        for (points, moved) in points.chunks(LANES).zip(moved.chunks_mut(LANES)) {
            let sums = sums::<LANES, 0, P, S, F>(terms, deformation.background, &columns(points));
            for (lane, (point, moved)) in points.iter().zip(moved).enumerate() {
                *moved = deformation.moved_point(*point, &sums, lane);
            }
        }
    }
}

/// A buffer of point coordinates. It is filled before any point is computed, so that the memory accesses overlap.
pub(crate) type PointBuffer = [[Lanes<LANES>; 3]; 8];

/// A point buffer with all coordinates 0.
pub(crate) const EMPTY_BUFFER: PointBuffer = [[Lanes::ZERO; 3]; 8];

/// Computes the new positions of those points whose indices are `members`.
struct ScatteredPoints<'a> {
    deformation: &'a Deformation,
    terms: &'a [Term],
    members: &'a [u32],
    points: &'a [Point3<f64>],
    moved: &'a mut [Point3<f64>],
    buffer: &'a mut PointBuffer,
}

impl Work for ScatteredPoints<'_> {
    fn terms(&self) -> &[Term] {
        self.terms
    }

    #[inline(always)]
    fn run<P: Power, S: Shape, F: MulAdd>(self) {
        let Self { deformation, terms, members, points, moved, buffer } = self;
        for members in members.chunks(buffer.len() * LANES) {
            let last = members[members.len() - 1];
            // Fill unused lanes with the last point.
            for k in 0..members.len().next_multiple_of(LANES) {
                let point = points[*members.get(k).unwrap_or(&last) as usize];
                (0..3).for_each(|axis| buffer[k / LANES][axis].0[k % LANES] = point[axis]);
            }
            for (x, members) in buffer.iter().zip(members.chunks(LANES)) {
                let sums = sums::<LANES, 0, P, S, F>(terms, deformation.background, x);
                for (lane, &member) in members.iter().enumerate() {
                    let point = Point3::from(x.each_ref().map(|x| x.0[lane]));
                    moved[member as usize] = deformation.moved_point(point, &sums, lane);
                }
            }
        }
    }
}

struct Jacobians<'a> {
    deformation: &'a Deformation,
    terms: &'a [Term],
    points: &'a [Point3<f64>],
    moved: &'a mut [Point3<f64>],
    jacobians: &'a mut [Matrix3<f64>],
}

impl Work for Jacobians<'_> {
    fn terms(&self) -> &[Term] {
        self.terms
    }

    #[inline(always)]
    fn run<P: Power, S: Shape, F: MulAdd>(self) {
        let Self { deformation, terms, points, moved, jacobians } = self;
        let derivative = deformation.base.derivative();
        let chunks = points.chunks(LANES).zip(moved.chunks_mut(LANES));
        for ((points, moved), jacobians) in chunks.zip(jacobians.chunks_mut(LANES)) {
            let x = columns(points);
            let sums = sums::<LANES, 3, P, S, F>(terms, deformation.background, &x);
            for (lane, (point, (moved, jacobian))) in
                points.iter().zip(moved.iter_mut().zip(jacobians)).enumerate()
            {
                let inverse = 1.0 / sums.total.0[lane];
                let mean = sums.value(lane) * inverse;
                *moved = (deformation.base.map(point.coords) + mean).into();
                // A weight `G` is a power of 2. The stored slope is half the derivative of its exponent, so the gradient of `ln G` is `2 ln
                // 2` times the slope.
                let slope = sums.slope(lane) * (2.0 * LN_2 * inverse);
                let product = sums.product(lane) * (2.0 * LN_2 * inverse);
                *jacobian = derivative + (product - mean * slope.transpose());
            }
        }
    }
}

/// Returns the coordinates of up to `N` points, one list per axis. Unused lanes repeat the last point.
#[inline(always)]
fn columns<const N: usize>(points: &[Point3<f64>]) -> [Lanes<N>; 3] {
    let mut columns = [Lanes::ZERO; 3];
    for lane in 0..N {
        let point = points[lane.min(points.len() - 1)];
        (0..3).for_each(|axis| columns[axis].0[lane] = point[axis]);
    }
    columns
}

/// The sums over all terms, for `N` points. The sums of derivatives are indexed by axis. `DERIVATIVES` is 3, or 0 if no derivatives are
/// requested.
struct Sums<const N: usize, const DERIVATIVES: usize> {
    total: Lanes<N>,
    value: [Lanes<N>; 3],
    slope: [Lanes<N>; DERIVATIVES],
    /// The sums of the products of slope and value, indexed by the axis of the slope, then by the axis of the value.
    product: [[Lanes<N>; 3]; DERIVATIVES],
}

impl<const N: usize, const DERIVATIVES: usize> Sums<N, DERIVATIVES> {
    #[inline(always)]
    fn new(background: &Lanes<N>) -> Self {
        let zeros = [Lanes::ZERO; 3];
        Self {
            total: *background,
            value: zeros,
            slope: [Lanes::ZERO; DERIVATIVES],
            product: [zeros; DERIVATIVES],
        }
    }

    #[inline(always)]
    fn value(&self, lane: usize) -> Vector3<f64> {
        Vector3::from([0, 1, 2].map(|axis| self.value[axis].0[lane]))
    }

    /// Copies the sums of `other` in those lanes in which the total of `self` is too small to be reliable.
    fn replace_lost(&mut self, other: &Self) {
        for lane in 0..N {
            if self.total.0[lane] < MIN_TOTAL {
                let lists = self.product.as_flattened_mut().iter_mut().chain(&mut self.slope);
                let others = other.product.as_flattened().iter().chain(&other.slope);
                for (list, other) in lists.chain(&mut self.value).zip(others.chain(&other.value)) {
                    list.0[lane] = other.0[lane];
                }
                self.total.0[lane] = other.total.0[lane];
            }
        }
    }
}

impl<const N: usize> Sums<N, 3> {
    #[inline(always)]
    fn slope(&self, lane: usize) -> Vector3<f64> {
        Vector3::from([0, 1, 2].map(|axis| self.slope[axis].0[lane]))
    }

    #[inline(always)]
    fn product(&self, lane: usize) -> Matrix3<f64> {
        Matrix3::from_fn(|row, column| self.product[column][row].0[lane])
    }
}

/// Computes the sums over all terms. Sums that underflow are recomputed with shifted exponents. Each lane depends only on its own point.
#[inline(always)]
fn sums<const N: usize, const DERIVATIVES: usize, P: Power, S: Shape, F: MulAdd>(
    terms: &[Term],
    background: f64,
    x: &[Lanes<N>; 3],
) -> Sums<N, DERIVATIVES> {
    let mut sums = Sums::new(&Lanes([background; N]));
    add::<N, DERIVATIVES, P, S, F, false>(terms, x, &Lanes::ZERO, &mut sums);
    if sums.total.0.iter().any(|total| *total < MIN_TOTAL) {
        let rest = libm::log2(background);
        let mut greatest = Lanes([rest; N]);
        for term in terms {
            for lane in 0..N {
                let exponent = term.bump.exponent([x[0].0[lane], x[1].0[lane], x[2].0[lane]]);
                greatest.0[lane] = greatest.0[lane].max(exponent);
            }
        }
        let rest = greatest
            .0
            .map(|greatest| if background > 0.0 { exp2::<F>(rest - greatest) } else { 0.0 });
        let mut again = Sums::new(&Lanes(rest));
        add::<N, DERIVATIVES, AnyPower, S, F, true>(terms, x, &greatest, &mut again);
        sums.replace_lost(&again);
    }
    sums
}

/// Adds all terms to the sums in one pass without branches, so that the compiler uses all SIMD lanes.
#[inline(always)]
fn add<
    const N: usize,
    const DERIVATIVES: usize,
    P: Power,
    S: Shape,
    F: MulAdd,
    const SHIFTED: bool,
>(
    terms: &[Term],
    x: &[Lanes<N>; 3],
    shift: &Lanes<N>,
    sums: &mut Sums<N, DERIVATIVES>,
) {
    let [x, y, z] = x;
    let (x, y, z, shift) = (&x.0, &y.0, &z.0, &shift.0);
    let Sums { total, value: [s0, s1, s2], slope, product } = sums;
    for Term { bump, value } in terms {
        let Bump { center, factor, .. } = bump;
        for k in 0..N {
            let offset = [x[k] - center[0], y[k] - center[1], z[k] - center[2]];
            let mut exponent = S::exponent::<F>(bump, offset);
            if SHIFTED {
                exponent -= shift[k];
            }
            let v = P::power::<F>(exponent);
            total.0[k] += v;
            s0.0[k] = F::mul_add(v, value[0], s0.0[k]);
            s1.0[k] = F::mul_add(v, value[1], s1.0[k]);
            s2.0[k] = F::mul_add(v, value[2], s2.0[k]);
            let derivatives = slope.iter_mut().zip(product.iter_mut()).enumerate();
            for (axis, (slope, [px, py, pz])) in derivatives {
                let vl = v * (offset[axis] * factor[axis]);
                slope.0[k] += vl;
                px.0[k] = F::mul_add(vl, value[0], px.0[k]);
                py.0[k] = F::mul_add(vl, value[1], py.0[k]);
                pz.0[k] = F::mul_add(vl, value[2], pz.0[k]);
            }
        }
    }
}
