//! Borders of a grid's mesh without the steps of the grid.
//!
//! A short border has no long waves and would shrink to a point, so vertices move less where a face would lose its area. A component of one
//! or two triangles would become a point itself and is left out: nobody sees it, and it makes a solid unprintable.

use maquette_value::parallel::*;
use nalgebra::{Point3, Vector2, Vector3};

use super::grid_triangles::double_area;

/// The vertices along the borders of a mesh of a grid.
pub(crate) struct Border {
    /// Each with the one before it and the one behind it, by index among themselves.
    beside: Vec<[u32; 2]>,
    /// Their indices in the mesh.
    vertices: Vec<u32>,
}

/// Shares of the way to the middle of both neighbors, in turn: Taubin, "A signal processing approach to fair surface design" (1995).
/// Waves shorter than some eight cells are removed, longer ones stay.
const SHARES: [f64; 2] = [0.5, -0.53];

/// Faces that a thread looks at in one go.
const BLOCK: usize = 8192;

/// The least share of its area that a face keeps where its border is smoothed.
const LEAST_AREA: f64 = 1e-3;

/// After so many halvings nothing moves that could be seen.
const MOST_HALVINGS: usize = 32;

impl Border {
    /// The borders of `faces`, each vertex of which is passed by one border at most. `may_be` says which vertices can lie there.
    pub(crate) fn new(faces: &[[u32; 3]], may_be: impl Fn(u32) -> bool) -> Self {
        let mut edges: Vec<[u32; 2]> =
            (faces.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]))
                .filter(|&[from, to]| may_be(from) && may_be(to))
                .collect();
        edges.sort_unstable();
        fn has(edge: [u32; 2], edges: &[[u32; 2]]) -> bool {
            edges.binary_search(&edge).is_ok()
        }
        let alone: Vec<[u32; 2]> =
            edges.iter().copied().filter(|&[a, b]| !has([b, a], &edges)).collect();
        let vertices: Vec<u32> = alone.iter().map(|&[from, _]| from).collect();
        fn index(vertex: u32, vertices: &[u32]) -> Option<usize> {
            vertices.binary_search(&vertex).ok()
        }
        let mut beside = vec![[u32::MAX; 2]; vertices.len()];
        for (from, &[_, to]) in alone.iter().enumerate() {
            let to = index(to, &vertices).expect("a border goes on where it arrives");
            beside[from][1] = to as u32;
            beside[to][0] = from as u32;
        }
        Self { beside, vertices }
    }

    /// Smooths the borders `rounds` times: the vertices' positions, and with them their `places`, column and row in a grid of
    /// `size` = (width, height). No place moves by more than one cell, none on the border of the grid at all, and none so far that one of
    /// the `faces` loses its area: around a hole of one cell, all would move to its middle. The faces that would shrink to a point
    /// themselves, one or two with a border around them, are returned, in order; if there are some, nothing has moved.
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
        for share in (0..rounds).flat_map(|_| SHARES) {
            let next: Vec<_> = self
                .beside
                .iter()
                .zip(&now)
                .map(|(&[before, behind], here): (&[u32; 2], &(_, _))| {
                    let (a, b): &(Vector3<f64>, Vector2<f64>) = here;
                    let ((c, d), (e, f)) = (now[before as usize], now[behind as usize]);
                    (a + ((c + e) / 2.0 - a) * share, b + ((d + f) / 2.0 - b) * share)
                })
                .collect();
            now = next;
            for (now, old) in now.iter_mut().zip(&old).filter(|(_, old)| on_rim(&old.1, size)) {
                *now = *old;
            }
        }
        let mut moves = now;
        for (now, old) in moves.iter_mut().zip(&old) {
            let most = (now.1 - old.1).norm().max(1.0);
            *now = ((now.0 - old.0) / most, (now.1 - old.1) / most);
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

    /// Halves the moves of vertices of faces that would lose their area, until none does; or gives those that are specks, if there are.
    fn keep_areas(
        &self,
        faces: &[[u32; 3]],
        positions: &[Point3<f64>],
        moves: &mut [(Vector3<f64>, Vector2<f64>)],
    ) -> Vec<usize> {
        let mut places = vec![u32::MAX; positions.len()];
        (0..).zip(&self.vertices).for_each(|(k, &vertex)| places[vertex as usize] = k);
        let all = (0..faces.len()).into_par_iter().with_min_len(BLOCK);
        let near: Vec<usize> = all
            .filter(|&face| faces[face].iter().any(|&it| places[it as usize] != u32::MAX))
            .collect();
        for round in 0..MOST_HALVINGS {
            let found: Vec<_> = near
                .iter()
                .copied()
                .filter(|&face| {
                    let old = double_area(faces[face].map(|it| positions[it as usize])).norm();
                    double_area(faces[face].map(|vertex: u32| {
                        let moved = moves.get(places[vertex as usize] as usize);
                        positions[vertex as usize] + moved.map_or(Vector3::zeros(), |moved| moved.0)
                    }))
                    .norm()
                        < LEAST_AREA * old
                })
                .collect();
            if round == 0 {
                let is_speck =
                    |&face: &usize| self.is_speck(faces[face].map(|it| places[it as usize]));
                let specks: Vec<_> = found.iter().copied().filter(is_speck).collect();
                if !specks.is_empty() {
                    return specks;
                }
            }
            let corners = found.into_iter().flat_map(|face| faces[face]);
            let mut corners: Vec<_> = corners.map(|it| places[it as usize]).collect();
            corners.retain(|&place| place != u32::MAX);
            corners.sort_unstable();
            corners.dedup();
            if corners.is_empty() {
                break;
            }
            for place in corners {
                let moved = &mut moves[place as usize];
                *moved = (moved.0 / 2.0, moved.1 / 2.0);
            }
        }
        Vec::new()
    }

    /// Whether the corners of a face, by their places, are all of a border but one at most: that around a triangle or two.
    fn is_speck(&self, corners: [u32; 3]) -> bool {
        let border = std::iter::successors(Some(corners[0]), |place| {
            Some(self.beside.get(*place as usize)?[1])
        })
        .take(5);
        let border = Vec::from_iter(border);
        let end = border[1..].iter().position(|place| *place == border[0]);
        end.is_some() && corners.iter().all(|corner| border.contains(corner))
    }
}
