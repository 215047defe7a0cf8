//! Smooths the borders of a mesh made from a range grid, to remove the steps of the grid.
//!
//! A filter removes short waves. The long steps of a border that is nearly parallel to the rows or columns remain; parabolas remove them
//! ([`super::closed_line`]).
//!
//! Smoothing keeps only long waves, so a short border would shrink to a point; therefore vertices move less where a face would lose its
//! area. A component of one or two triangles would shrink as a whole, and is left out of the mesh: it is not visible, and makes a solid
//! unprintable.

use maquette_value::parallel::*;
use nalgebra::{Point3, Vector2, Vector3};

use super::closed_line::ClosedLine;
use super::grid_triangles::double_area;

/// The vertices along the borders of a mesh made from a range grid.
pub(crate) struct Border {
    /// For each border vertex, the previous and the next vertex along the border, as indices into `vertices`.
    neighbors: Vec<[u32; 2]>,
    /// The indices in the mesh of the border vertices.
    vertices: Vec<u32>,
}

/// The factors, used alternately, by which a vertex moves towards the midpoint of its two neighbors: Taubin, "A signal processing approach
/// to fair surface design" (1995). Waves shorter than about eight cells are removed, longer ones stay.
const FACTORS: [f64; 2] = [0.5, -0.53];

/// Maximum distance of the vertices of a border from a parabola that straightens them, in cells. The filter leaves steps of about a third
/// of a cell.
const STRAIGHT: f64 = 0.6;

/// The tolerance of positions, as a multiple of that of places in the grid.
const DEPTH: f64 = 3.0;

/// The number of faces that one task processes.
const BLOCK: usize = 8192;

/// When the border of the mesh is smoothed, each face must keep at least this fraction of its area, measured along its old normal. So no
/// face is turned over.
const MIN_AREA_RATIO: f64 = 1e-3;

/// The maximum number of halvings of a vertex's motion. Motions that remain after 32 halvings are too small to be visible.
const MAX_HALVINGS: usize = 32;

impl Border {
    /// Finds the borders of `faces`. At most one border may pass through each vertex. `may_be` returns true for vertices that can be on a
    /// border; other vertices are not examined.
    pub(crate) fn new(faces: &[[u32; 3]], may_be: impl Fn(u32) -> bool) -> Self {
        let mut edges: Vec<[u32; 2]> =
            (faces.iter().until_stopped().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]))
                .filter(|&[from, to]| may_be(from) && may_be(to))
                .collect();
        edges.par_sort_unstable();
        fn has(edge: [u32; 2], edges: &[[u32; 2]]) -> bool {
            edges.binary_search(&edge).is_ok()
        }
        let alone: Vec<[u32; 2]> =
            edges.iter().copied().filter(|&[a, b]| !has([b, a], &edges)).collect();
        let vertices: Vec<u32> = alone.iter().map(|&[from, _]| from).collect();
        fn index(vertex: u32, vertices: &[u32]) -> Option<usize> {
            vertices.binary_search(&vertex).ok()
        }
        let mut neighbors = vec![[u32::MAX; 2]; vertices.len()];
        for (from, &[_, to]) in alone.iter().enumerate() {
            let to = index(to, &vertices).expect("a border continues at each vertex");
            neighbors[from][1] = to as u32;
            neighbors[to][0] = from as u32;
        }
        Self { neighbors, vertices }
    }

    /// Smooths the borders `rounds` times. This moves the positions of the vertices, and their `places`: column and row in a grid of `size`
    /// = (width, height). No vertex moves by more than one cell, and no vertex on the border of the grid moves. No vertex moves so far that
    /// one of the `faces` loses its area, as could happen around a hole of one cell. Returns the indices of the faces that would shrink to
    /// a point (one or two faces with a border around them), ascending; if there are any, no vertex moves.
    pub(crate) fn smooth(
        &self,
        rounds: u32,
        size: [usize; 2],
        faces: &[[u32; 3]],
        positions: &mut [Point3<f64>],
        places: &mut [[f64; 2]],
    ) -> Vec<usize> {
        if rounds == 0 || self.vertices.is_empty() {
            return Vec::new();
        }
        let old: Vec<(Vector3<f64>, Vector2<f64>)> = self
            .vertices
            .iter()
            .map(|&vertex| {
                let vertex = vertex as usize;
                (positions[vertex].coords, Vector2::from(places[vertex]))
            })
            .collect();
        fn on_rim(place: &Vector2<f64>, size: [usize; 2]) -> bool {
            (0..2).any(|k| place[k] == 0.0 || place[k] + 1.0 == size[k] as f64)
        }
        let mut now = old.clone();
        for factor in (0..rounds).flat_map(|_| FACTORS) {
            let next: Vec<_> = self
                .neighbors
                .iter()
                .zip(&now)
                .map(|(&[previous, following], here): (&[u32; 2], &(_, _))| {
                    let (a, b): &(Vector3<f64>, Vector2<f64>) = here;
                    let ((c, d), (e, f)) = (now[previous as usize], now[following as usize]);
                    (a + ((c + e) / 2.0 - a) * factor, b + ((d + f) / 2.0 - b) * factor)
                })
                .collect();
            now = next;
            for (now, old) in now.iter_mut().zip(&old).filter(|(_, old)| on_rim(&old.1, size)) {
                *now = *old;
            }
        }
        self.straighten(&mut now);
        for (now, old) in now.iter_mut().zip(&old).filter(|(_, old)| on_rim(&old.1, size)) {
            *now = *old;
        }
        let mut moves = now;
        for (now, old) in moves.iter_mut().zip(&old) {
            let length = (now.1 - old.1).norm().max(1.0);
            *now = ((now.0 - old.0) / length, (now.1 - old.1) / length);
        }
        let specks = self.keep_areas(faces, positions, &mut moves);
        if !specks.is_empty() {
            return specks;
        }
        for ((&vertex, moved), old) in self.vertices.iter().zip(moves).zip(old) {
            positions[vertex as usize] = Point3::from(old.0 + moved.0);
            places[vertex as usize] = (old.1 + moved.1).into();
        }
        Vec::new()
    }

    /// Moves the vertices of each border, given by positions and places in the grid, to parabolas that fit it within half a cell.
    fn straighten(&self, vertices: &mut [(Vector3<f64>, Vector2<f64>)]) {
        for border in self.loops() {
            let places: Vec<[f64; 2]> = border.iter().map(|&k| vertices[k].1.into()).collect();
            let line = ClosedLine::new(&places);
            // Positions are measured in cells, too, by the mean size of a cell along the border, with a higher tolerance: where the sensor
            // sees a surface at a grazing angle, a step of one cell along its edge is a step of several cells in depth.
            let positions = border.iter().map(|&k| vertices[k].0);
            let sides = positions.clone().zip(positions.cycle().skip(1));
            let size = sides.map(|(a, b)| (b - a).norm()).sum::<f64>() / line.length() * DEPTH;
            let all: Vec<[f64; 5]> = border
                .iter()
                .map(|&k| {
                    let (position, [column, row]) = (vertices[k].0 / size, vertices[k].1.into());
                    [column, row, position.x, position.y, position.z]
                })
                .collect();
            let points = (0..border.len()).into_par_iter().with_min_len(64);
            let mut reaches: Vec<f64> =
                points.map(|k: usize| line.reach(k, &all, STRAIGHT)).collect();
            line.even_out(&mut reaches);
            let points = (0..border.len()).into_par_iter().with_min_len(64);
            let moved: Vec<Option<[f64; 5]>> = points
                .map(|k: usize| {
                    let parabola = line.fit(k, reaches[k], &all).filter(|_| reaches[k] > 0.0);
                    parabola.map(|parabola| parabola.at(0.0))
                })
                .collect();
            for (&k, moved) in border.iter().zip(moved) {
                if let Some([column, row, x, y, z]) = moved {
                    vertices[k] = (Vector3::new(x, y, z) * size, Vector2::new(column, row));
                }
            }
        }
    }

    /// Returns the borders: the indices of the vertices of each, in order.
    fn loops(&self) -> Vec<Vec<usize>> {
        let mut visited = vec![false; self.vertices.len()];
        let mut loops = Vec::new();
        for start in 0..self.vertices.len() {
            let mut border = Vec::new();
            let mut k = start;
            while !visited[k] {
                visited[k] = true;
                border.push(k);
                k = self.neighbors[k][1] as usize;
            }
            if !border.is_empty() {
                loops.push(border);
            }
        }
        loops
    }

    /// Halves the motions of the vertices of faces that would lose their area, until none would. If there are specks (components of one or
    /// two faces, which would shrink to a point), returns their faces instead.
    fn keep_areas(
        &self,
        faces: &[[u32; 3]],
        positions: &[Point3<f64>],
        moves: &mut [(Vector3<f64>, Vector2<f64>)],
    ) -> Vec<usize> {
        let mut border_indices = vec![u32::MAX; positions.len()];
        (0..).zip(&self.vertices).for_each(|(k, &vertex)| border_indices[vertex as usize] = k);
        let all = (0..faces.len()).into_par_iter().with_min_len(BLOCK);
        let nearby_faces: Vec<usize> = all
            .filter(|&face| faces[face].iter().any(|&it| border_indices[it as usize] != u32::MAX))
            .collect();
        for round in 0..MAX_HALVINGS {
            let found: Vec<_> = nearby_faces
                .iter()
                .copied()
                .filter(|&face| {
                    let old = double_area(faces[face].map(|it| positions[it as usize]));
                    let new = double_area(faces[face].map(|vertex: u32| {
                        let moved = moves.get(border_indices[vertex as usize] as usize);
                        positions[vertex as usize] + moved.map_or(Vector3::zeros(), |moved| moved.0)
                    }));
                    new.dot(&old) < MIN_AREA_RATIO * old.norm_squared()
                })
                .collect();
            if round == 0 {
                let specks: Vec<_> = found
                    .iter()
                    .copied()
                    .filter(|&face| {
                        self.is_speck(faces[face].map(|it| border_indices[it as usize]))
                    })
                    .collect();
                if !specks.is_empty() {
                    return specks;
                }
            }
            let corners = found.into_iter().flat_map(|face| faces[face]);
            let mut corners: Vec<_> = corners.map(|it| border_indices[it as usize]).collect();
            corners.retain(|&index| index != u32::MAX);
            corners.sort_unstable();
            corners.dedup();
            if corners.is_empty() {
                break;
            }
            for index in corners {
                let moved = &mut moves[index as usize];
                *moved = (moved.0 / 2.0, moved.1 / 2.0);
            }
        }
        Vec::new()
    }

    /// Returns true if a face belongs to a component of one or two triangles: all its corners are on one border of three or four vertices.
    /// Corners are indices into `vertices`.
    fn is_speck(&self, corners: [u32; 3]) -> bool {
        let border = std::iter::successors(Some(corners[0]), |index| {
            Some(self.neighbors.get(*index as usize)?[1])
        })
        .take(5);
        let border: Vec<_> = border.collect();
        let end = border[1..].iter().position(|index| *index == border[0]);
        end.is_some() && corners.iter().all(|corner| border.contains(corner))
    }
}
