//! Ensures the minimum thickness of the wall between a cavity and the outer surface of a solid.

use maquette_base::topology::union_find::UnionFind;
use maquette_node::{CancelledError, Progress};
use maquette_value::{Edges, TriangleTree};
use nalgebra::{Point3, Vector3, center};

use super::sheets::Sheet;
use crate::contour::Contour;

/// Maximum number of rounds in which vertices move. More rounds do not improve a cavity that was extracted from a grid.
const ROUNDS: usize = 8;

/// Allowed deficit of a wall's thickness, as a fraction of the thickness.
const CLOSE: f64 = 1e-3;

/// Maximum motion of a vertex along its grid edge, as a fraction of the edge. Several vertices may move toward the same grid node. With a
/// limit below 1 the vertices never coincide, so their faces keep an area.
const FARTHEST: f64 = 0.9;

/// Number of points whose distances are measured between two checks for cancellation. Measuring this many points takes some milliseconds,
/// and employs eight threads.
const CHUNK: usize = 16_384;

/// What a cavity must keep its distance from.
pub(super) struct Walls<'a> {
    /// The outer surface, which must be at least `thickness` mm away.
    pub(super) skin: &'a TriangleTree,
    /// The middle surface of the sheets between cavities, which must be at least half of that away.
    pub(super) sheet: Option<&'a Sheet>,
    pub(super) thickness: f64,
}

impl Walls<'_> {
    /// Returns for each point the thickness in mm that the wall lacks there; negative where it is thicker.
    fn lacks(&self, points: &[Point3<f64>]) -> Vec<f64> {
        let skin = self.skin.nearest_to_all(points).into_iter();
        let mut lacks: Vec<f64> = skin
            .map(|it| self.thickness - it.map_or(f64::INFINITY, |it| it.distance_sq.sqrt()))
            .collect();
        if let Some(sheet) = self.sheet {
            for (point, distance) in sheet.distances(points, self.thickness / 2.0) {
                lacks[point] = lacks[point].max(self.thickness / 2.0 - distance);
            }
        }
        lacks
    }
}

/// The thickness that the wall lacks at the vertices of a contour, then at the middles of its edges, then at those of its faces.
struct Lacks {
    edges: Edges,
    vertex_count: usize,
    values: Vec<f64>,
    /// True for the values that must be measured again, as a vertex has moved. Vertices move deeper into the solid, so that a wall which is
    /// thick enough stays so.
    is_stale: Vec<bool>,
}

impl Lacks {
    fn new(edges: Edges, contour: &Contour) -> Self {
        let count = contour.points.len() + edges.vertices.len() + contour.triangles.len();
        let vertex_count = contour.points.len();
        Self { edges, vertex_count, values: vec![0.0; count], is_stale: vec![true; count] }
    }

    /// Returns the indices of the values at the corners of a face, at the middles of its edges and at its own middle.
    fn indices(&self, face: usize, [a, b, c]: [u32; 3]) -> [usize; 7] {
        let edges = [0, 1, 2].map(|k| self.edges.of_corner[3 * face + k] as usize);
        let [ab, bc, ca] = edges.map(|edge| self.vertex_count + edge);
        let middle = self.vertex_count + self.edges.vertices.len() + face;
        [a as usize, b as usize, c as usize, ab, bc, ca, middle]
    }

    fn point(&self, index: usize, contour: &Contour) -> Point3<f64> {
        let at = |vertex: u32| contour.points[vertex as usize];
        let edge = index.wrapping_sub(self.vertex_count);
        if index < self.vertex_count {
            return contour.points[index];
        }
        if let Some([a, b]) = self.edges.vertices.get(edge) {
            return center(&at(*a), &at(*b));
        }
        let [a, b, c] = contour.triangles[edge - self.edges.vertices.len()].map(at);
        Point3::from((a.coords + b.coords + c.coords) / 3.0)
    }

    /// Measures the stale values.
    fn measure(
        &mut self,
        contour: &Contour,
        walls: &Walls<'_>,
        progress: &Progress<'_>,
    ) -> Result<(), CancelledError> {
        let stale: Vec<usize> =
            (0..self.values.len()).filter(|&index| self.is_stale[index]).collect();
        for chunk in stale.chunks(CHUNK) {
            progress.check()?;
            let points: Vec<_> = chunk.iter().map(|&index| self.point(index, contour)).collect();
            for (&index, lack) in chunk.iter().zip(walls.lacks(&points)) {
                (self.values[index], self.is_stale[index]) = (lack, false);
            }
        }
        Ok(())
    }

    /// Returns the thickness that the wall lacks at a face, in mm.
    fn of_face(&self, face: usize, contour: &Contour) -> f64 {
        let indices = self.indices(face, contour.triangles[face]);
        indices.iter().map(|&index| self.values[index]).fold(f64::NEG_INFINITY, f64::max)
    }
}

/// Moves vertices of a cavity deeper into the solid where the wall behind the cavity's faces is too thin. A vertex moves along its grid
/// edge only, so faces never intersect. Thin walls occur because distances are known at grid nodes only, and because the cavity has flat
/// faces where the surface has a concave edge. `edges` are those of the contour.
///
/// Returns the thickness in mm that the wall still lacks at each face.
pub(super) fn keep_walls(
    contour: &mut Contour,
    edges: Edges,
    walls: &Walls<'_>,
    progress: &Progress<'_>,
) -> Result<Vec<f64>, CancelledError> {
    let mut of_points = Lacks::new(edges, contour);
    // The faces at which the thickness of the wall must be measured. A measurement stays valid until a corner of the face moves.
    let mut open = Vec::from_iter(0..contour.triangles.len());
    let starts = contour.points.clone();
    // For each vertex, the distance by which the vertex has moved along its grid edge, as a fraction of the edge.
    let mut gone = vec![0.0; starts.len()];
    for _ in 0..ROUNDS {
        of_points.measure(contour, walls, progress)?;
        let mut lacks = vec![0.0; contour.points.len()];
        for &face in &open {
            let lack = of_points.of_face(face, contour);
            for vertex in contour.triangles[face] {
                lacks[vertex as usize] = lack.max(lacks[vertex as usize]);
            }
        }
        let mut moves = vec![false; lacks.len()];
        for (vertex, &lack) in lacks.iter().enumerate().filter(|it| CLOSE * walls.thickness < *it.1)
        {
            let (end, depth) = contour.deep_ends[vertex];
            moves[vertex] = gone[vertex] < FARTHEST;
            gone[vertex] = f64::min(gone[vertex] + lack / depth, FARTHEST);
            contour.points[vertex] = starts[vertex] + (end - starts[vertex]) * gone[vertex];
        }
        open = (0..contour.triangles.len())
            .filter(|&face| contour.triangles[face].iter().any(|&vertex| moves[vertex as usize]))
            .collect();
        for &face in &open {
            let corners = contour.triangles[face].map(|vertex| moves[vertex as usize]);
            let [a, b, c] = corners;
            let moved = [a, b, c, a || b, b || c, c || a, true];
            for (index, moved) in
                of_points.indices(face, contour.triangles[face]).into_iter().zip(moved)
            {
                let is_lacking = CLOSE * walls.thickness < of_points.values[index];
                of_points.is_stale[index] |= moved && is_lacking;
            }
        }
        if open.is_empty() {
            break;
        }
    }
    of_points.measure(contour, walls, progress)?;
    Ok((0..contour.triangles.len()).map(|face| of_points.of_face(face, contour)).collect())
}

/// Returns for each face of a contour true if its connected surface encloses at least `least` mm^3.
pub(super) fn find_large_cavities(contour: &Contour, least: f64) -> Vec<bool> {
    let mut skins = UnionFind::new(contour.points.len());
    for &[a, b, c] in &contour.triangles {
        skins.union(a, b);
        skins.union(a, c);
    }
    let mut volumes = vec![0.0; contour.points.len()];
    for &corners in &contour.triangles {
        let skin = skins.find(corners[0]) as usize;
        let near = contour.points[skin];
        let [a, b, c]: [Vector3<f64>; 3] =
            corners.map(|vertex| contour.points[vertex as usize] - near);
        volumes[skin] += a.dot(&b.cross(&c)) / 6.0;
    }
    let corners = contour.triangles.iter().map(|corners| corners[0]);
    corners.map(|corner| least <= volumes[skins.find(corner) as usize].abs()).collect()
}
