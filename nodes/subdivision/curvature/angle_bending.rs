//! Curvature from the angles around vertices.

use maquette_value::Mesh;
use nalgebra::{Point3, Vector3};

/// What the angles around a vertex tell.
#[derive(Clone, Copy, Debug, Default)]
pub struct AngleBending {
    /// The angle that is missing to a full turn, at a border to a half one, over the area: the Gaussian curvature.
    pub gaussian: f64,
    /// The mean curvature.
    pub mean: f64,
    /// The area of the surface that is nearest to the vertex.
    pub area: f64,
}

/// The curvature at the vertices of a triangle mesh, from angles and cotangents; 0 at vertices of no area.
///
/// Meyer, Desbrun, Schroeder and Barr, "Discrete differential-geometry operators for triangulated 2-manifolds" (2003), eqs. 8 to
/// 10. The sum of `gaussian * area` over a closed mesh is 2 pi times its Euler characteristic, exactly.
pub fn angle_bending(mesh: &Mesh) -> Vec<AngleBending> {
    let count = mesh.positions().len();
    let (mut angles, mut areas) = (vec![0.0; count], vec![0.0; count]);
    let mut pull = vec![Vector3::zeros(); count];
    for face in mesh.faces().iter() {
        let places = [0, 1, 2].map(|k| mesh.positions()[face[k] as usize]);
        let corners = [0, 1, 2].map(|k| Corner::new(places, k));
        let area = (places[1] - places[0]).cross(&(places[2] - places[0])).norm() / 2.0;
        let obtuse = corners.iter().position(|corner| corner.angle > std::f64::consts::FRAC_PI_2);
        for (k, corner) in corners.iter().enumerate() {
            let vertex = face[k] as usize;
            let [next, last] = [(k + 1) % 3, (k + 2) % 3];
            angles[vertex] += corner.angle;
            areas[vertex] += match obtuse {
                Some(other) if other == k => area / 2.0,
                Some(_) => area / 4.0,
                None => {
                    fn part(
                        to: usize,
                        across: usize,
                        corners: &[Corner; 3],
                        places: &[Point3<f64>; 3],
                        k: usize,
                    ) -> f64 {
                        corners[across].cotangent * (places[to] - places[k]).norm_squared()
                    }
                    (part(next, last, &corners, &places, k)
                        + part(last, next, &corners, &places, k))
                        / 8.0
                }
            };
            for (to, across) in [(next, last), (last, next)] {
                pull[vertex] += (places[k] - places[to]) * corners[across].cotangent;
            }
        }
    }
    let edges = mesh.edges();
    let mut turns = vec![std::f64::consts::TAU; count];
    let borders = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
    borders.flat_map(|(ends, _)| ends).for_each(|&end| turns[end as usize] = std::f64::consts::PI);
    let normals = mesh.vertex_normals();
    let at = |vertex: usize| {
        let area = areas[vertex];
        let determined = area > 0.0;
        if !determined {
            return AngleBending::default();
        }
        let along = pull[vertex] / (2.0 * area);
        let mean = along.norm() / 2.0;
        AngleBending {
            gaussian: (turns[vertex] - angles[vertex]) / area,
            mean: if along.dot(&normals[vertex]) < 0.0 { -mean } else { mean },
            area,
        }
    };
    (0..count).map(at).collect()
}

/// A corner of a triangle.
pub(super) struct Corner {
    angle: f64,
    /// 0 in a triangle without area, which then has no say.
    cotangent: f64,
}

impl Corner {
    fn new(places: [Point3<f64>; 3], k: usize) -> Self {
        let [u, v] = [1, 2].map(|step| places[(k + step) % 3] - places[k]);
        let (sine, cosine) = (u.cross(&v).norm(), u.dot(&v));
        let cotangent = if sine > 0.0 { cosine / sine } else { 0.0 };
        Self { angle: libm::atan2(sine, cosine), cotangent }
    }
}
