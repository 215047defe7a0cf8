//! The parts of a mesh that a capture sees.

use maquette_node::Error;
use maquette_range::{JUMP, Joins, Rays, grid_triangles};
use maquette_value::parallel::*;
use maquette_value::{Faces, Mesh, RangeImage, TriangleTree};

use super::pitch::Pitch;

/// Maximum distance of a vertex from the surface that the capture shows, in cells.
const MAX_DISTANCE: f64 = 1.5;

/// Maximum angle between the normal of a face and the line of sight, in degrees. Pixels at larger angles show several surfaces.
const MAX_ANGLE: f64 = 75.0;

/// Returns, for each vertex of a mesh in the frame of a capture, the coordinates in the capture's picture at which the capture sees it.
///
/// A vertex is seen if it is within 1.5 cells of the surface that the capture shows, and one of its faces is within 75 degrees of the line
/// of sight. The surface consists of the triangles between neighboring cells that no depth step separates, within the same angle.
///
/// # Errors
/// Returns an error if the grid has more cells than a mesh can hold.
pub(super) fn seen_at(mesh: &Mesh, range: &RangeImage) -> Result<Vec<Option<[f64; 2]>>, Error> {
    let surface = captured_surface(range)?;
    let (width, map) = (range.width(), range.registration());
    let pitch = Pitch::new(range);
    let nearest = TriangleTree::new(&surface).nearest_to_all(mesh.positions());
    let near: Vec<Option<[f64; 2]>> = nearest
        .into_par_iter()
        .zip(mesh.positions().par_iter())
        .map(|(nearest, at)| {
            let nearest = nearest?;
            if nearest.distance_sq.sqrt() > MAX_DISTANCE * pitch.at(at) {
                return None;
            }
            let mut place = [0.0; 2];
            for (corner, share) in nearest.corners.iter().zip(nearest.barycentric) {
                let cell = surface.faces().corners()[*corner as usize] as usize;
                place[0] += share * (cell % width) as f64;
                place[1] += share * (cell / width) as f64;
            }
            Some(map.uv_from_range(place))
        })
        .collect();
    let faces_sensor = faces_sensor(mesh, range, &near);
    Ok(near.into_iter().zip(faces_sensor).map(|(pixel, faces)| pixel.filter(|_| faces)).collect())
}

/// Returns the surface that a capture shows. Its vertices are the cells; those without a point have the position of another.
fn captured_surface(range: &RangeImage) -> Result<Mesh, Error> {
    let (width, height) = (range.width(), range.height());
    let joins = Joins::new(range, JUMP, MAX_ANGLE);
    let triangles = grid_triangles(
        width,
        height,
        range.points(),
        |quad| range.forced_triangles(quad),
        |_, corners| joins.is_on_surface(corners),
    );
    let faces: Vec<[u32; 3]> = triangles
        .par_iter()
        .with_min_len(4096)
        .map(|triangle| triangle.cells(width).map(|cell| cell as u32))
        .collect();
    let any = (0..range.points().len()).find_map(|cell| range.point(cell)).unwrap_or_default();
    let positions: Vec<_> =
        (0..range.points().len()).map(|cell| range.point(cell).unwrap_or(any)).collect();
    Ok(Mesh::new(positions, Faces::triangles(faces))?)
}

/// For each vertex, true if it has no faces, or one of them is within [`MAX_ANGLE`] of the line of sight. The front of the mesh is the side
/// that most of the faces near the capture's surface turn to the sensor.
fn faces_sensor(mesh: &Mesh, range: &RangeImage, near: &[Option<[f64; 2]>]) -> Vec<bool> {
    let rays = Rays::new(range);
    let cosines: Vec<f64> = (0..mesh.faces().len())
        .into_par_iter()
        .with_min_len(1024)
        .map(|number| {
            let face = mesh.faces().face(number);
            let ray = rays.direction(mesh.positions()[face[0] as usize]);
            let normal = mesh.area_vector(face);
            -normal.dot(&ray) / (normal.norm() * ray.norm())
        })
        .collect();
    let (mut front, mut back) = (0, 0);
    for (face, cosine) in mesh.faces().iter().zip(&cosines) {
        if face.iter().all(|&vertex| near[vertex as usize].is_some()) {
            front += usize::from(*cosine > 0.0);
            back += usize::from(*cosine < 0.0);
        }
    }
    let side = if front < back { -1.0 } else { 1.0 };
    let min = libm::cos(MAX_ANGLE.to_radians());
    let (mut has_face, mut is_front) = (vec![false; near.len()], vec![false; near.len()]);
    for (face, cosine) in mesh.faces().iter().zip(cosines) {
        for &vertex in face {
            has_face[vertex as usize] = true;
            is_front[vertex as usize] |= side * cosine >= min;
        }
    }
    has_face.into_iter().zip(is_front).map(|(has_face, front)| front || !has_face).collect()
}
