//! The parts of a mesh whose faces can be oriented consistently.

use maquette_base::topology::lists::Lists;
use maquette_node::{Error, bail};
use maquette_value::Mesh;
use maquette_value::parallel::StopFlag;

/// The connected parts of a mesh. Two faces are connected if they share an edge that no third face uses.
pub(super) struct Sheets {
    /// For each face, the number of the connected part that contains it.
    pub(super) of_face: Vec<u32>,
    /// Marks the faces that are flipped to make each part consistent: fewer than half of the faces of a part.
    pub(super) is_turned: Vec<bool>,
    /// For each part, true if all of its edges have two faces.
    pub(super) is_closed: Vec<bool>,
    /// The number of edges with more than two faces, and the vertices of the first one; `None` if no edge has more than two faces.
    pub(super) crowded: Option<(usize, [u32; 2])>,
}

impl Sheets {
    /// Finds the connected parts of a mesh, and the faces to reverse so that each part is consistently oriented.
    ///
    /// # Errors
    /// Returns an error if a part is not orientable, such as a Moebius strip.
    pub(super) fn new(mesh: &Mesh) -> Result<Self, Error> {
        let (edges, count) = (mesh.edges(), mesh.faces().len());
        // For each edge, the faces that use it. The flag is true if the face runs along the edge from the vertex with the lower index to
        // the vertex with the higher index.
        let at_edges = Lists::group(edges.vertices.len(), || {
            let mut corner = 0;
            let sides = mesh.faces().iter().zip(0..).flat_map(move |(face, number)| {
                let first = corner;
                corner += face.len();
                (0..face.len()).map(move |k| {
                    let is_up = face[k] < face[(k + 1) % face.len()];
                    (first + k, number << 1 | u32::from(is_up))
                })
            });
            sides.map(|(corner, side)| (edges.of_corner[corner], side))
        });
        let mut of_face = vec![u32::MAX; count];
        let mut is_turned = vec![false; count];
        let mut is_closed = Vec::new();
        let stop = StopFlag::current();
        for start in 0..count {
            if of_face[start] != u32::MAX {
                continue;
            }
            let part = is_closed.len() as u32;
            is_closed.push(true);
            of_face[start] = part;
            let (mut flooded, mut next) = (vec![start], 0);
            let mut torn = Vec::new();
            while let Some(&face) = flooded.get(next) {
                next += 1;
                stop.check();
                let corners = mesh.faces().first_corner(face);
                for corner in corners..corners + mesh.faces().face(face).len() {
                    let edge = edges.of_corner[corner] as usize;
                    let &[a, b] = at_edges.list(edge) else {
                        is_closed[part as usize] = false;
                        continue;
                    };
                    let other = (if (a >> 1) as usize == face { b } else { a } >> 1) as usize;
                    let turns = is_turned[face] ^ (a & 1 == b & 1);
                    if of_face[other] == u32::MAX {
                        of_face[other] = part;
                        is_turned[other] = turns;
                        flooded.push(other);
                    } else if is_turned[other] != turns {
                        torn.push(edge);
                    }
                }
            }
            if let Some(&first) = torn.iter().min() {
                // Each edge with inconsistently oriented faces was counted twice, once from each face.
                let (faces, count) = (flooded.len(), torn.len() / 2);
                let [a, b] = edges.vertices[first];
                let positions = mesh.positions();
                let at = nalgebra::center(&positions[a as usize], &positions[b as usize]);
                bail!(
                    "a part of {faces} faces has only one side, as a Moebius strip has: at {count} of its edges faces cannot agree, at {a} to {b} near ({:.3}, {:.3}, {:.3}) for one; \
                     cut it there, or take the part away by `Pieces`",
                    at.x,
                    at.y,
                    at.z
                );
            }
            if flooded.len() < 2 * flooded.iter().filter(|face| is_turned[**face]).count() {
                flooded.iter().for_each(|&face| is_turned[face] ^= true);
            }
        }
        let many: Vec<_> = (0..edges.faces.len()).filter(|&edge| 2 < edges.faces[edge]).collect();
        let crowded = many.first().map(|&edge| (many.len(), edges.vertices[edge]));
        Ok(Self { of_face, is_turned, is_closed, crowded })
    }
}
