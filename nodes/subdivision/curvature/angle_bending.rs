//! Curvature from the angles around vertices.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use maquette_base::topology::flat_faces::FlatFaces;
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
///
/// At a border, neither is the curvature of the surface: the angle defect is the turn of the border, and the mean curvature contains its
/// curvature within the surface, which grows as faces become smaller.
pub fn angle_bending(mesh: &Mesh) -> Vec<AngleBending> {
    bend_independent(mesh, &FlatFaces::new(mesh.positions(), &mesh.triangles(), |_, _| true))
}

/// As [`angle_bending`], without the triangles that have no area. The curvature of vertices that depend on others is 0.
pub(super) fn bend_independent(mesh: &Mesh, flat: &FlatFaces) -> Vec<AngleBending> {
    let count = mesh.positions().len();
    let edges = mesh.edges();
    let mut full_angles = vec![TAU; count];
    let borders = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
    borders.flat_map(|(ends, _)| ends).for_each(|&end| full_angles[end as usize] = PI);
    let (mut angles, mut areas) = (vec![0.0; count], vec![0.0; count]);
    let mut pull = vec![Vector3::zeros(); count];
    for (index, face) in mesh.faces().iter().enumerate() {
        let face = [face[0], face[1], face[2]];
        let positions = face.map(|vertex| mesh.positions()[vertex as usize]);
        let corners = [0, 1, 2].map(|k| Corner::new(positions, k));
        for (vertex, angle) in face.into_iter().zip(corner_angles(&corners)) {
            angles[vertex as usize] += angle;
        }
        if flat.is_flat(index) {
            continue;
        }
        let (carrier, fraction) = carrier(face, flat);
        let shares = area_shares(carrier.map(|vertex| mesh.positions()[vertex as usize]));
        for (vertex, area) in carrier.into_iter().zip(shares) {
            areas[vertex as usize] += area * fraction;
        }
        for (k, &vertex) in face.iter().enumerate() {
            let [next, last] = [(k + 1) % 3, (k + 2) % 3];
            for (to, across) in [(next, last), (last, next)] {
                pull[vertex as usize] += (positions[k] - positions[to]) * corners[across].cotangent;
            }
        }
    }
    let mut defects: Vec<f64> =
        full_angles.iter().zip(&angles).map(|(full, sum)| full - sum).collect();
    flat.gather(&mut defects);
    flat.gather(&mut areas);
    flat.gather(&mut pull);
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
                gaussian: defects[vertex] / area,
                mean: if along.dot(&normals[vertex]) < 0.0 { -mean } else { mean },
                area,
            }
        })
        .collect()
}

/// Returns the triangle of independent vertices that contains a triangle, if there is one, and the fraction of its area that the triangle
/// has. Otherwise returns the triangle itself.
fn carrier(face: [u32; 3], flat: &FlatFaces) -> ([u32; 3], f64) {
    let (mut carrier, mut fraction) = (face, 1.0);
    for k in 0..3 {
        match flat.supports(carrier[k]) {
            Some(&[(support, _)]) if !carrier.contains(&support) => carrier[k] = support,
            // The vertex is on the line from another corner to `end`.
            Some(&[a, b]) => {
                for ((corner, _), (end, weight)) in [(a, b), (b, a)] {
                    if carrier.contains(&corner) && !carrier.contains(&end) {
                        carrier[k] = end;
                        fraction *= weight;
                        break;
                    }
                }
            }
            _ => {}
        }
    }
    (carrier, fraction)
}

/// Returns the areas of the parts of a triangle that belong to its corners.
fn area_shares(positions: [Point3<f64>; 3]) -> [f64; 3] {
    let corners = [0, 1, 2].map(|k| Corner::new(positions, k));
    let area = (positions[1] - positions[0]).cross(&(positions[2] - positions[0])).norm() / 2.0;
    let obtuse = corners.iter().position(|corner| corner.angle > FRAC_PI_2);
    [0, 1, 2].map(|k: usize| {
        let [next, last] = [(k + 1) % 3, (k + 2) % 3];
        match obtuse {
            Some(other) if other == k => area / 2.0,
            Some(_) => area / 4.0,
            None => {
                let [a, b] = [(next, last), (last, next)].map(|(to, across)| {
                    corners[across].cotangent * (positions[to] - positions[k]).norm_squared()
                });
                (a + b) / 8.0
            }
        }
    })
}

/// Returns the angles of a triangle. Corners in one place, which have no angle, share what is missing to 180 degrees.
fn corner_angles(corners: &[Corner; 3]) -> [f64; 3] {
    let undefined = corners.iter().filter(|corner| !corner.is_defined).count();
    let missing = PI - corners.iter().map(|corner| corner.angle).sum::<f64>();
    [0, 1, 2].map(
        |k: usize| {
            if corners[k].is_defined { corners[k].angle } else { missing / undefined as f64 }
        },
    )
}

/// A corner of a triangle.
struct Corner {
    angle: f64,
    /// False if another corner is in the same place, so that there is no angle.
    is_defined: bool,
    /// The cotangent of the triangle's angle at the corner; 0 in a triangle without area, which therefore contributes nothing.
    cotangent: f64,
}

impl Corner {
    fn new(positions: [Point3<f64>; 3], k: usize) -> Self {
        let [u, v] = [1, 2].map(|step| positions[(k + step) % 3] - positions[k]);
        let (sine, cosine) = (u.cross(&v).norm(), u.dot(&v));
        let cotangent = if sine > 0.0 { cosine / sine } else { 0.0 };
        let is_defined = sine > 0.0 || cosine != 0.0;
        // The cosine of an undefined angle may be a negative zero.
        let angle = if is_defined { libm::atan2(sine, cosine) } else { 0.0 };
        Self { angle, is_defined, cotangent }
    }
}
