//! Corners of faces: collects the corners from a file, and splits vertices whose data differ between faces.

use std::collections::HashMap;

use maquette_value::parallel::check_stop;
use maquette_value::{Attribute, Column, Faces, Mesh, MeshError};

/// Collects the faces of a file. A corner that repeats the previous vertex is dropped; exporters write such corners where a quad has shrunk
/// to a triangle. A face that visits a vertex twice is cut at this vertex into several faces.
#[derive(Default)]
pub(super) struct FaceList {
    sides: Vec<usize>,
    corners: Vec<u32>,
    /// For each remaining corner, its index among all corners that were added.
    origins: Vec<usize>,
    n_given: usize,
    /// The number of faces that are left out because they do not have three different corners.
    thin: usize,
    /// The number of faces that were cut.
    cut: usize,
}

impl FaceList {
    pub(super) fn with_capacity(faces: usize) -> Self {
        Self {
            sides: Vec::with_capacity(faces),
            corners: Vec::with_capacity(3 * faces),
            origins: Vec::with_capacity(3 * faces),
            ..Self::default()
        }
    }

    /// Adds a face. It is cut into several if it visits a vertex twice; faces with fewer than three corners are left out. Returns the
    /// number of faces that were added.
    pub(super) fn push(&mut self, vertices: &[u32]) -> usize {
        check_stop();
        let before = self.corners.len();
        for (k, &vertex) in vertices.iter().enumerate() {
            let predecessor = if k == 0 { vertices.len() - 1 } else { k - 1 };
            if vertices[predecessor] != vertex {
                self.corners.push(vertex);
                self.origins.push(self.n_given + k);
            }
        }
        self.n_given += vertices.len();
        let faces = match self.corners.len() - before {
            0..3 => {
                self.corners.truncate(before);
                self.origins.truncate(before);
                0
            }
            sides if !has_repeated_vertex(&self.corners[before..]) => {
                self.sides.push(sides);
                1
            }
            _ => self.cut(before),
        };
        self.thin += usize::from(faces == 0);
        faces
    }

    /// Cuts the face whose corners begin at index `before` wherever the face visits a vertex twice. Returns the number of resulting faces.
    fn cut(&mut self, before: usize) -> usize {
        let corners = self.corners.split_off(before);
        let origins = self.origins.split_off(before);
        let faces = self.sides.len();
        // `open` has the corners since the last cut, `open_indices` the position of each vertex in `open`.
        let mut open: Vec<(u32, usize)> = Vec::new();
        let mut open_indices = HashMap::new();
        for (vertex, origin) in corners.into_iter().zip(origins) {
            if let Some(&start) = open_indices.get(&vertex) {
                self.push_ring(&open[start..]);
                for (vertex, _) in open.drain(start..) {
                    open_indices.remove(&vertex);
                }
            }
            open_indices.insert(vertex, open.len());
            open.push((vertex, origin));
        }
        self.push_ring(&open);
        let faces = self.sides.len() - faces;
        self.cut += usize::from(faces > 0);
        faces
    }

    /// Adds a face with distinct vertices, each given with its index among all corners. Does nothing if there are fewer than three
    /// vertices.
    fn push_ring(&mut self, ring: &[(u32, usize)]) {
        if ring.len() >= 3 {
            self.sides.push(ring.len());
            self.corners.extend(ring.iter().map(|(vertex, _)| vertex));
            self.origins.extend(ring.iter().map(|(_, origin)| origin));
        }
    }

    /// Returns warnings about the faces added so far.
    pub(super) fn notes(&self) -> Vec<String> {
        let thin = (self.thin > 0).then(|| match self.thin {
            1 => "1 face is left out: it has fewer than three different corners".to_owned(),
            more => {
                format!("{more} faces are left out: they have fewer than three different corners")
            }
        });
        let cut = (self.cut > 0).then(|| match self.cut {
            1 => "1 face visits a vertex twice and is cut there".to_owned(),
            more => format!("{more} faces visit a vertex twice and are cut there"),
        });
        thin.into_iter().chain(cut).collect()
    }

    /// Returns the faces, and for each of their corners its index among all corners that were added.
    pub(super) fn finish(self) -> Result<(Faces, Vec<usize>), MeshError> {
        Ok((Faces::polygons(&self.sides, self.corners)?, self.origins))
    }
}

/// Returns true if a vertex occurs twice.
fn has_repeated_vertex(vertices: &[u32]) -> bool {
    if vertices.len() <= 16 {
        return (1..vertices.len()).any(|k| vertices[..k].contains(&vertices[k]));
    }
    let mut sorted = vertices.to_vec();
    sorted.sort_unstable();
    sorted.windows(2).any(|pair| pair[0] == pair[1])
}

/// Converts data of corners to data of vertices. Returns `None` if the corners of one vertex have different data. Vertices without faces
/// get `none`.
pub(super) fn per_vertex<T: Copy + PartialEq>(
    mesh: &Mesh,
    corners: &[T],
    none: T,
) -> Option<Vec<T>> {
    let mut found = vec![None; mesh.positions().len()];
    for (&vertex, &corner) in mesh.faces().corners().iter().zip(corners) {
        if *found[vertex as usize].get_or_insert(corner) != corner {
            return None;
        }
    }
    Some(found.into_iter().map(|entry| entry.unwrap_or(none)).collect())
}

/// Adds data of corners to a mesh: as vertex data if all corners of each vertex have equal data, else as corner data.
pub(super) fn add_corner_data<T: Copy + PartialEq>(
    mesh: Mesh,
    name: &str,
    corners: Vec<T>,
    none: T,
    attribute: impl Fn(Column<T>) -> Attribute,
) -> Result<Mesh, MeshError> {
    match per_vertex(&mesh, &corners, none) {
        Some(vertices) => mesh.with_vertex(name, attribute(vertices.into())),
        None => mesh.with_corner(name, attribute(corners.into())),
    }
}

/// Groups of corners with equal vertex and equal data, for formats that store data only per vertex.
pub(super) struct Split {
    /// One corner of each group. The groups are in the order in which the faces first use them.
    pub(super) corners: Vec<u32>,
    /// The index of the group to which each corner belongs.
    pub(super) of_corner: Vec<u32>,
}

/// The maximum number of groups at one vertex with which a corner is compared. More groups occur only at the tip of a cone with very many
/// faces, where comparing all of them would take quadratic time. Beyond the limit some equal corners stay in separate groups, which is not
/// visible.
const MAX_GROUPS: usize = 64;

/// Groups the corners of a mesh. Two corners are in one group if they are at the same vertex and `same` returns true for them.
pub(super) fn split(mesh: &Mesh, same: impl Fn(usize, usize) -> bool) -> Split {
    const NONE: u32 = u32::MAX;
    let corners = mesh.faces().corners();
    // The groups at each vertex form a linked list: `first` has the first group of each vertex, `next` the group after each group.
    let mut first = vec![NONE; mesh.positions().len()];
    let mut next: Vec<u32> = Vec::new();
    let mut split = Split { corners: Vec::new(), of_corner: Vec::with_capacity(corners.len()) };
    for (corner, &vertex) in corners.iter().enumerate() {
        let chain = std::iter::successors(Some(first[vertex as usize]), |&group: &u32| {
            next.get(group as usize).copied()
        });
        let found = chain
            .take_while(|&group| group != NONE)
            .take(MAX_GROUPS)
            .find(|&group| same(split.corners[group as usize] as usize, corner));
        split.of_corner.push(found.unwrap_or_else(|| {
            let group = next.len() as u32;
            next.push(first[vertex as usize]);
            first[vertex as usize] = group;
            split.corners.push(corner as u32);
            group
        }));
    }
    split
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn repeated_corners_are_dropped_and_with_them_faces_that_are_lines() {
        let mut faces = FaceList::default();
        faces.push(&[0, 1, 1, 2]);
        faces.push(&[0, 1, 1]);
        faces.push(&[]);
        faces.push(&[3, 2, 1, 3]);
        let (faces, origins) = faces.finish().unwrap();
        assert_eq!(faces.iter().collect::<Vec<_>>(), [[0, 1, 2], [2, 1, 3]]);
        assert_eq!(origins, [0, 1, 3, 8, 9, 10]);
    }

    #[test]
    fn a_face_that_comes_back_to_a_vertex_is_cut_there() {
        let mut faces = FaceList::default();
        assert_eq!(faces.push(&[0, 1, 2, 3, 1, 4]), 2);
        // A face that returns along its own edges is degenerate.
        assert_eq!(faces.push(&[0, 1, 2, 1]), 0);
        assert_eq!(faces.push(&[5, 6, 7]), 1);
        assert_eq!(
            faces.notes(),
            [
                "1 face is left out: it has fewer than three different corners",
                "1 face visits a vertex twice and is cut there",
            ]
        );
        let (faces, origins) = faces.finish().unwrap();
        assert_eq!(faces.iter().collect::<Vec<_>>(), [&[1, 2, 3], &[0, 1, 4], &[5, 6, 7]]);
        assert_eq!(origins, [1, 2, 3, 0, 4, 5, 10, 11, 12]);
    }

    #[test]
    fn corners_with_different_data_are_split() {
        let positions: Vec<_> = (0..4).map(|i| Point3::new(f64::from(i), 0.0, 0.0)).collect();
        let faces = Faces::triangles(vec![[0, 1, 2], [2, 1, 3], [1, 0, 3]]);
        let mesh = Mesh::new(positions, faces).unwrap();
        let data = ['a', 'b', 'c', 'c', 'x', 'd', 'b', 'a', 'd'];
        let split = split(&mesh, |a, b| data[a] == data[b]);
        assert_eq!(split.corners, [0, 1, 2, 4, 5]);
        assert_eq!(split.of_corner, [0, 1, 2, 2, 3, 4, 1, 0, 4]);
        assert_eq!(per_vertex(&mesh, &data, ' '), None);
        let data = ['a', 'b', 'c', 'c', 'b', 'd', 'b', 'a', 'd'];
        assert_eq!(per_vertex(&mesh, &data, ' '), Some(vec!['a', 'b', 'c', 'd']));
    }
}
