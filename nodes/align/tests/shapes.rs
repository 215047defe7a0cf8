//! Surfaces that the tests scan.

use maquette_scan::Scan;
use maquette_value::{Faces, Mesh};
use nalgebra::{Isometry3, Point3, Vector3};

use crate::motion::move_scan;

/// Creates an asymmetric closed surface: a sphere of radius 40 mm with bumps and dents. `turn` rotates the grid of vertices, but not the
/// shape.
pub(super) fn blob(turn: f64) -> Mesh {
    let bumps = [
        ([0.2, 0.4, 0.9], 9.0, 0.25),
        ([0.9, -0.2, 0.3], 12.0, 0.4),
        ([-0.6, 0.6, 0.5], -7.0, 0.3),
        ([0.4, -0.8, 0.5], 8.0, 0.2),
        ([-0.7, -0.5, 0.5], 11.0, 0.35),
        ([0.3, 0.2, -0.9], -8.0, 0.3),
        ([-0.5, 0.1, -0.8], 10.0, 0.25),
        ([0.7, 0.7, -0.2], 7.0, 0.2),
        ([-0.9, 0.2, -0.1], 6.0, 0.15),
        ([0.6, -0.6, -0.6], 13.0, 0.3),
        ([-0.2, 0.95, -0.2], 9.0, 0.3),
        ([0.1, -0.95, -0.1], -6.0, 0.2),
    ];
    closed_surface(turn, |way| {
        40.0 + bumps
            .map(|(at, height, width): ([f64; 3], f64, f64)| {
                let off = (way - Vector3::from(at).normalize()).norm_squared();
                height * libm::exp(-off / (2.0 * width * width))
            })
            .iter()
            .sum::<f64>()
    })
}

/// Creates a sphere with a radius of 30 mm.
pub(super) fn sphere() -> Scan {
    Scan::Mesh(closed_surface(0.0, |_| 30.0))
}

/// Creates a closed surface around the origin from rings of triangles. `radius` returns the distance of the surface from the origin in a
/// given direction.
fn closed_surface(turn: f64, radius: impl Fn(&Vector3<f64>) -> f64) -> Mesh {
    const RINGS: usize = 90;
    const VERTICES_PER_RING: usize = 150;
    let turned = Isometry3::rotation(Vector3::new(turn, 2.0 * turn, -turn));
    let at = |ring: usize, k: usize| {
        let polar = std::f64::consts::PI * (ring as f64 + 0.5) / RINGS as f64;
        let around = std::f64::consts::TAU * k as f64 / VERTICES_PER_RING as f64;
        let ((sp, cp), (sa, ca)) = (libm::sincos(polar), libm::sincos(around));
        let way = turned * Vector3::new(sp * ca, cp, sp * sa);
        Point3::from(way * radius(&way))
    };
    let positions = (0..RINGS).flat_map(|ring| (0..VERTICES_PER_RING).map(move |k| (ring, k)));
    let positions: Vec<_> = positions.map(|(ring, k)| at(ring, k)).collect();
    fn vertex(ring: usize, k: usize) -> u32 {
        (ring * VERTICES_PER_RING + k % VERTICES_PER_RING) as u32
    }
    let quads = (1..RINGS).flat_map(|ring| (0..VERTICES_PER_RING).map(move |k| (ring, k)));
    let faces = quads.flat_map(|(ring, k)| {
        let [a, b] = [k, k + 1].map(|k| vertex(ring - 1, k));
        let [d, c] = [k, k + 1].map(|k| vertex(ring, k));
        [[a, b, c], [a, c, d]]
    });
    Mesh::new(positions, Faces::triangles(faces.collect())).unwrap()
}

/// Returns the faces whose normals point towards a viewer in the direction `way`.
pub(super) fn seen_from(mesh: &Mesh, way: Vector3<f64>) -> Scan {
    let faces = (0..).zip(mesh.faces().iter());
    fn is_seen(face: &[u32], way: Vector3<f64>, mesh: &Mesh) -> bool {
        mesh.area_vector(face).normalize().dot(&way.normalize()) > 0.3
    }
    let seen = faces.filter(|(_, face)| is_seen(face, way, mesh)).map(|(face, _)| face);
    Scan::Mesh(mesh.select(&seen.collect::<Vec<_>>()))
}

/// A flat square sheet with sides of 60 mm.
pub(super) fn sheet() -> Scan {
    let quads = (0..3660).filter(|k| k % 61 != 60).map(|k| [k, k + 1, k + 62, k + 61]);
    let corners: Vec<_> = quads.flatten().collect();
    let mesh = Mesh::new(
        (0..3721)
            .map(|k: u32| Point3::new(f64::from(k % 61), f64::from(k / 61), 0.0))
            .collect::<Vec<_>>(),
        Faces::uniform(4, corners).unwrap(),
    );
    Scan::Mesh(mesh.unwrap())
}

pub(super) fn move_by(scan: &Scan, motion: &Isometry3<f64>) -> Scan {
    move_scan(scan, &motion.to_homogeneous(), None).unwrap()
}
