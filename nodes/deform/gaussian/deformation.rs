//! A deformation of space by Gaussians, on many points at once.
//!
//! ```text
//! x' = P(x) + S / W    W = b + sum_i v_i    S = sum_i v_i V_i    v_i = w_i G_i(x)
//! J  = P'   + (sum_i v_i V_i l_i^T - S (sum_i v_i l_i)^T / W) / W        l_i = grad ln G_i
//! ```
//!
//! The shares of [`Gaussians`] are not computed one by one: the sums are divided once. A point so
//! far away that W vanishes is computed again with the greatest exponent taken off all of them.

use std::f64::consts::LN_2;
use std::marker::PhantomData;

use maquette_value::simd;
use maquette_value::simd::{
    Fused, FusedKernel, Lanes, exp2, exp2_of_normal, exp2_roughly, widest_fused,
};
use nalgebra::{Matrix3, Point3, Vector3};

use super::gaussians::{Bump, Gaussians};

/// A Gaussian and the coefficient that it shares out.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Term {
    pub(crate) bump: Bump,
    pub(crate) value: [f64; 3],
}

/// Where points go.
#[derive(Clone, Debug)]
pub(crate) struct Deformation {
    pub(crate) terms: Vec<Term>,
    /// b, in the unit of the greatest weight.
    pub(crate) background: f64,
    pub(crate) base: Base,
}

/// The part P of a deformation that no Gaussian shares out: the point itself, once or not at all, and an affine map.
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
    /// Where nothing moves by itself (1), or everything to the origin (0).
    pub(crate) fn keep(keep: f64) -> Self {
        Self { keep, affine: None }
    }

    #[inline(always)]
    fn at(&self, x: Vector3<f64>) -> Vector3<f64> {
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

/// Below this sum of powers the terms behind the greatest may be missing: the least power is 2^-1022.
const LEAST_TOTAL: f64 = 1e-150;

/// Points that are computed together: enough to be independent of each other, few enough to stay near the processor.
const LANES: usize = 8;

impl Deformation {
    pub(crate) fn new(gaussians: Gaussians, values: Vec<[f64; 3]>, base: Base) -> Self {
        let terms = gaussians.bumps.into_iter().zip(values);
        let terms = terms.map(|(bump, value)| Term { bump, value }).collect();
        Self { terms, background: gaussians.background, base }
    }

    /// Where `points` go, and how space is deformed there: the derivatives of the new coordinates (rows) by the old ones.
    ///
    /// `terms` are all of them, or those that count near these points.
    ///
    /// # Panics
    /// If the lists are not equally long.
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
                run::<Normal>(Positions(self, terms, points, moved));
            }
            None => run::<Any>(Positions(self, terms, points, moved)),
            Some(jacobians) => {
                assert_eq!(points.len(), jacobians.len(), "one derivative per point");
                run::<Any>(Jacobians { deformation: self, terms, points, moved, jacobians });
            }
        }
    }
}

impl Deformation {
    /// Where the `members` of `points` go, into their places of `moved`. With `roughly` each power may be off by
    /// [`simd::ROUGHLY`] of itself.
    pub(crate) fn apply_to(
        &self,
        terms: &[Term],
        members: &[u32],
        points: &[Point3<f64>],
        moved: &mut [Point3<f64>],
        roughly: bool,
        near: &mut Near,
    ) {
        let scattered = Scattered { deformation: self, terms, members, points, moved, near };
        if roughly { run::<Rough>(scattered) } else { run::<Any>(scattered) }
    }

    #[inline(always)]
    fn moved<const N: usize>(
        &self,
        point: Point3<f64>,
        sums: &Sums<N, 0>,
        lane: usize,
    ) -> Point3<f64> {
        (self.base.at(point.coords) + sums.value(lane) * (1.0 / sums.total.0[lane])).into()
    }
}

/// How powers of 2 are taken.
trait Power {
    fn of<F: Fused>(exponent: f64) -> f64;
}

struct Any;

impl Power for Any {
    #[inline(always)]
    fn of<F: Fused>(exponent: f64) -> f64 {
        exp2::<F>(exponent)
    }
}

/// Where [`all_are_normal`].
struct Normal;

impl Power for Normal {
    #[inline(always)]
    fn of<F: Fused>(exponent: f64) -> f64 {
        exp2_of_normal::<F>(exponent)
    }
}

struct Rough;

impl Power for Rough {
    #[inline(always)]
    fn of<F: Fused>(exponent: f64) -> f64 {
        exp2_roughly::<F>(exponent)
    }
}

/// How the exponent of a term is taken, which is what its Gaussian alone says: one that is equally wide along all axes needs fewer
/// operations, and a list of such terms no choice.
trait Shape {
    /// The exponent of 2 at a point with this offset from the center.
    fn exponent<F: Fused>(bump: &Bump, offset: [f64; 3]) -> f64;
}

struct Round;

impl Shape for Round {
    #[inline(always)]
    fn exponent<F: Fused>(Bump { factor, level, .. }: &Bump, [dx, dy, dz]: [f64; 3]) -> f64 {
        F::fused(factor[0], F::fused(dz, dz, F::fused(dy, dy, dx * dx)), *level)
    }
}

struct Stretched;

impl Shape for Stretched {
    #[inline(always)]
    fn exponent<F: Fused>(Bump { factor, level, .. }: &Bump, [dx, dy, dz]: [f64; 3]) -> f64 {
        let [x, y, z] = [dx * factor[0], dy * factor[1], dz * factor[2]];
        F::fused(dx, x, *level) + F::fused(dz, z, dy * y)
    }
}

struct Mixed;

impl Shape for Mixed {
    #[inline(always)]
    fn exponent<F: Fused>(bump: &Bump, offset: [f64; 3]) -> f64 {
        let [round, stretched] =
            [Round::exponent::<F>(bump, offset), Stretched::exponent::<F>(bump, offset)];
        if bump.is_round() { round } else { stretched }
    }
}

/// What is done with terms, whatever their powers and shapes are.
trait Work {
    fn terms(&self) -> &[Term];
    fn run<P: Power, S: Shape, F: Fused>(self);
}

/// A work with its choices made.
struct By<W, P, S>(W, PhantomData<(P, S)>);

impl<W: Work, P: Power, S: Shape> FusedKernel for By<W, P, S> {
    #[inline(always)]
    fn run<F: Fused>(self) {
        self.0.run::<P, S, F>();
    }
}

fn run<P: Power>(work: impl Work) {
    let (round, stretched) = (PhantomData::<(P, Round)>, PhantomData::<(P, Stretched)>);
    let count = work.terms().iter().filter(|term| term.bump.is_round()).count();
    match work.terms().len() {
        all if count == all => widest_fused(By(work, round)),
        _ if count == 0 => widest_fused(By(work, stretched)),
        _ => widest_fused(By(work, PhantomData::<(P, Mixed)>)),
    }
}

/// Whether no power of a term at any of the points is too small to have all its digits; not looked for at a few points.
fn all_are_normal(terms: &[Term], points: &[Point3<f64>]) -> bool {
    if points.len() < 512 {
        return false;
    }
    let first = points.first().copied().unwrap_or_default();
    let start = (first.coords, first.coords);
    let (low, high) = points
        .iter()
        .fold(start, |(low, high), point| (low.inf(&point.coords), high.sup(&point.coords)));
    fn least(
        Term { bump: Bump { center, factor, level }, .. }: &Term,
        low: Vector3<f64>,
        high: Vector3<f64>,
    ) -> f64 {
        let of_axis = |axis: usize| {
            let far = (low[axis] - center[axis]).abs().max((high[axis] - center[axis]).abs());
            far * (far * factor[axis])
        };
        level + of_axis(0) + of_axis(1) + of_axis(2)
    }
    // A little more than the least, because the sums there are rounded in another order.
    terms.iter().all(|term| least(term, low, high) > simd::LEAST + 1.0)
}

/// The terms, the points, and where they go.
struct Positions<'a>(&'a Deformation, &'a [Term], &'a [Point3<f64>], &'a mut [Point3<f64>]);

impl Work for Positions<'_> {
    fn terms(&self) -> &[Term] {
        self.1
    }

    #[inline(always)]
    fn run<P: Power, S: Shape, F: Fused>(self) {
        let Self(deformation, terms, points, moved) = self;
        for (points, moved) in points.chunks(LANES).zip(moved.chunks_mut(LANES)) {
            let sums = sums::<LANES, 0, P, S, F>(terms, deformation.background, &columns(points));
            for (lane, (point, moved)) in points.iter().zip(moved).enumerate() {
                *moved = deformation.moved(*point, &sums, lane);
            }
        }
    }
}

/// Coordinates of points that are gathered before any of them is computed: from places far apart in memory, which are waited for
/// together.
pub(crate) type Near = [[Lanes<LANES>; 3]; 8];

/// None yet.
pub(crate) const NONE_NEAR: Near = [[Lanes::ZERO; 3]; 8];

/// Which of the points, the points, and where they go.
struct Scattered<'a> {
    deformation: &'a Deformation,
    terms: &'a [Term],
    members: &'a [u32],
    points: &'a [Point3<f64>],
    moved: &'a mut [Point3<f64>],
    near: &'a mut Near,
}

impl Work for Scattered<'_> {
    fn terms(&self) -> &[Term] {
        self.terms
    }

    #[inline(always)]
    fn run<P: Power, S: Shape, F: Fused>(self) {
        let Self { deformation, terms, members, points, moved, near } = self;
        for members in members.chunks(near.len() * LANES) {
            let last = members[members.len() - 1];
            // Lanes that are left get the last point again.
            for k in 0..members.len().next_multiple_of(LANES) {
                let point = points[*members.get(k).unwrap_or(&last) as usize];
                (0..3).for_each(|axis| near[k / LANES][axis].0[k % LANES] = point[axis]);
            }
            for (x, members) in near.iter().zip(members.chunks(LANES)) {
                let sums = sums::<LANES, 0, P, S, F>(terms, deformation.background, x);
                for (lane, &member) in members.iter().enumerate() {
                    let point = Point3::from(x.each_ref().map(|x| x.0[lane]));
                    moved[member as usize] = deformation.moved(point, &sums, lane);
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
    fn run<P: Power, S: Shape, F: Fused>(self) {
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
                let share = sums.value(lane) * inverse;
                *moved = (deformation.base.at(point.coords) + share).into();
                // The gradients of ln G are 2 ln 2 times the slopes, which are those of the exponents of 2, halved.
                let slope = sums.slope(lane) * (2.0 * LN_2 * inverse);
                let product = sums.product(lane) * (2.0 * LN_2 * inverse);
                *jacobian = derivative + (product - share * slope.transpose());
            }
        }
    }
}

/// The coordinates of up to `N` points by axis; the last point again in lanes that are left.
#[inline(always)]
fn columns<const N: usize>(points: &[Point3<f64>]) -> [Lanes<N>; 3] {
    let mut columns = [Lanes::ZERO; 3];
    for lane in 0..N {
        let point = points[lane.min(points.len() - 1)];
        (0..3).for_each(|axis| columns[axis].0[lane] = point[axis]);
    }
    columns
}

/// The sums over all terms, for `N` points: those of the derivatives are by axis, 3 or, where they are not wanted, 0.
struct Sums<const N: usize, const DERIVATIVES: usize> {
    total: Lanes<N>,
    value: [Lanes<N>; 3],
    slope: [Lanes<N>; DERIVATIVES],
    /// By the axis of the slope, then by that of the value.
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

    /// Takes over the lanes of `other` in which the total here is too small.
    fn replace_lost(&mut self, other: &Self) {
        for lane in 0..N {
            if self.total.0[lane] < LEAST_TOTAL {
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

/// The sums, with those that vanish computed again. Each lane depends on its own point alone.
#[inline(always)]
fn sums<const N: usize, const DERIVATIVES: usize, P: Power, S: Shape, F: Fused>(
    terms: &[Term],
    background: f64,
    x: &[Lanes<N>; 3],
) -> Sums<N, DERIVATIVES> {
    let mut sums = Sums::new(&Lanes([background; N]));
    add::<N, DERIVATIVES, P, S, F, false>(terms, x, &Lanes::ZERO, &mut sums);
    if sums.total.0.iter().any(|total| *total < LEAST_TOTAL) {
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
        add::<N, DERIVATIVES, Any, S, F, true>(terms, x, &greatest, &mut again);
        sums.replace_lost(&again);
    }
    sums
}

/// Adds every term to the sums. One pass, without a branch: all lanes of the processor are at work.
#[inline(always)]
fn add<
    const N: usize,
    const DERIVATIVES: usize,
    P: Power,
    S: Shape,
    F: Fused,
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
            let v = P::of::<F>(exponent);
            total.0[k] += v;
            s0.0[k] = F::fused(v, value[0], s0.0[k]);
            s1.0[k] = F::fused(v, value[1], s1.0[k]);
            s2.0[k] = F::fused(v, value[2], s2.0[k]);
            let derivatives = slope.iter_mut().zip(product.iter_mut()).enumerate();
            for (axis, (slope, [px, py, pz])) in derivatives {
                let vl = v * (offset[axis] * factor[axis]);
                slope.0[k] += vl;
                px.0[k] = F::fused(vl, value[0], px.0[k]);
                py.0[k] = F::fused(vl, value[1], py.0[k]);
                pz.0[k] = F::fused(vl, value[2], pz.0[k]);
            }
        }
    }
}
