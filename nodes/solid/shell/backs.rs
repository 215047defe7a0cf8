//! The vertices on the other side of a surface, and their motions.

use maquette_base::topology::lists::Lists;
use maquette_base::topology::union_find::UnionFind;
use maquette_value::Mesh;
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

/// The vertices of a surface, separated where faces meet in a vertex without a common edge: one back vertex for each fan of faces.
pub(super) struct Backs<'a> {
    pub(super) mesh: &'a Mesh,
    /// 1 for motions backwards, and -1 for motions to the front.
    pub(super) sign: f64,
    /// The back vertex of each corner.
    pub(super) of_corner: Vec<u32>,
    /// The first corner of each back vertex.
    pub(super) first: Vec<u32>,
    pub(super) sides: Vec<Side>,
    /// The indices of the sides at borders.
    pub(super) borders: Vec<u32>,
    /// For each back vertex, the faces around it.
    pub(super) faces: Lists,
    /// The unit normals of the faces; reversed for motions to the front.
    pub(super) normals: Vec<Vector3<f64>>,
    /// The triangles of all faces, by back vertices.
    pub(super) triangles: Vec<[u32; 3]>,
}

/// A side of a face.
pub(super) struct Side {
    pub(super) face: u32,
    pub(super) corners: [u32; 2],
    pub(super) backs: [u32; 2],
    pub(super) is_border: bool,
}

/// The motion of each back vertex: a unit direction and a height in mm, and a shift along the surface.
#[derive(Clone)]
pub(super) struct Motion {
    pub(super) directions: Vec<Vector3<f64>>,
    pub(super) heights: Vec<f64>,
    pub(super) shifts: Vec<Vector3<f64>>,
}

impl<'a> Backs<'a> {
    /// Separates the vertices of a mesh. `sign` is 1 for motions backwards, and -1 for motions to the front.
    pub(super) fn new(mesh: &'a Mesh, sign: f64) -> Self {
        let (faces, edges) = (mesh.faces(), mesh.edges());
        let mut fans = UnionFind::new(faces.corners().len());
        let mut older: Vec<Option<[u32; 2]>> = vec![None; edges.vertices.len()];
        let mut sides = Vec::with_capacity(faces.corners().len());
        for face in 0..faces.len() {
            let (first, count) = (faces.first_corner(face), faces.face(face).len());
            for k in 0..count {
                let corners = [first + k, first + (k + 1) % count].map(|it| it as u32);
                let edge = edges.of_corner[first + k] as usize;
                if let Some([from, to]) = older[edge].replace(corners) {
                    fans.union(corners[0], to);
                    fans.union(corners[1], from);
                }
                let is_border = edges.faces[edge] == 1;
                sides.push(Side { face: face as u32, corners, backs: [0; 2], is_border });
            }
        }
        let (of_corner, first) = fans.into_labels();
        for side in &mut sides {
            side.backs = side.corners.map(|corner| of_corner[corner as usize]);
        }
        let normals = (0..faces.len()).into_par_iter().map(|face: usize| {
            sign * mesh.area_vector(faces.face(face)).try_normalize(0.0).unwrap_or_default()
        });
        let around =
            Lists::group(first.len(), || sides.iter().map(|side| (side.backs[0], side.face)));
        let triangles = mesh.triangle_corners().into_iter();
        let triangles = triangles.map(|it| it.map(|corner| of_corner[corner as usize])).collect();
        let borders = (0..sides.len() as u32).filter(|&side| sides[side as usize].is_border);
        Self {
            mesh,
            sign,
            first,
            borders: borders.collect(),
            sides,
            faces: around,
            normals: normals.collect(),
            triangles,
            of_corner,
        }
    }

    pub(super) fn vertex(&self, back: usize) -> u32 {
        self.mesh.faces().corners()[self.first[back] as usize]
    }

    pub(super) fn position(&self, back: usize) -> Point3<f64> {
        self.mesh.positions()[self.vertex(back) as usize]
    }

    pub(super) fn moved(&self, motion: &Motion) -> Vec<Point3<f64>> {
        (0..self.first.len())
            .map(|back| {
                let along = motion.directions[back] * motion.heights[back];
                self.position(back) + along + motion.shifts[back]
            })
            .collect()
    }

    /// Returns for each back vertex at a border the shift by `distance` mm out of the surface, but by at most a third of the shorter edge
    /// of the border.
    pub(super) fn shifts(&self, distance: f64) -> Vec<Vector3<f64>> {
        let mut shifts = vec![Vector3::zeros(); self.first.len()];
        let mut shortest = vec![f64::INFINITY; self.first.len()];
        for side in self.borders.iter().map(|&side| &self.sides[side as usize]) {
            let [a, b] = side.backs.map(|back| back as usize);
            let edge = self.position(b) - self.position(a);
            let normal = self.normals[side.face as usize] * self.sign;
            let out = edge.cross(&normal).try_normalize(0.0);
            for back in [a, b] {
                shifts[back] += out.unwrap_or_default();
                shortest[back] = shortest[back].min(edge.norm());
            }
        }
        for (shift, shortest) in shifts.iter_mut().zip(shortest) {
            let unit = shift.try_normalize(0.0).unwrap_or_default();
            *shift = unit * distance.min(shortest / 3.0);
        }
        shifts
    }
}
