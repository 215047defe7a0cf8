//! Continues a projected picture over the parts of a mesh that the capture does not see.

use maquette_base::linear::membrane::Membrane;
use maquette_base::topology::union_find::UnionFind;
use maquette_node::{Error, Progress};
use maquette_range::{JUMP, MAX_SHADOW_CELLS, fill_range};
use maquette_value::parallel::ParallelSliceMut;
use maquette_value::{Attribute, Image, Mesh, RangeImage};
use nalgebra::Point3;

use super::capture_grid::CaptureGrid;
use super::hidden_faces::paint_hidden_faces;
use super::pitch::Pitch;
use super::visibility::seen_at;

/// A textured mesh, and what the capture does not see of it.
pub(super) struct Continuation {
    pub(super) mesh: Mesh,
    pub(super) unseen: Unseen,
}

/// The parts of a mesh that have other colors than the capture's picture shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Unseen {
    /// None, or parts that have grown out of what the picture shows.
    Nothing,
    /// The number of faces with colors of their own, and the center of the first one.
    Faces(usize, Point3<f64>),
    /// The whole mesh, whose texture coordinates are unchanged.
    Everything,
}

/// Replaces the texture coordinates of vertices that the capture does not see: a projection would show on them whatever is in front or
/// behind. They become those of a membrane between the seen vertices, so that what has grown out of the capture keeps its picture. If
/// `is_registered`, the texture coordinates are those of the capture's picture. Then faces get colors of their own if another part of the
/// mesh or of the capture is in their place in the picture.
///
/// # Errors
/// Returns an error if the evaluation is cancelled.
pub(super) fn continue_texture(
    mesh: Mesh,
    image: &Image,
    range: &RangeImage,
    is_registered: bool,
    progress: &Progress<'_>,
) -> Result<Continuation, Error> {
    let Some(projected) = mesh.vertex().pairs("uv").cloned() else {
        return Ok(Continuation { mesh, unseen: Unseen::Nothing });
    };
    let range = fill_range(range, MAX_SHADOW_CELLS, JUMP, progress)?;
    let seen = seen_at(&mesh, &range);
    if seen.iter().all(Option::is_none) {
        return Ok(Continuation { mesh, unseen: Unseen::Everything });
    }
    let grid = CaptureGrid::new(&range);
    let mut known: Vec<Option<[f64; 3]>> = seen
        .iter()
        .zip(projected.iter())
        .map(|(&seen, &projected)| {
            let seen = seen?;
            // The projection has no perspective. Across a depth step, it would show another surface.
            let is_own = !is_registered || grid.is_connected(seen, projected);
            let [u, v] = if is_own { projected } else { seen };
            Some([u, v, 0.0])
        })
        .collect();
    Membrane::around(&mesh, |vertex| seen[vertex as usize].is_none()).fill(&mut known, progress)?;
    let uv: Vec<Option<[f64; 2]>> =
        known.into_iter().map(|it| it.map(|[u, v, _]| [u, v])).collect();
    if is_registered {
        let is_seen: Vec<bool> = seen.iter().map(Option::is_some).collect();
        let hidden = HiddenParts::new(&mesh, &grid, &Pitch::new(&range), &uv, &is_seen);
        if let Some(first) = hidden.faces.iter().position(|is_hidden| *is_hidden) {
            let count = hidden.faces.iter().filter(|is_hidden| **is_hidden).count();
            let corners = mesh.faces().face(first);
            let sum = corners.iter().map(|&vertex| mesh.positions()[vertex as usize].coords);
            let center = Point3::from(sum.sum::<nalgebra::Vector3<f64>>() / corners.len() as f64);
            let shown = uv.into_iter().zip(projected.iter()).zip(&hidden.vertices);
            let shown: Vec<Option<[f64; 2]>> = shown
                .map(|((uv, projected), is_hidden)| {
                    (!is_hidden).then_some(uv.unwrap_or(*projected))
                })
                .collect();
            let mesh = paint_hidden_faces(&mesh, image, &shown, &hidden.faces, progress)?;
            return Ok(Continuation { mesh, unseen: Unseen::Faces(count, center) });
        }
    }
    let uv = uv.iter().zip(projected.iter()).map(|(uv, projected)| uv.unwrap_or(*projected));
    let uv: Vec<[f64; 2]> = uv.collect();
    let mesh = mesh.with_vertex("uv", Attribute::Pair(uv.into()))?;
    Ok(Continuation { mesh, unseen: Unseen::Nothing })
}

/// Number of cells around the seen vertices at the rim of an unseen part that both may show.
const MARGIN: u32 = 2;

/// Minimum area in square cells of a part with colors of its own. Smaller parts, at depth steps, are as narrow as the pixels that mix the
/// colors on both sides; they keep the mesh's texture coordinates at its vertices, and the picture as it is.
const MIN_AREA: f64 = 16.0;

/// The parts of a mesh in whose place in the picture something else is shown.
struct HiddenParts {
    vertices: Vec<bool>,
    faces: Vec<bool>,
}

impl HiddenParts {
    /// Finds the parts. An unseen part has grown out of the capture, and is not hidden, if its cells are connected to those of the seen
    /// vertices around it, without a depth step, and no seen part of the mesh shows them.
    fn new(
        mesh: &Mesh,
        grid: &CaptureGrid<'_>,
        pitch: &Pitch,
        uv: &[Option<[f64; 2]>],
        is_seen: &[bool],
    ) -> Self {
        let places: Vec<[f64; 2]> = uv.iter().map(|uv| uv.unwrap_or([f64::NAN; 2])).collect();
        let shown = grid
            .shown_cells(mesh, &places, |face| face.iter().all(|&vertex| is_seen[vertex as usize]));
        let mut hidden =
            Self { vertices: vec![false; uv.len()], faces: vec![false; mesh.faces().len()] };
        // The number of the last part that reached each cell, counted from 1.
        let mut reached = vec![0_u32; grid.count()];
        for (number, part) in (1..).zip(unseen_parts(mesh, is_seen)) {
            let mut needed = Vec::new();
            let mut seeds = Vec::new();
            for &face in &part {
                let corners = mesh.faces().face(face as usize);
                let place: Vec<[f64; 2]> =
                    corners.iter().map(|&vertex| places[vertex as usize]).collect();
                grid.visit_cells(&place, |cell| needed.extend(cell));
                let rim =
                    corners.iter().zip(&place).filter(|(vertex, _)| is_seen[**vertex as usize]);
                seeds.extend(rim.filter_map(|(_, &uv)| grid.cell(uv)));
            }
            needed.sort_unstable();
            needed.dedup();
            seeds.iter().for_each(|&cell| reached[cell] = number);
            grid.flood(&seeds, |cell, distance| {
                let is_new = reached[cell] != number
                    && (distance <= MARGIN || !shown[cell])
                    && needed.binary_search(&cell).is_ok();
                if is_new {
                    reached[cell] = number;
                }
                is_new
            });
            let is_reached = |cell: Option<usize>| cell.is_some_and(|cell| reached[cell] == number);
            let (mut faces, mut vertices, mut area) = (Vec::new(), Vec::new(), 0.0);
            for face in part {
                let corners = mesh.faces().face(face as usize);
                let place: Vec<[f64; 2]> =
                    corners.iter().map(|&vertex| places[vertex as usize]).collect();
                let mut is_hidden = false;
                grid.visit_cells(&place, |cell| is_hidden |= !is_reached(cell));
                if is_hidden {
                    let cell = pitch.at(&mesh.positions()[corners[0] as usize]);
                    area += mesh.area_vector(corners).norm() / (cell * cell);
                    faces.push(face);
                }
                let of_corners = corners.iter().zip(place);
                let hidden = of_corners.filter(|(vertex, uv)| {
                    !is_seen[**vertex as usize] && !is_reached(grid.cell(*uv))
                });
                vertices.extend(hidden.map(|it| *it.0));
            }
            if area >= MIN_AREA {
                faces.into_iter().for_each(|face| hidden.faces[face as usize] = true);
                vertices.into_iter().for_each(|vertex| hidden.vertices[vertex as usize] = true);
            }
        }
        hidden
    }
}

/// Returns the faces that have an unseen vertex, grouped: those of a group are connected by unseen vertices.
fn unseen_parts(mesh: &Mesh, is_seen: &[bool]) -> Vec<Vec<u32>> {
    let mut parts = UnionFind::new(is_seen.len());
    for face in mesh.faces().iter() {
        let mut unseen = face.iter().filter(|&&vertex| !is_seen[vertex as usize]);
        if let Some(&first) = unseen.next() {
            unseen.for_each(|&other| parts.union(first, other));
        }
    }
    let mut faces: Vec<(u32, u32)> = (0..)
        .zip(mesh.faces().iter())
        .filter_map(|(number, face)| {
            let unseen = face.iter().find(|&&vertex| !is_seen[vertex as usize])?;
            Some((parts.find(*unseen), number))
        })
        .collect();
    faces.par_sort_unstable();
    faces.chunk_by(|a, b| a.0 == b.0).map(|part| part.iter().map(|it| it.1).collect()).collect()
}

#[cfg(test)]
mod tests {
    use maquette_value::{Faces, Pinhole};
    use nalgebra::Vector3;

    use super::*;

    const BLUE: [u8; 3] = [20, 40, 250];

    /// The color of a wall: without blue, and different everywhere.
    fn wall_color(at: Point3<f64>) -> [f64; 3] {
        [128.0 + 4.0 * at.x, 128.0 + 4.0 * at.y, 0.0]
    }

    /// True for points of a block in front of the wall, at a depth of 70 mm.
    fn is_block(at: Point3<f64>) -> bool {
        at.x.abs() < 5.0 && (at.y - 2.0).abs() < 4.0
    }

    /// A capture of a blue block in front of a wall at a depth of 100 mm, with its picture, which has a pixel for each cell.
    fn capture() -> (RangeImage, Image) {
        let camera = Pinhole { focal: [160.0; 2], center: [40.0, 30.0] };
        let (mut points, mut pixels) = (Vec::new(), Vec::new());
        for cell in 0..81 * 61 {
            let pixel = [f64::from(cell % 81), f64::from(cell / 81)];
            let near = camera.unproject(pixel, 70.0);
            let wall = camera.unproject(pixel, 100.0);
            points.push(if is_block(near) { near } else { wall });
            let color = wall_color(wall).map(|channel| channel.round() as u8);
            pixels.push(if is_block(near) { BLUE } else { color });
        }
        let range = RangeImage::new(81, 61, points).unwrap().with_camera(Some(camera));
        (range, Image::new(81, 61, pixels).unwrap())
    }

    /// A plane at a depth of 0 of squares with a side of `edge`, which looks to the sensor.
    fn plane(edge: f64, half: [i32; 2]) -> Mesh {
        let columns = (2 * half[0] + 1) as u32;
        let positions = (-half[1]..=half[1]).flat_map(|row| {
            (-half[0]..=half[0]).map(move |column| {
                Point3::new(f64::from(column) * edge, f64::from(row) * edge, 0.0)
            })
        });
        let quads = (0..2 * half[1] as u32)
            .flat_map(|row| (0..columns - 1).map(move |column| row * columns + column));
        let faces = quads.flat_map(|a| {
            let [b, c, d] = [a + 1, a + columns + 1, a + columns];
            [[a, c, b], [a, d, c]]
        });
        Mesh::new(positions.collect::<Vec<_>>(), Faces::triangles(faces.collect())).unwrap()
    }

    fn moved(mesh: &Mesh, by: Vector3<f64>) -> Mesh {
        mesh.with_positions(mesh.positions().iter().map(|at| at + by).collect::<Vec<_>>()).unwrap()
    }

    /// Projects the picture onto a mesh as the capture's camera sees it at 100 mm.
    fn project(mesh: &Mesh, range: &RangeImage) -> Mesh {
        let camera = range.camera().unwrap();
        let uv = mesh.positions().iter().map(|at| {
            let cell = camera.project(Point3::new(at.x, at.y, 100.0));
            range.registration().uv_from_range(cell)
        });
        let uv: Vec<[f64; 2]> = uv.collect();
        mesh.clone().with_vertex("uv", Attribute::Pair(uv.into())).unwrap()
    }

    /// Calls `check` with places in the faces of a textured mesh, and the color that each shows.
    fn each_texel(mesh: &Mesh, image: &Image, mut check: impl FnMut(Point3<f64>, [f64; 3])) {
        let image = mesh.texture().unwrap_or(image);
        let corners = mesh.faces().corners();
        let of_corners = mesh.corner().pairs("uv").cloned();
        let of_vertices = mesh.vertex().pairs("uv").cloned();
        for first in (0..corners.len()).step_by(3) {
            for shares in [[0.9, 0.05, 0.05], [0.05, 0.9, 0.05], [0.3, 0.3, 0.4], [0.5, 0.0, 0.5]] {
                let (mut at, mut uv) = (Vector3::zeros(), [0.0; 2]);
                for (corner, share) in (first..).zip(shares) {
                    at += mesh.positions()[corners[corner] as usize].coords * share;
                    let own = match (&of_corners, &of_vertices) {
                        (Some(uv), _) => uv[corner],
                        (None, Some(uv)) => uv[corners[corner] as usize],
                        _ => panic!("a textured mesh has coordinates"),
                    };
                    (0..2).for_each(|k| uv[k] += share * own[k]);
                }
                check(at.into(), image.sample(uv));
            }
        }
    }

    fn continued(mesh: &Mesh) -> Continuation {
        let (range, image) = capture();
        continue_texture(project(mesh, &range), &image, &range, true, &Progress::silent()).unwrap()
    }

    #[test]
    fn what_a_block_hides_has_colors_of_the_wall() {
        let (range, image) = capture();
        let camera = range.camera().unwrap();
        for edge in [0.4, 1.1] {
            let half = [24.0, 18.0].map(|size: f64| (size / edge) as i32);
            let wall = moved(&plane(edge, half), Vector3::new(0.1, 0.07, 100.0));
            let continued = continued(&wall);
            let Unseen::Faces(count, _) = continued.unseen else { panic!("{edge}") };
            let (mut seen, mut hidden) = (0, 0);
            each_texel(&continued.mesh, &image, |at, color| {
                let pixel = camera.project(at);
                // Faces at the outline of the block show it partly, and pixels mix with their neighbors.
                let around: [bool; 9] = std::array::from_fn(|k| {
                    let reach = 1.5 + edge / 100.0 * 160.0;
                    let off = [k % 3, k / 3].map(|step| reach * (step as f64 - 1.0));
                    is_block(camera.unproject([pixel[0] + off[0], pixel[1] + off[1]], 70.0))
                });
                if around == [false; 9] {
                    let truth = wall_color(at);
                    let error = (0..3).map(|k| (color[k] - truth[k]).abs()).fold(0.0, f64::max);
                    assert!(error <= 4.0, "{edge} {at}: {color:?}, truth {truth:?}");
                    seen += 1;
                } else if around == [true; 9] {
                    assert!(color[2] <= 10.0, "{edge} {at}: {color:?}");
                    hidden += 1;
                }
            });
            assert!(count > 20 && seen > 1000 && hidden > 100, "{edge}: {count} {seen} {hidden}");
        }
    }

    #[test]
    fn the_back_of_a_board_does_not_show_its_front() {
        let front = moved(&plane(0.5, [12, 10]), Vector3::new(14.0, -9.0, 99.5));
        let back = moved(&front, Vector3::new(0.0, 0.0, 9.0));
        let (n_front, n_faces) = (front.positions().len() as u32, front.faces().len());
        let turned = back.faces().corners().chunks(3).map(|it| [it[0], it[2], it[1]]);
        let turned = turned.map(|it| it.map(|vertex| vertex + n_front));
        let faces = front.faces().corners().chunks(3).map(|it| [it[0], it[1], it[2]]);
        let sides: Vec<[u32; 2]> = front
            .faces()
            .iter()
            .flat_map(|it| (0..3).map(move |k| [it[k], it[(k + 1) % 3]]))
            .collect();
        let rim = sides
            .iter()
            .filter(|[a, b]| !sides.contains(&[*b, *a]))
            .flat_map(|&[a, b]| [[b, a, a + n_front], [b, a + n_front, b + n_front]]);
        let faces: Vec<[u32; 3]> = faces.chain(turned).chain(rim).collect();
        let positions: Vec<_> =
            front.positions().iter().chain(back.positions().iter()).copied().collect();
        let board = Mesh::new(positions, Faces::triangles(faces)).unwrap();
        let continued = continued(&board);
        let Unseen::Faces(count, _) = continued.unseen else { panic!("{:?}", continued.unseen) };
        assert!(count >= n_faces * 9 / 10, "{count} of {n_faces}");
        let uv = continued.mesh.corner().pairs("uv").unwrap();
        let picture = 61.0 / continued.mesh.texture().unwrap().height() as f64;
        let shows_front = uv.iter().filter(|uv| 1.0 - uv[1] <= picture).count();
        assert!(shows_front <= 3 * (board.faces().len() - count), "{shows_front}");
    }

    #[test]
    fn what_has_grown_in_front_of_others_keeps_its_picture() {
        let half = [50, 36];
        let wall = moved(&plane(0.4, half), Vector3::new(0.0, 0.0, 100.0));
        let center = Point3::new(12.0, -8.0, 100.0);
        let positions = wall.positions().iter().map(|at| {
            let share = (1.0 - (at - center).norm_squared() / 25.0).max(0.0);
            // To the left, before the block.
            at + share * Vector3::new(-9.0, 6.0, -20.0)
        });
        let grown = wall.with_positions(positions.collect::<Vec<_>>()).unwrap();
        let (_, image) = capture();
        let continued = continued(&grown);
        let before: Vec<_> = wall.positions().to_vec();
        let mut n_grown = 0;
        let continued = continued.mesh.with_positions(before).unwrap();
        each_texel(&continued, &image, |at, color| {
            if (at - center).norm() < 5.0 {
                let shown = [0, 1].map(|k| (color[k] - 128.0) / 4.0);
                let off = libm::hypot(shown[0] - center.x, shown[1] - center.y);
                assert!(color[2] < 10.0 && off <= 6.0, "{at}: {color:?} of {shown:?}");
                n_grown += 1;
            }
        });
        assert!(n_grown > 100);
    }

    #[test]
    fn a_mesh_elsewhere_is_left_as_it_is() {
        let elsewhere = moved(&plane(1.0, [3, 3]), Vector3::new(0.0, 0.0, 500.0));
        let continued = continued(&elsewhere);
        assert_eq!(continued.unseen, Unseen::Everything);
        let projected = project(&elsewhere, &capture().0);
        assert_eq!(continued.mesh.vertex().pairs("uv"), projected.vertex().pairs("uv"));
    }
}
