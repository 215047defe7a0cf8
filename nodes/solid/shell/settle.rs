//! The closed layer between two motions of a surface, without self-intersections.

use maquette_node::{Error, Progress, bail};
use maquette_value::{Bounds, BoxTree, Mesh};

use super::backs::{Backs, Motion};
use super::layer::RETREAT;
use crate::extended::ExtendedMesh;

/// Maximum number of rounds in which heights are reduced where a layer intersects itself.
const ROUNDS: usize = 60;

impl Backs<'_> {
    /// Returns the closed layer between the surface, or its motion by `front`, and its motion by `back`. Heights and shifts are reduced
    /// until the layer does not intersect itself.
    ///
    /// # Errors
    /// Returns an error if the surface intersects itself, or folds over itself at a vertex.
    pub(super) fn settle(
        &self,
        front: &mut Option<Motion>,
        back: &mut Motion,
        progress: &Progress<'_>,
    ) -> Result<Mesh, Error> {
        let mut layer = self.layer(front.as_ref(), back)?;
        let mut crossing = layer.crossings(|| progress.check())?;
        for round in 0..ROUNDS {
            progress.tick(round as f64 / ROUNDS as f64)?;
            if crossing.is_empty() {
                return Ok(layer);
            }
            let faces = self.mesh.faces().len() as u32;
            let mut is_tight = [vec![false; self.first.len()], vec![false; self.first.len()]];
            for [a, b] in crossing {
                // The first faces of the layer are those of the surface, which do not move.
                if front.is_none() && b < faces || round + 1 == ROUNDS {
                    let at = layer.first_triangle_center(layer.faces().face(a as usize));
                    bail!(
                        "the surface intersects itself or folds over itself near ({:.3}, {:.3}, {:.3}), where face {} is; use `Smooth` there, or `Reconstruct` to make one surface of it",
                        at.x,
                        at.y,
                        at.z,
                        self.face_of(a)
                    );
                }
                for face in [a, b] {
                    let (of_front, of_back) = self.backs_of(face);
                    of_front.iter().for_each(|&back| is_tight[0][back as usize] = true);
                    of_back.iter().for_each(|&back| is_tight[1][back as usize] = true);
                }
            }
            let [of_front, of_back] = is_tight;
            if let Some(front) = front {
                self.retreat_motion(front, of_front);
            }
            self.retreat_motion(back, of_back);
            let last = std::mem::replace(&mut layer, self.layer(front.as_ref(), back)?);
            crossing = crossings_after(&last, &layer, progress)?;
        }
        unreachable!("the last round returns")
    }

    fn retreat_motion(&self, motion: &mut Motion, is_tight: Vec<bool>) {
        for (shift, _) in motion.shifts.iter_mut().zip(&is_tight).filter(|it| *it.1) {
            *shift *= RETREAT;
        }
        self.retreat(&mut motion.heights, is_tight);
    }

    /// Returns the face of the surface from which a face of the layer was made.
    fn face_of(&self, face: u32) -> u32 {
        let count = self.mesh.faces().len() as u32;
        match face / count {
            0 | 1 => face % count,
            _ => self.sides[self.borders[(face - 2 * count) as usize / 2] as usize].face,
        }
    }

    /// Returns the back vertices of the front and of the back of a face of a layer.
    fn backs_of(&self, face: u32) -> (Vec<u32>, Vec<u32>) {
        let count = self.mesh.faces().len();
        fn backs(face: usize, of_corner: &[u32], mesh: &Mesh) -> Vec<u32> {
            let first = mesh.faces().first_corner(face);
            of_corner[first..first + mesh.faces().face(face).len()].to_vec()
        }
        match face as usize {
            face if face < count => (backs(face, &self.of_corner, self.mesh), Vec::new()),
            face if face < 2 * count => {
                (Vec::new(), backs(face - count, &self.of_corner, self.mesh))
            }
            face => {
                let side = self.borders[(face - 2 * count) / 2];
                let backs = self.sides[side as usize].backs.to_vec();
                (backs.clone(), backs)
            }
        }
    }

    /// Returns the layer: its front, its back, and two triangles for each side of a border.
    fn layer(&self, front: Option<&Motion>, back: &Motion) -> Result<Mesh, Error> {
        let mesh = self.mesh;
        let faces = mesh.faces();
        let mut layer = match front {
            None => ExtendedMesh::new(mesh),
            Some(_) => ExtendedMesh::without_elements(mesh),
        };
        let front: Vec<u32> = match front {
            None => (0..self.first.len()).map(|back| self.vertex(back)).collect(),
            Some(front) => {
                let moved = self.moved(front).into_iter().enumerate();
                moved.map(|(back, at)| layer.add_vertex(at, self.vertex(back))).collect()
            }
        };
        let back: Vec<u32> = {
            let moved = self.moved(back).into_iter().enumerate();
            moved.map(|(back, at)| layer.add_vertex(at, self.vertex(back))).collect()
        };
        fn corners(face: usize, faces: &maquette_value::Faces) -> std::ops::Range<u32> {
            let first = faces.first_corner(face);
            first as u32..(first + faces.face(face).len()) as u32
        }
        let place =
            |of: &[u32], corner: u32| [of[self.of_corner[corner as usize] as usize], corner];
        if !layer.has_faces() {
            for face in 0..faces.len() {
                layer.add_face(
                    corners(face, faces).map(|corner| place(&front, corner)),
                    face as u32,
                );
            }
        }
        for face in 0..faces.len() {
            layer.add_face(
                corners(face, faces).rev().map(|corner| place(&back, corner)),
                face as u32,
            );
        }
        for side in self.borders.iter().map(|&side| &self.sides[side as usize]) {
            let [a, b] = side.corners;
            let wall = [place(&front, b), place(&front, a), place(&back, a), place(&back, b)];
            layer.add_face([0, 1, 2].map(|k: usize| wall[k]), side.face);
            layer.add_face([0, 2, 3].map(|k: usize| wall[k]), side.face);
        }
        Ok(layer.mesh()?)
    }
}

/// Returns the pairs of faces of a layer that cross. Before some of its vertices moved, only faces at such vertices crossed others.
fn crossings_after(
    last: &Mesh,
    layer: &Mesh,
    progress: &Progress<'_>,
) -> Result<Vec<[u32; 2]>, Error> {
    let has_moved = |face: &[u32]| {
        face.iter().any(|&it| last.positions()[it as usize] != layer.positions()[it as usize])
    };
    let bounds = |face: &[u32]| {
        let corners: Vec<_> = face.iter().map(|&it| layer.positions()[it as usize]).collect();
        Bounds::from_points(&corners)
    };
    let moved: Vec<bool> = layer.faces().iter().map(has_moved).collect();
    let of_moved = layer.faces().iter().zip(&moved).filter(|it| *it.1).map(|it| bounds(it.0));
    let boxes = BoxTree::new(of_moved);
    let near = layer.faces().iter().zip(&moved).map(|(face, moved)| {
        let mut is_near = *moved;
        if !is_near {
            boxes.visit_overlapping(&bounds(face), |_| is_near = true);
        }
        is_near
    });
    let near: Vec<bool> = near.collect();
    let faces: Vec<u32> = (0..near.len() as u32).filter(|&face| near[face as usize]).collect();
    let found = layer.select(&faces).crossings(|| progress.check())?;
    Ok(found.into_iter().map(|pair| pair.map(|face| faces[face as usize])).collect())
}
