//! The points of a surface that texels show.

use maquette_value::Mesh;
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector2, Vector3};

use super::super::atlas::Texels;

/// A point of the surface that a texel shows.
pub(super) struct Spot {
    pub(super) place: Point3<f64>,
    pub(super) normal: Vector3<f64>,
    /// The area of the surface that the texel represents, in mm^2.
    pub(super) area: f64,
}

/// Minimum cosine of the angle between the normal of a face and the normal at one of its vertices on a smooth surface; a smaller cosine
/// indicates a sharp edge.
const EDGE: f64 = 0.75;

impl Spot {
    /// Returns, for each texel, the point of the mesh that it shows. The mesh must have `uv` at its corners.
    pub(super) fn of_all(mesh: &Mesh, texels: &Texels) -> Vec<Self> {
        let (corners, normals) = (mesh.faces().corners(), mesh.vertex_normals());
        let uv = mesh.corner().pairs("uv").expect("texture coordinates");
        texels
            .texels
            .par_iter()
            .with_min_len(4096)
            .map(|texel| {
                let triangle = texels.triangles[texel.triangle as usize];
                let vertices = triangle.map(|it| corners[it as usize] as usize);
                let [a, b, c] = vertices.map(|it| mesh.positions()[it]);
                let double = (b - a).cross(&(c - a));
                let flat = double.try_normalize(0.0).unwrap_or_default();
                let shares = texel.shares();
                let mut normal = Vector3::zeros();
                for (vertex, share) in vertices.iter().zip(shares) {
                    let own = normals[*vertex];
                    normal += share * if own.dot(&flat) < EDGE { flat } else { own };
                }
                let place = a.coords * shares[0] + b.coords * shares[1] + c.coords * shares[2];
                let [s, t, u] = triangle.map(|it| Vector2::from(uv[it as usize]));
                let pixels = (t - s).perp(&(u - s)).abs() * (texels.size * texels.size) as f64;
                let area = if pixels > 0.0 { double.norm() / pixels } else { 0.0 };
                Self {
                    place: place.into(),
                    normal: normal.try_normalize(0.0).unwrap_or(flat),
                    area,
                }
            })
            .collect()
    }
}
