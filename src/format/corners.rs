//! Corners of faces: collecting them from a file, and telling vertices apart that carry different data at different faces.

use std::collections::HashMap;

use maquette_value::{Attribute, Column, Faces, Mesh, MeshError};

/// The faces of a file, collected one by one and cleaned of corners that repeat the vertex before them: exporters write such
/// corners where a quad has shrunk to a triangle. A face that comes back to a vertex is cut there into several.
#[derive(Default)]
pub(super) struct FaceList {
    sides: Vec<usize>,
    corners: Vec<u32>,
    /// For each corner kept, its index among all corners that the file has.
    origins: Vec<usize>,
    seen: usize,
    /// Faces without three different corners, which are left out.
    thin: usize,
    /// Faces that were cut.
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

    /// Adds a face, as one or, if it comes back to a vertex, several; those of fewer than three corners are left out. Says how many there are.
    pub(super) fn push(&mut self, vertices: &[u32]) -> usize {
        let before = self.corners.len();
        for (k, &vertex) in vertices.iter().enumerate() {
            let predecessor = if k == 0 { vertices.len() - 1 } else { k - 1 };
            if vertices[predecessor] != vertex {
                self.corners.push(vertex);
                self.origins.push(self.seen + k);
            }
        }
        self.seen += vertices.len();
        let faces = match self.corners.len() - before {
            0..3 => {
                self.corners.truncate(before);
                self.origins.truncate(before);
                0
            }
            sides if !repeats(&self.corners[before..]) => {
                self.sides.push(sides);
                1
            }
            _ => self.cut(before),
        };
        self.thin += usize::from(faces == 0);
        faces
    }

    /// Cuts the face whose corners begin at `before` wherever it comes back to a vertex. Says how many faces that makes.
    fn cut(&mut self, before: usize) -> usize {
        let corners = self.corners.split_off(before);
        let origins = self.origins.split_off(before);
        let faces = self.sides.len();
        // The corners since the last cut, and where each vertex is among them.
        let mut open: Vec<(u32, usize)> = Vec::new();
        let mut places = HashMap::new();
        for (vertex, origin) in corners.into_iter().zip(origins) {
            if let Some(&start) = places.get(&vertex) {
                self.push_ring(&open[start..]);
                for (vertex, _) in open.drain(start..) {
                    places.remove(&vertex);
                }
            }
            places.insert(vertex, open.len());
            open.push((vertex, origin));
        }
        self.push_ring(&open);
        let faces = self.sides.len() - faces;
        self.cut += usize::from(faces > 0);
        faces
    }

    /// Adds a face of these vertices and origins, which are all different, unless they are fewer than three.
    fn push_ring(&mut self, ring: &[(u32, usize)]) {
        if ring.len() >= 3 {
            self.sides.push(ring.len());
            self.corners.extend(ring.iter().map(|(vertex, _)| vertex));
            self.origins.extend(ring.iter().map(|(_, origin)| origin));
        }
    }

    /// What a user should know of the faces so far.
    pub(super) fn notes(&self) -> Vec<String> {
        let thin = (self.thin > 0).then(|| match self.thin {
            1 => "1 face is left out: it has fewer than three different corners".to_owned(),
            more => {
                format!("{more} faces are left out: they have fewer than three different corners")
            }
        });
        let cut = (self.cut > 0).then(|| match self.cut {
            1 => "1 face meets a vertex twice, and is cut there".to_owned(),
            more => format!("{more} faces meet a vertex twice, and are cut there"),
        });
        thin.into_iter().chain(cut).collect()
    }

    /// The faces, and for each corner its index among all corners that were given.
    pub(super) fn finish(self) -> Result<(Faces, Vec<usize>), MeshError> {
        Ok((Faces::polygons(&self.sides, self.corners)?, self.origins))
    }
}

/// Whether a vertex is there twice.
fn repeats(vertices: &[u32]) -> bool {
    if vertices.len() <= 16 {
        return (1..vertices.len()).any(|k| vertices[..k].contains(&vertices[k]));
    }
    let mut sorted = vertices.to_vec();
    sorted.sort_unstable();
    sorted.windows(2).any(|pair| pair[0] == pair[1])
}

/// The data of corners as data of vertices, if no vertex has two different ones; `none` for a vertex of no face.
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

/// Adds the data of corners to a mesh: per vertex where that loses nothing.
pub(super) fn with_corners<T: Copy + PartialEq>(
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

/// Corners that share a vertex and its data, as formats know them that have data per vertex only.
pub(super) struct Split {
    /// One corner out of each group, in the order in which the faces meet them.
    pub(super) corners: Vec<u32>,
    /// The group of each corner.
    pub(super) of_corner: Vec<u32>,
}

/// How many groups at one vertex are compared with a corner. More are met only at the tip of a cone with very many faces, where
/// without a limit the time would grow with their square; with it some equal corners are not joined, which shows nowhere.
const MOST_GROUPS: usize = 64;

/// Groups the corners of a mesh by vertex; two corners at one vertex stay together if `same` says so.
pub(super) fn split(mesh: &Mesh, same: impl Fn(usize, usize) -> bool) -> Split {
    const NONE: u32 = u32::MAX;
    let corners = mesh.faces().corners();
    // The groups at a vertex are chained: its first one, and the next one of each.
    let mut first = vec![NONE; mesh.positions().len()];
    let mut next: Vec<u32> = Vec::new();
    let mut split = Split { corners: Vec::new(), of_corner: Vec::with_capacity(corners.len()) };
    for (corner, &vertex) in corners.iter().enumerate() {
        let chain = std::iter::successors(Some(first[vertex as usize]), |&group: &u32| {
            next.get(group as usize).copied()
        });
        let found = chain
            .take_while(|&group| group != NONE)
            .take(MOST_GROUPS)
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
        // There and back is no face.
        assert_eq!(faces.push(&[0, 1, 2, 1]), 0);
        assert_eq!(faces.push(&[5, 6, 7]), 1);
        assert_eq!(
            faces.notes(),
            [
                "1 face is left out: it has fewer than three different corners",
                "1 face meets a vertex twice, and is cut there",
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
