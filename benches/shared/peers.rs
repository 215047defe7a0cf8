//! Reads the meshes with which other programs (peers) are measured, if these meshes exist. Also creates tori of similar size.
//!
//! `benches/peers/peers.py` writes the meshes to the folder `data` in the folder `$PEERS_WORK`.

use std::path::{Path, PathBuf};

use maquette::value::{Faces, Mesh};
use nalgebra::Point3;

/// Returns the folder that contains the peers' meshes.
pub(crate) fn folder() -> PathBuf {
    let work = std::env::var_os("PEERS_WORK").map(PathBuf::from);
    work.unwrap_or_else(|| std::env::temp_dir().join("peers")).join("data")
}

/// Reads the mesh with this name, whose faces must have `sides` sides. Returns `None` if the file does not exist.
pub(crate) fn load(name: &str, sides: usize) -> Option<Mesh> {
    let positions: Vec<[f64; 3]> = open(&folder().join(format!("{name}_v.npy")))?;
    let corners: Vec<u32> = open(&folder().join(format!("{name}_f.npy")))?;
    let positions: Vec<Point3<f64>> = positions.into_iter().map(Point3::from).collect();
    Mesh::new(positions, Faces::uniform(sides, corners).ok()?).ok()
}

/// Reads the items of a NumPy file (version 1, C order).
fn open<T: bytemuck::Pod>(path: &Path) -> Option<Vec<T>> {
    let bytes = std::fs::read(path).ok()?;
    let length = usize::from(u16::from_le_bytes([*bytes.get(8)?, *bytes.get(9)?]));
    Some(bytemuck::pod_collect_to_vec(bytes.get(10 + length..)?))
}

/// Creates a torus with these numbers of rows and columns of vertices. Its faces are quads, or twice as many triangles. `bump` is the
/// height of its bumps, relative to the minor radius.
pub(crate) fn torus(sides: usize, [rows, columns]: [u32; 2], bump: f64) -> Mesh {
    fn angle(k: u32, n: u32) -> (f64, f64) {
        libm::sincos(std::f64::consts::TAU * f64::from(k) / f64::from(n))
    }
    let quads = (0..rows * columns).map(|k: u32| {
        fn vertex_index(i: u32, j: u32, rows: u32, columns: u32) -> u32 {
            i % rows * columns + j % columns
        }
        let (i, j) = (k / columns, k % columns);
        [
            vertex_index(i, j, rows, columns),
            vertex_index(i, j + 1, rows, columns),
            vertex_index(i + 1, j + 1, rows, columns),
            vertex_index(i + 1, j, rows, columns),
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
