//! A fast path: the limit masks of closed triangle or quad meshes without creases.
//!
//! Most meshes are closed and without creases. If the faces of each vertex form one closed ring, the mesh is manifold, so no search for
//! edges is needed. All other meshes are left to the general rules, which also report errors.

use maquette_base::linear::stencils::Stencils;
use maquette_value::parallel::*;

use super::catmull_clark::CatmullClarkMasks;
use super::loop_masks::LoopMasks;
use super::vertex_rings::Masks;
use crate::Scheme;
use crate::limit::dual_limit::alpha;
use crate::refine::topology::Topology;

/// The maximum number of face corners at a vertex for this fast path. The search for the next corner of a ring takes time proportional to
/// the number of corners.
const MAX_VALENCE: usize = 64;

/// The number of vertices per parallel task.
const BLOCK: usize = 1024;

/// Computes the limit masks of all vertices; `None` if the mesh is not a closed triangle or quad mesh without creases.
pub(crate) fn closed_rows(topology: &Topology) -> Option<Stencils> {
    let sides = topology.faces.sides().filter(|sides| (3..=4).contains(sides))?;
    let scheme = topology.rules.scheme;
    let dropped = scheme.is_dual();
    let wanted = if scheme.needs_triangles() { 3 } else { 4 };
    if scheme == Scheme::Butterfly || sides != wanted || !(topology.creases.is_empty() || dropped) {
        return None;
    }
    let corners = &topology.faces.corners()[..];
    let fans = Fans::new(corners, topology.vertices)?;
    let per_corner = sides - 2;
    let row = |vertex: usize| vertex + per_corner * fans.starts[vertex] as usize;
    let entries = row(topology.vertices);
    let masks: Vec<_> = (0..=fans.max_valence).map(|n| mask(scheme, n)).collect();
    let (mut indices, mut weights) = (vec![0u32; entries], vec![0.0; entries]);
    let mut jobs = Vec::with_capacity(topology.vertices.div_ceil(BLOCK));
    let (mut rest, mut rest_of_weights) = (&mut indices[..], &mut weights[..]);
    for first in (0..topology.vertices).step_by(BLOCK) {
        let end = topology.vertices.min(first + BLOCK);
        let count = row(end) - row(first);
        let parts = (rest.split_off_mut(..count)?, rest_of_weights.split_off_mut(..count)?);
        jobs.push((first..end, parts));
    }
    let is_closed = jobs.into_par_iter().all(|(vertices, (indices, weights))| {
        let first = row(vertices.start);
        vertices.into_iter().all(|vertex| {
            let (own, to) = (fans.corners(vertex), row(vertex) - first..row(vertex + 1) - first);
            let (to, weights) = (&mut indices[to.clone()], &mut weights[to]);
            let (beside, across) = weights[1..].split_at_mut(own.len());
            let mask = masks[own.len()];
            beside.fill(mask[1]);
            across.fill(mask[2]);
            (to[0], weights[0]) = (vertex as u32, mask[0]);
            match sides {
                3 => ring::<3>(corners, own, &mut to[1..]),
                _ => ring::<4>(corners, own, &mut to[1..]),
            }
        })
    });
    let starts = (0..=topology.vertices).map(|vertex| row(vertex) as u32).collect();
    is_closed.then(|| Stencils::from_parts(starts, indices, weights))
}

/// Writes the neighbors of a vertex counter-clockwise, followed by the corners of its quads that are opposite the vertex. Returns true if
/// the faces at the vertex form one closed ring.
fn ring<const SIDES: usize>(corners: &[u32], own: &[u32], to: &mut [u32]) -> bool {
    let n = own.len();
    let mut ends = [[0u32; 3]; MAX_VALENCE];
    for (ends, &corner) in ends.iter_mut().zip(own) {
        let (face, index) = (corner as usize / SIDES * SIDES, corner as usize % SIDES);
        *ends = [1, 2, SIDES - 1].map(|step| corners[face + (index + step) % SIDES]);
    }
    let ends = &ends[..n];
    let mut at = 0;
    for index in 0..n {
        let [next, across, previous] = ends[at];
        to[index] = next;
        if SIDES == 4 {
            to[n + index] = across;
        }
        let Some(after) = ends.iter().position(|ends| ends[0] == previous) else { return false };
        at = after;
        // The ring of faces must return to the first corner after visiting all other corners, and not earlier.
        if (at == 0) != (index + 1 == n) {
            return false;
        }
    }
    true
}

/// Returns the limit mask of a vertex with `n` neighbors as three weights: of the vertex itself, of each neighbor, and of each quad corner
/// opposite the vertex.
fn mask(scheme: Scheme, n: usize) -> [f64; 3] {
    let n = n.max(1);
    match scheme {
        Scheme::Loop => LoopMasks.limit(n),
        // The vertices are limit points.
        Scheme::Butterfly => [1.0, 0.0, 0.0],
        Scheme::CatmullClark => {
            let [own, neighbor, face] = CatmullClarkMasks.limit(n);
            let corner = face / 4.0;
            [(0..n).fold(own, |own, _| own + corner), neighbor + corner + corner, corner]
        }
        Scheme::DooSabin => {
            let share = 1.0 / n as f64;
            let [own, beside, across] = [0, 1, 2].map(|k| share * alpha(k, 4));
            [(1..n).fold(own, |sum, _| sum + own), beside + beside, across]
        }
    }
}

/// The face corners at each vertex.
struct Fans {
    starts: Vec<u32>,
    corners: Vec<u32>,
    /// The maximum number of corners at a vertex.
    max_valence: usize,
}

impl Fans {
    /// Finds the corners at each vertex. Returns `None` if a vertex has fewer than three or more than `MAX_VALENCE` corners.
    fn new(corners: &[u32], vertices: usize) -> Option<Self> {
        let mut starts = vec![0u32; vertices + 1];
        corners.iter().for_each(|&vertex| starts[vertex as usize] += 1);
        let most = starts.iter().copied().max().unwrap_or(0) as usize;
        if MAX_VALENCE < most || starts[..vertices].iter().any(|&count| count < 3) {
            return None;
        }
        // Corners are inserted backwards, so the corners of each vertex are in ascending order.
        let mut sum = 0;
        for start in &mut starts {
            sum += *start;
            *start = sum;
        }
        let mut sorted = vec![0u32; corners.len()];
        for (corner, &vertex) in (0..corners.len() as u32).zip(corners).rev() {
            let start = &mut starts[vertex as usize];
            *start -= 1;
            sorted[*start as usize] = corner;
        }
        Some(Self { starts, corners: sorted, max_valence: most })
    }

    fn corners(&self, vertex: usize) -> &[u32] {
        &self.corners[self.starts[vertex] as usize..self.starts[vertex + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::{Faces, Mesh};
    use nalgebra::Point3;

    use super::*;
    use crate::limit::limit_rows::Limit;
    use crate::refine::without_border::select_faces;
    use crate::rules::Rules;
    use crate::shapes::{cube, octahedron, prism, sphere, tetrahedron, torus};
    use crate::{Boundary, Creases};

    fn topology(mesh: &Mesh, scheme: Scheme) -> Topology {
        let (boundary, creases) = (Boundary::EdgeAndCorner, Creases::OpenSubdiv);
        Topology {
            rules: Rules { scheme, boundary, creases },
            vertices: mesh.positions().len(),
            faces: mesh.faces().clone(),
            creases: mesh.creases().collect(),
        }
    }

    #[test]
    fn the_rows_are_those_of_the_general_rules() {
        let triangles = [tetrahedron(), octahedron(), sphere(2), torus(7, 5, true)];
        let quads = [cube(), torus(7, 5, false)];
        let of_quads = [Scheme::CatmullClark, Scheme::DooSabin]
            .into_iter()
            .flat_map(|scheme| quads.iter().map(move |mesh| (scheme, mesh)));
        for (scheme, mesh) in triangles.iter().map(|mesh| (Scheme::Loop, mesh)).chain(of_quads) {
            let topology = topology(mesh, scheme);
            let rows = closed_rows(&topology).unwrap();
            let general = Limit::new(&topology).unwrap().positions;
            for vertex in 0..topology.vertices {
                fn dense(rows: &Stencils, vertex: usize, vertices: usize) -> Vec<f64> {
                    let mut dense = vec![0.0; vertices];
                    let (indices, weights) = rows.row(vertex);
                    let entries = indices.iter().zip(weights);
                    entries.for_each(|(&k, weight)| dense[k as usize] += weight);
                    dense
                }
                for (a, b) in dense(&rows, vertex, topology.vertices).into_iter().zip(dense(
                    &general,
                    vertex,
                    topology.vertices,
                )) {
                    assert!((a - b).abs() < 1e-15, "{scheme:?} {vertex} {a} {b}");
                }
            }
        }
    }

    #[test]
    fn meshes_that_are_not_closed_smooth_and_manifold_are_rejected() {
        fn skips_vertices(mesh: &Mesh, scheme: Scheme) -> bool {
            closed_rows(&topology(mesh, scheme)).is_none()
        }
        let open = select_faces(&sphere(1), &(1..80).collect::<Vec<_>>()).unwrap();
        assert!(skips_vertices(&open, Scheme::Loop));
        assert!(skips_vertices(&sphere(1).with_creases([([0, 12], 2.0)]).unwrap(), Scheme::Loop));
        assert!(skips_vertices(&prism(5), Scheme::CatmullClark));
        assert!(skips_vertices(&sphere(1), Scheme::CatmullClark));
        fn shape(triangles: Vec<[u32; 3]>) -> Mesh {
            Mesh::new(vec![Point3::origin(); 7], Faces::triangles(triangles)).unwrap()
        }
        let whole = tetrahedron().faces().as_triangles().unwrap().to_vec();
        let other = whole.iter().map(|face| face.map(|k| if k == 0 { 0 } else { k + 3 }));
        let joined = shape(whole.iter().copied().chain(other).collect());
        assert!(skips_vertices(&joined, Scheme::Loop), "two that share a vertex");
        let mut turned = whole.clone();
        turned[0].reverse();
        turned.extend([[4, 5, 6], [4, 6, 5]]);
        assert!(skips_vertices(&shape(turned), Scheme::Loop));
    }
}
