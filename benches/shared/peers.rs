//! The meshes of the peers' benchmarks, if they are there, and tori like these.
//!
//! The folder is `PEERS_WORK`/data; `benches/peers/peers.py` makes them.

use std::path::{Path, PathBuf};

use maquette::value::{Faces, Mesh};
use nalgebra::Point3;

/// Where the meshes are.
pub(crate) fn folder() -> PathBuf {
    let work = std::env::var_os("PEERS_WORK").map(PathBuf::from);
    work.unwrap_or_else(|| std::env::temp_dir().join("peers")).join("data")
}

/// The mesh of this name, whose faces have so many sides; none if it is not there.
pub(crate) fn load(name: &str, sides: usize) -> Option<Mesh> {
    let positions: Vec<[f64; 3]> = open(&folder().join(format!("{name}_v.npy")))?;
    let corners: Vec<u32> = open(&folder().join(format!("{name}_f.npy")))?;
    let positions: Vec<Point3<f64>> = positions.into_iter().map(Point3::from).collect();
    Mesh::new(positions, Faces::uniform(sides, corners).ok()?).ok()
}

/// The items of a file of NumPy, version 1, in C order.
fn open<T: bytemuck::Pod>(path: &Path) -> Option<Vec<T>> {
    let bytes = std::fs::read(path).ok()?;
    let length = usize::from(u16::from_le_bytes([*bytes.get(8)?, *bytes.get(9)?]));
    Some(bytemuck::pod_collect_to_vec(bytes.get(10 + length..)?))
}

/// A torus of so many rows and columns of vertices: quads, or twice as many triangles. `bump` is how rough it is.
pub(crate) fn torus(sides: usize, [rows, columns]: [u32; 2], bump: f64) -> Mesh {
    fn angle(k: u32, n: u32) -> (f64, f64) {
        libm::sincos(std::f64::consts::TAU * f64::from(k) / f64::from(n))
    }
    let quads = (0..rows * columns).map(|k: u32| {
        fn at(i: u32, j: u32, rows: u32, columns: u32) -> u32 {
            i % rows * columns + j % columns
        }
        let (i, j) = (k / columns, k % columns);
        [
            at(i, j, rows, columns),
            at(i, j + 1, rows, columns),
            at(i + 1, j + 1, rows, columns),
            at(i + 1, j, rows, columns),
        ]
    });
    let corners = match sides {
        3 => quads.flat_map(|[a, b, c, d]| [a, b, c, a, c, d]).collect(),
        _ => quads.flatten().collect::<Vec<u32>>(),
    };
    let positions: Vec<_> = (0..rows * columns)
        .map(|k: u32| {
            let ((s, c), (t, d)) = (angle(k / columns, rows), angle(k % columns, columns));
            let bump = 1.0 + bump * libm::sin(f64::from(k) * 1.7);
            Point3::new((2.0 + c * bump) * d, (2.0 + c * bump) * t, s * bump)
        })
        .collect();
    Mesh::new(positions, Faces::uniform(sides, corners).expect("whole faces")).expect("a torus")
}
