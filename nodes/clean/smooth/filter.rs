//! A low-pass filter on the vertices of a mesh.

use std::ops::Add;

use maquette_base::topology::lists::Lists;
use maquette_node::{Error, Progress, bail};
use maquette_value::parallel::*;
use nalgebra::{Complex, Point3, Vector3};

/// The iteration stops at this residual, relative to the initial residual.
const TOLERANCE: f64 = 1e-5;

/// Maximum number of steps of the iteration: enough for waves of a thousand edges.
const MAX_STEPS: usize = 20_000;

/// A low-pass filter on a graph whose vertices have masses and whose edges have weights.
pub(super) struct Filter {
    /// For each vertex its neighbors, with the weights of the edges to them.
    rows: Lists<(u32, f64)>,
    masses: Vec<f64>,
}

impl Filter {
    pub(super) fn new(masses: Vec<f64>, edges: &[([u32; 2], f64)]) -> Self {
        let rows = Lists::group(masses.len(), || {
            edges.iter().flat_map(|&([a, b], weight)| [(a, (b, weight)), (b, (a, weight))])
        });
        Self { rows, masses }
    }

    /// Solves `(M + c^2 K M^-1 K) x = M x_before` for the free vertices with a mass. `K` contains the weights, `M` the masses, and `c` is
    /// chosen such that a wave of the given `length` keeps half of its height.
    ///
    /// `x` is the real part of the solution `z` of `(M + i c K) z = M x_before`: multiply this by `(M - i c K) M^-1`. That equation has
    /// only the square root of the other one's condition number. The solver is that of conjugate gradients for complex symmetric matrices,
    /// with the diagonal as preconditioner: van der Vorst and Melissen, "A Petrov-Galerkin type method for solving Ax = b, where A is
    /// symmetric complex" (1990).
    pub(super) fn apply(
        &self,
        places: &mut [Point3<f64>],
        is_free: &[bool],
        length: f64,
        progress: &Progress<'_>,
    ) -> Result<(), Error> {
        let system = System::new(self, is_free, length);
        // With `z = x_before - i y` the right side is `c K x_before`, and the real part of `-i y` is the imaginary part of `y`.
        let mut residual = system.right_side(places);
        let mut moves = vec![Vector3::zeros(); places.len()];
        let mut along = vec![Complex3::default(); places.len()];
        let mut image = along.clone();
        let first = system.sums(&residual);
        let (mut sums, mut share) = (first, Complex::ZERO);
        for step in 0..MAX_STEPS {
            // The number of steps is not known in advance, so the reported progress approaches 1 gradually.
            progress.tick(step as f64 / (step as f64 + 15.0))?;
            if sums.size <= TOLERANCE * TOLERANCE * first.size {
                places.iter_mut().zip(&moves).for_each(|(place, by)| *place += by);
                return Ok(());
            }
            let all = along.par_iter_mut().zip(residual.par_iter().zip(&system.over_diagonal));
            all.with_min_len(4096).for_each(|(along, (residual, over))| {
                *along = along.times(share) + residual.times(*over);
            });
            let factor = sums.product / system.apply(&along, &mut image);
            let all = residual.par_iter_mut().zip(along.par_iter().zip(&image));
            let all = moves.par_iter_mut().zip(all).with_min_len(4096);
            all.for_each(|(moves, (residual, (along, image)))| {
                *moves += along.times(factor).im;
                *residual = *residual + image.times(-factor);
            });
            let next = system.sums(&residual);
            share = next.product / sums.product;
            sums = next;
            if !sums.size.is_finite() {
                break;
            }
        }
        let off = (sums.size / first.size).sqrt();
        bail!(
            "the mesh is too distorted, or `length` is too large for its edges: the residual is still {off:.2e} after {MAX_STEPS} steps; use `Remesh` to make its faces uniform"
        )
    }
}

/// The equation that `Filter::apply` solves.
struct System<'a> {
    filter: &'a Filter,
    /// The factor `c`.
    strength: f64,
    /// The inverse diagonal of `M + i c K`; 0 for vertices that are fixed or have no mass. Bending at these is ignored, so that a straight
    /// surface stays straight up to them.
    over_diagonal: Vec<Complex<f64>>,
}

impl<'a> System<'a> {
    fn new(filter: &'a Filter, is_free: &[bool], length: f64) -> Self {
        let unit = length / std::f64::consts::TAU;
        let strength = unit * unit;
        let rows = filter.masses.par_iter().zip(is_free).enumerate().with_min_len(1024);
        let over_diagonal = rows
            .map(|(row, (&mass, &is_free))| {
                if !is_free || mass <= 0.0 {
                    return Complex::ZERO;
                }
                let weights = filter.rows.list(row).iter().map(|(_, weight)| weight);
                Complex::new(mass, strength * weights.sum::<f64>()).inv()
            })
            .collect();
        Self { filter, strength, over_diagonal }
    }

    fn right_side(&self, places: &[Point3<f64>]) -> Vec<Complex3> {
        let rows = places.par_iter().enumerate().with_min_len(1024);
        rows.map(|(row, place)| {
            let neighbors = self.filter.rows.list(row).iter();
            let differences =
                neighbors.map(|&(other, weight)| (place - places[other as usize]) * weight);
            Complex3 { re: differences.sum::<Vector3<f64>>() * self.strength, im: Vector3::zeros() }
        })
        .collect()
    }

    /// Writes `(M + i c K) x` to `image`, and returns the product of both. `x` is 0 for vertices that are not solved for.
    fn apply(&self, x: &[Complex3], image: &mut [Complex3]) -> Complex<f64> {
        let rows = self.filter.masses.par_iter().zip(x).enumerate();
        let rows = image.par_iter_mut().zip(rows).with_min_len(1024);
        let products = rows.fold_parts(Complex::default, |sum, (image, (row, (&mass, own)))| {
            let mut bent = Complex3::default();
            for &(other, weight) in self.filter.rows.list(row) {
                let other = &x[other as usize];
                bent.re += (own.re - other.re) * weight;
                bent.im += (own.im - other.im) * weight;
            }
            image.re = own.re * mass - bent.im * self.strength;
            image.im = own.im * mass + bent.re * self.strength;
            sum + own.product(image)
        });
        products.into_iter().sum()
    }

    /// Returns sums over all vertices that are solved for.
    fn sums(&self, residual: &[Complex3]) -> Sums {
        let all = residual.par_iter().zip(&self.over_diagonal).with_min_len(4096);
        let parts = all.fold_parts(Sums::default, |sums, (residual, &over)| {
            let square = residual.re.norm_squared() + residual.im.norm_squared();
            Sums {
                product: sums.product + residual.product(&residual.times(over)),
                size: sums.size + square * over.norm_sqr().sqrt(),
            }
        });
        parts.into_iter().fold(Sums::default(), |a, b| Sums {
            product: a.product + b.product,
            size: a.size + b.size,
        })
    }
}

#[derive(Clone, Copy, Default)]
struct Sums {
    /// The product of the residual and the preconditioned residual, without conjugation.
    product: Complex<f64>,
    /// The squared length of the residual in the norm of the preconditioner.
    size: f64,
}

/// Three complex numbers.
#[derive(Clone, Copy, Default)]
struct Complex3 {
    re: Vector3<f64>,
    im: Vector3<f64>,
}

impl Complex3 {
    fn times(&self, by: Complex<f64>) -> Self {
        Self { re: self.re * by.re - self.im * by.im, im: self.re * by.im + self.im * by.re }
    }

    /// The sum of the products of the components, without conjugation.
    fn product(&self, other: &Self) -> Complex<f64> {
        Complex::new(
            self.re.dot(&other.re) - self.im.dot(&other.im),
            self.re.dot(&other.im) + self.im.dot(&other.re),
        )
    }
}

impl Add for Complex3 {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { re: self.re + other.re, im: self.im + other.im }
    }
}
