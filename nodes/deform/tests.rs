//! Tests of deformations with exact results. Identifiers such as D1 are those of algorithms.md, section 13.

use maquette_mesh::Movable;
use maquette_node::{Error, Progress};
use maquette_value::rng::Random;
use maquette_value::{Handle, HandleSpace, Handles, Points};
use nalgebra::{DMatrix, Matrix3, Point3, Vector3};

use super::free_form::pull;
use super::gaussian::gaussians::Gaussians;
use super::gaussian::layout::{Layout, prepare};
use super::gaussian::system::System;
use super::{DeformOptions, Mode, Report, ffd};

mod forms;
mod objects;
mod tables;

/// Random points in the unit cube.
pub(super) trait RandomPoints {
    fn point(&mut self) -> Point3<f64>;

    fn points(&mut self, count: usize) -> Vec<Point3<f64>> {
        (0..count).map(|_| self.point()).collect()
    }
}

impl RandomPoints for Random {
    fn point(&mut self) -> Point3<f64> {
        Point3::from([0, 1, 2].map(|_| self.even()))
    }
}

pub(super) const UNIT: (Point3<f64>, Point3<f64>) =
    (Point3::new(0.0, 0.0, 0.0), Point3::new(1.0, 1.0, 1.0));

pub(super) fn handle(at: Point3<f64>, to: Point3<f64>, sigma: [f64; 3]) -> Handle {
    Handle { at: at.into(), to: Some(to.into()), sigma: Some(sigma), weight: 1.0 }
}

/// Returns handles at rest at the corners of the unit cube, with the deviations `sigma`.
pub(super) fn corners(sigma: [f64; 3]) -> Vec<Handle> {
    fn bit(k: usize, axis: usize) -> f64 {
        (k >> axis & 1) as f64
    }
    fn corner(k: usize) -> Point3<f64> {
        Point3::new(bit(k, 0), bit(k, 1), bit(k, 2))
    }
    (0..8).map(|k| handle(corner(k), corner(k), sigma)).collect()
}

pub(super) fn in_world(handles: &[Handle]) -> Handles {
    Handles::new(HandleSpace::World, handles).unwrap()
}

/// Returns the mode, and options with the unit cube as box.
pub(super) fn options_in_unit(mode: Mode) -> (Mode, DeformOptions) {
    (mode, in_unit())
}

pub(super) fn in_unit() -> DeformOptions {
    DeformOptions { frame: Some(UNIT), ..DeformOptions::default() }
}

pub(super) fn try_move(
    points: &[Point3<f64>],
    handles: &[Handle],
    (mode, options): (Mode, DeformOptions),
) -> Result<(Vec<Point3<f64>>, Report), Error> {
    let object = Movable::Points(Points::new(points.to_vec()).unwrap());
    let (moved, report) = ffd(&object, &in_world(handles), mode, options, &Progress::silent())?;
    let Movable::Points(moved) = moved else { panic!("points stay points") };
    Ok((moved.positions().to_vec(), report))
}

pub(super) fn move_points(
    points: &[Point3<f64>],
    handles: &[Handle],
    options: (Mode, DeformOptions),
) -> Vec<Point3<f64>> {
    try_move(points, handles, options).unwrap().0
}

pub(super) fn layout(handles: &[Handle], mode: Mode) -> Layout {
    prepare(&in_world(handles), UNIT, mode, 0.0, 0.0).unwrap().layout
}

/// Returns the condition number, in the 2-norm, of the matrix of the handles' weights, computed from its singular values.
pub(super) fn condition(handles: &[Handle]) -> f64 {
    let layout = layout(handles, Mode::Displacement);
    let gaussians: Gaussians = layout.gaussians();
    let rows = layout.positions.iter().flat_map(|&at| gaussians.weights(at));
    let n = layout.positions.len();
    let values = DMatrix::from_row_iterator(n, n, rows).singular_values();
    values.max() / values.min()
}

pub(super) fn farthest(a: &[Point3<f64>], b: &[Point3<f64>]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

/// Returns handles on a jittered grid, with anisotropic deviations, and various weights and targets.
pub(super) fn scattered_handles(random: &mut Random, sides: usize, reach: f64) -> Vec<Handle> {
    fn shift(step: f64, random: &mut Random) -> Vector3<f64> {
        (random.point() - Point3::new(0.5, 0.5, 0.5)) * step
    }
    let step = 0.3 / sides as f64;
    let mut handles = Vec::new();
    for k in 0..sides * sides * sides {
        let cell = [k % sides, k / sides % sides, k / sides / sides];
        let center = Point3::from(cell.map(|index| (index as f64 + 0.5) / sides as f64));
        let at = center + shift(step, random);
        let to = at + shift(step, random);
        let sigma = [0, 1, 2].map(|_| reach * (0.8 + 0.4 * random.even()) / sides as f64);
        handles.push(Handle { weight: 0.5 + random.even(), ..handle(at, to, sigma) });
    }
    handles
}

fn solve(handles: &[Handle], mode: Mode) -> System {
    System::new(&layout(handles, mode)).unwrap()
}

/// Returns the deformed position of a point, and the derivatives at the point.
fn deform_point(handles: &[Handle], mode: Mode, point: Point3<f64>) -> (Point3<f64>, Matrix3<f64>) {
    let prepared = prepare(&in_world(handles), UNIT, mode, 0.0, 0.0).unwrap();
    let deformation = pull::deformation(&prepared, &solve(handles, mode));
    let (mut result, mut jacobian) = ([point], [Matrix3::zeros()]);
    deformation.apply(&deformation.terms, &[point], &mut result, Some(&mut jacobian));
    (result[0], jacobian[0])
}

/// All modes of a deformation.
const MODES: [Mode; 3] = [Mode::Displacement, Mode::Absolute, Mode::Affine];

#[test]
fn derivatives_are_those_of_differences() {
    let mut random = Random(3);
    let handles = scattered_handles(&mut random, 3, 0.7);
    for mode in MODES {
        for point in random.points(20).into_iter().chain([Point3::new(3.0, -2.0, 0.5)]) {
            let (_, jacobian) = deform_point(&handles, mode, point);
            for axis in 0..3 {
                let step = Vector3::ith(axis, 1e-5);
                let [above, below] =
                    [1.0, -1.0].map(|sign| deform_point(&handles, mode, point + step * sign).0);
                let difference = (above - below) / 2e-5;
                let off = (jacobian.column(axis) - difference).norm();
                assert!(off <= 1e-6 * jacobian.norm().max(1.0), "{mode:?} at {point}: {off}");
            }
        }
    }
}
