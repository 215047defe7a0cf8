//! The parts of a mesh that a capture sees.

use maquette_base::tree::Tree;
use maquette_range::{GridTriangle, Half, JUMP, Joins, Rays, grid_triangles};
use maquette_value::parallel::*;
use maquette_value::{Mesh, RangeImage, closest_on_triangle};
use nalgebra::Point3;

use super::pitch::Pitch;

/// Maximum distance of a vertex from the surface that the capture shows, in cells.
const MAX_DISTANCE: f64 = 1.5;

/// Maximum angle between the normal of a face and the line of sight, in degrees. Pixels at larger angles show several surfaces.
const MAX_ANGLE: f64 = 75.0;

/// Returns, for each vertex of a mesh in the frame of a capture, the coordinates in the capture's picture at which the capture sees it.
///
/// A vertex is seen if it is within 1.5 cells of the surface that the capture shows, and one of its faces is within 75 degrees of the line
/// of sight. The surface consists of the triangles between neighboring cells that no depth step separates, within the same angle.
pub(super) fn seen_at(mesh: &Mesh, range: &RangeImage) -> Vec<Option<[f64; 2]>> {
    let surface = CapturedSurface::new(range);
    let near: Vec<Option<[f64; 2]>> = mesh
        .positions()
        .par_iter()
        .with_min_len(1024)
        .map(|at| surface.place_near(at).map(|place| range.registration().uv_from_range(place)))
        .collect();
    let faces_sensor = faces_sensor(mesh, range, &near);
    near.into_iter().zip(faces_sensor).map(|(pixel, faces)| pixel.filter(|_| faces)).collect()
}

/// The surface that a capture shows.
struct CapturedSurface<'a> {
    range: &'a RangeImage,
    pitch: Pitch,
    /// The points of the cells, and the cell of each point.
    tree: Tree,
    cells: Vec<u32>,
    /// For each quad of cells, given by its upper left cell, the bits of its triangles.
    halves: Vec<u8>,
}

/// Maximum distance of a point from the nearest cell, in cells: the triangles within [`MAX_ANGLE`] are up to four cells long.
const REACH: f64 = 4.0;

impl<'a> CapturedSurface<'a> {
    fn new(range: &'a RangeImage) -> Self {
        let joins = Joins::new(range, JUMP, MAX_ANGLE);
        let points = range.points();
        let mut halves = vec![0; points.len()];
        for triangle in grid_triangles(
            range.width(),
            range.height(),
            points,
            |quad| range.forced_triangles(quad),
            |_, corners| joins.is_on_surface(corners),
        ) {
            halves[triangle.quad as usize] |= triangle.half.bit();
        }
        let cells: Vec<u32> =
            (0..points.len() as u32).filter(|&cell| range.point(cell as usize).is_some()).collect();
        let known: Vec<Point3<f64>> = cells.iter().map(|&cell| points[cell as usize]).collect();
        Self { range, pitch: Pitch::new(range), tree: Tree::new(&known), cells, halves }
    }

    /// Returns the column and row of the place of the surface nearest to a point; `None` if it is farther than [`MAX_DISTANCE`]. Only the
    /// triangles around the nearest cell are searched.
    fn place_near(&self, at: &Point3<f64>) -> Option<[f64; 2]> {
        let (width, pitch) = (self.range.width(), self.pitch.at(at));
        let cell = self.cells[self.tree.nearest(at, REACH * pitch)?.0] as usize;
        let [column, row] = [cell % width, cell / width];
        let (mut nearest, mut place) = ((MAX_DISTANCE * pitch) * (MAX_DISTANCE * pitch), None);
        for quad_row in row.saturating_sub(1)..=row {
            for quad_column in column.saturating_sub(1)..=column {
                let quad = quad_row * width + quad_column;
                for half in [Half::Adc, Half::Acb, Half::Adb, Half::Bdc] {
                    if self.halves[quad] & half.bit() == 0 {
                        continue;
                    }
                    let corners = GridTriangle { quad: quad as u32, half }.cells(width);
                    let points = corners.map(|corner| self.range.points()[corner]);
                    let (distance_sq, shares) = closest_on_triangle(*at, points);
                    if distance_sq <= nearest {
                        nearest = distance_sq;
                        let mut sum = [0.0; 2];
                        for (corner, share) in corners.into_iter().zip(shares) {
                            sum[0] += share * (corner % width) as f64;
                            sum[1] += share * (corner / width) as f64;
                        }
                        place = Some(sum);
                    }
                }
            }
        }
        place
    }
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
