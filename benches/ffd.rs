//! Measures the time to deform a million points by handles (free-form deformation). The work equals that of other programs (peers) in
//! `benches/peers/peers.py ffd`: all handles of a jittered grid are moved, with f64 numbers and two threads. `deform_nearly` uses a third
//! of the standard deviations, so that distant handles can be skipped. `drag` moves one handle while the others stay. `surface` deforms a
//! mesh with normals.
//!
//! There is no performance target: the results are compared with those of the peers.

use divan::{Bencher, black_box};
use maquette::Progress;
use maquette::value::{Attribute, Faces, Handle, HandleSpace, Handles, Mesh, Points};
use maquette_nodes::deform::{DeformOptions, Drag, Mode, ffd};
use maquette_nodes::mesh::Movable;
use nalgebra::{Point3, Vector3};

fn main() {
    rayon::ThreadPoolBuilder::new().num_threads(2).build_global().expect("the first thread pool");
    divan::main();
}

const POINTS: usize = 1_000_000;

/// Returns a pseudorandom number from 0 to 1, by the same method as in `nurbs.rs`.
fn noise(k: usize) -> f64 {
    let mut bits = (k as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    bits ^= bits >> 29;
    bits = bits.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits ^= bits >> 32;
    (bits >> 11) as f64 / (1u64 << 53) as f64
}

/// Returns random points in the unit cube.
fn cloud() -> Movable {
    Movable::Points(
        Points::new(
            (0..POINTS)
                .map(|k: usize| Point3::new(noise(3 * k), noise(3 * k + 1), noise(3 * k + 2)))
                .collect::<Vec<_>>(),
        )
        .expect("finite points"),
    )
}

/// Returns a flat mesh with `POINTS` vertices and their normals.
fn sheet() -> Movable {
    let side = 1000;
    fn place(k: usize, side: usize) -> f64 {
        k as f64 / (side - 1) as f64
    }
    fn corner(k: usize, side: usize) -> u32 {
        (k / (side - 1) * side + k % (side - 1)) as u32
    }
    let down = side as u32;
    let corners: Vec<u32> = (0..(side - 1) * (side - 1))
        .flat_map(|k: usize| {
            [
                corner(k, side),
                corner(k, side) + 1,
                corner(k, side) + down + 1,
                corner(k, side) + down,
            ]
        })
        .collect();
    let normals = Attribute::Vector(vec![[0.0, 0.0, 1.0]; POINTS].into());
    let mesh = Faces::uniform(4, corners)
        .and_then(|faces| {
            Mesh::new(
                (0..POINTS)
                    .map(|k: usize| Point3::new(place(k % side, side), place(k / side, side), 0.3))
                    .collect::<Vec<_>>(),
                faces,
            )
        })
        .and_then(|mesh| mesh.with_vertex("normal", normals));
    Movable::Mesh(mesh.expect("a sheet"))
}

/// Returns handles in a jittered grid. Their standard deviations are about `reach` times the size of a cell.
fn handles(grid: [usize; 3], reach: f64) -> Handles {
    let cells = Vector3::from(grid.map(|count| 1.0 / count as f64));
    let count = grid.iter().product();
    let all = (0..count)
        .map(|k: usize| {
            let place = [k % grid[0], k / grid[0] % grid[1], k / grid[0] / grid[1]];
            fn jitter(axis: usize, k: usize) -> f64 {
                0.5 + 0.4 * (noise(8 * k + axis) - 0.5)
            }
            let at = [0, 1, 2].map(|axis| (place[axis] as f64 + jitter(axis, k)) * cells[axis]);
            let to = [0, 1, 2].map(|axis| at[axis] + 0.04 * (noise(8 * k + 3 + axis) - 0.5));
            let sigma = (reach + 0.2 * reach * noise(8 * k + 6)) * cells.mean();
            Handle { at, to: Some(to), sigma: Some([sigma; 3]), weight: 0.5 + noise(8 * k + 7) }
        })
        .collect::<Vec<_>>();
    Handles::new(HandleSpace::World, &all).expect("finite handles")
}

fn grid(count: usize) -> [usize; 3] {
    if count == 64 { [4, 4, 4] } else { [8, 8, 4] }
}

fn deform(bencher: Bencher<'_, '_>, what: &Movable, handles: &Handles, how: DeformOptions) {
    bencher.bench(|| {
        ffd(black_box(what), black_box(handles), Mode::default(), how, &Progress::silent())
    });
}

#[divan::bench(args = [64, 256])]
fn exact(bencher: Bencher<'_, '_>, count: usize) {
    deform(bencher, &cloud(), &handles(grid(count), 0.55), DeformOptions::default());
}

#[divan::bench(args = [64, 256])]
fn deform_nearly(bencher: Bencher<'_, '_>, count: usize) {
    let how = DeformOptions { accuracy: 5e-8, ..DeformOptions::default() };
    deform(bencher, &cloud(), &handles(grid(count), 0.2), how);
}

#[divan::bench(args = [64, 256])]
fn surface(bencher: Bencher<'_, '_>, count: usize) {
    deform(bencher, &sheet(), &handles(grid(count), 0.55), DeformOptions::default());
}

/// Moves one handle. Deforms points without normals, or a mesh with normals.
#[divan::bench(args = ["points", "mesh"])]
fn drag(bencher: Bencher<'_, '_>, what: &str) {
    let what = if what == "points" { cloud() } else { sheet() };
    let drag = Drag::new(
        &what,
        &handles([4, 4, 4], 0.55),
        &[21],
        Mode::default(),
        DeformOptions::default(),
    );
    let drag = drag.expect("a well conditioned layout");
    let to = [(21, Point3::new(0.4, 0.4, 0.5))];
    bencher.bench(|| drag.apply_targets(black_box(&to), &Progress::silent()));
}
