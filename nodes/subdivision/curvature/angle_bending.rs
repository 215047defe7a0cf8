//! Curvature from the angles around vertices.

use maquette_value::Mesh;
use nalgebra::{Point3, Vector3};

/// The curvature of a triangle mesh at a vertex, computed from the angles around the vertex.
#[derive(Clone, Copy, Debug, Default)]
pub struct AngleBending {
    /// The Gaussian curvature: the angle defect divided by the area. The angle defect is the difference of the angle sum from 360 degrees,
    /// at a border from 180 degrees.
    pub gaussian: f64,
    /// The mean curvature, in 1/mm.
    pub mean: f64,
    /// The area, in mm^2, of the part of the surface that is nearer to this vertex than to other vertices.
    pub area: f64,
}

/// Computes the curvature at the vertices of a triangle mesh from angles and cotangents. The curvature is 0 at a vertex whose faces have no
/// area.
///
/// Meyer, Desbrun, Schroeder and Barr, "Discrete differential-geometry operators for triangulated 2-manifolds" (2003), eqs. 8 to
/// 10. The sum of `gaussian * area` over a closed mesh is 2 pi times its Euler characteristic, exactly.
pub fn angle_bending(mesh: &Mesh) -> Vec<AngleBending> {
    let count = mesh.positions().len();
    let (mut angles, mut areas) = (vec![0.0; count], vec![0.0; count]);
    let mut pull = vec![Vector3::zeros(); count];
    for face in mesh.faces().iter() {
        let positions = [0, 1, 2].map(|k| mesh.positions()[face[k] as usize]);
        let corners = [0, 1, 2].map(|k| Corner::new(positions, k));
        let area = (positions[1] - positions[0]).cross(&(positions[2] - positions[0])).norm() / 2.0;
        let obtuse = corners.iter().position(|corner| corner.angle > std::f64::consts::FRAC_PI_2);
        for (k, corner) in corners.iter().enumerate() {
            let vertex = face[k] as usize;
            let [next, last] = [(k + 1) % 3, (k + 2) % 3];
            angles[vertex] += corner.angle;
            areas[vertex] += match obtuse {
                Some(other) if other == k => area / 2.0,
                Some(_) => area / 4.0,
                None => {
                    let [a, b] = [(next, last), (last, next)].map(|(to, across)| {
                        corners[across].cotangent * (positions[to] - positions[k]).norm_squared()
                    });
                    (a + b) / 8.0
                }
            };
            for (to, across) in [(next, last), (last, next)] {
                pull[vertex] += (positions[k] - positions[to]) * corners[across].cotangent;
            }
        }
    }
    let edges = mesh.edges();
    let mut full_angles = vec![std::f64::consts::TAU; count];
    let borders = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
    borders
        .flat_map(|(ends, _)| ends)
        .for_each(|&end| full_angles[end as usize] = std::f64::consts::PI);
    let normals = mesh.vertex_normals();
    (0..count)
        .map(|vertex| {
            let area = areas[vertex];
            // The comparison is also false if the area is NaN.
            let is_determined = area > 0.0;
            if !is_determined {
                return AngleBending::default();
            }
            let along = pull[vertex] / (2.0 * area);
            let mean = along.norm() / 2.0;
            AngleBending {
                gaussian: (full_angles[vertex] - angles[vertex]) / area,
                mean: if along.dot(&normals[vertex]) < 0.0 { -mean } else { mean },
                area,
            }
        })
        .collect()
}

/// A corner of a triangle.
pub(super) struct Corner {
    angle: f64,
    /// The cotangent of the triangle's angle at the corner; 0 in a triangle without area, which therefore contributes nothing.
    cotangent: f64,
}

impl Corner {
    fn new(positions: [Point3<f64>; 3], k: usize) -> Self {
        let [u, v] = [1, 2].map(|step| positions[(k + step) % 3] - positions[k]);
        let (sine, cosine) = (u.cross(&v).norm(), u.dot(&v));
        let cotangent = if sine > 0.0 { cosine / sine } else { 0.0 };
        Self { angle: libm::atan2(sine, cosine), cotangent }
    }
}
