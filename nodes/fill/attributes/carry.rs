//! Carries the attributes of a mesh over to what fills its holes.

use std::cell::OnceCell;

use maquette_base::linear::cholesky::{Cholesky, Symmetric};
use maquette_value::{Attribute, Mesh, MeshError};
use nalgebra::Vector3;

use crate::exemplar::{Copies, Sources};
use crate::triangles::filling::Filling;
use crate::triangles::triangulation::{NONE, area_vector};

/// How the filled vertices are connected with each other and the data, and what they copy.
pub(crate) struct Carry<'a> {
    filling: &'a Filling,
    /// What is copied from exemplars, if the fill has any.
    copies: Option<&'a Copies>,
    /// The data vertex that each filled vertex copies, or that is nearest along edges.
    nearest: Vec<u32>,
    neighbors: Vec<Vec<u32>>,
    /// Factored when first needed.
    equations: OnceCell<Option<Equations>>,
}

/// The equations of harmonic interpolation: each filled vertex has the mean of its neighbors.
struct Equations {
    factors: Cholesky,
    /// Of each filled vertex its neighbors in the data.
    known: Vec<Vec<u32>>,
}

impl<'a> Carry<'a> {
    pub(crate) fn new(filling: &'a Filling, copies: Option<&'a Copies>) -> Self {
        let count = filling.points.len() - filling.data;
        let mut neighbors: Vec<Vec<u32>> = vec![Vec::new(); count];
        for face in &filling.faces[filling.kept..] {
            for k in 0..3 {
                if filling.data <= face[k] as usize {
                    neighbors[face[k] as usize - filling.data]
                        .extend([face[(k + 1) % 3], face[(k + 2) % 3]]);
                }
            }
        }
        neighbors.iter_mut().for_each(|neighbors| {
            neighbors.sort_unstable();
            neighbors.dedup();
        });
        let mut nearest = nearest(filling, &neighbors);
        let exemplars = copies.iter().flat_map(|copies| &copies.exemplar);
        for (nearest, &exemplar) in nearest.iter_mut().zip(exemplars) {
            if exemplar != NONE {
                *nearest = exemplar;
            }
        }
        Self { filling, copies, nearest, neighbors, equations: OnceCell::new() }
    }

    /// The data vertex whose attributes each vertex takes: itself, the vertex of its exemplar, or the nearest one along filled edges.
    pub(crate) fn examples(&self) -> Vec<u32> {
        (0..self.filling.data as u32).chain(self.nearest.iter().copied()).collect()
    }

    /// A column with entries for the filled vertices after those of the data, by harmonic interpolation: each is the mean of its neighbors.
    fn spread<T: Copy, const N: usize>(
        &self,
        column: &[T],
        read: impl Fn(T) -> [f64; N],
        write: impl Fn([f64; N]) -> T,
    ) -> Vec<T> {
        let mut all = column.to_vec();
        let equations = self.equations.get_or_init(|| equations(self.filling, &self.neighbors));
        let Some(equations) = equations else {
            all.extend(self.nearest.iter().map(|&vertex| column[vertex as usize]));
            return all;
        };
        let mut x: Vec<[f64; 3]> = equations
            .known
            .iter()
            .map(|known| {
                let mut sum = [0.0; 3];
                for &vertex in known {
                    let entry = read(column[vertex as usize]);
                    (0..N).for_each(|k| sum[k] += entry[k]);
                }
                sum
            })
            .collect();
        equations.factors.solve(&mut x);
        all.extend(x.into_iter().map(|x| write(std::array::from_fn(|k| x[k]))));
        all
    }

    /// As [`spread`](Self::spread), but the weighted mean of the exemplars' entries where there are exemplars.
    fn voted<T: Copy, const N: usize>(
        &self,
        column: &[T],
        read: impl Fn(T) -> [f64; N] + Copy,
        write: impl Fn([f64; N]) -> T + Copy,
    ) -> Vec<T> {
        let mut all = self.spread(column, read, write);
        if let Some(copies) = self.copies {
            let means = copies.votes.mean(|vertex| read(column[vertex as usize]));
            for (own, mean) in all[self.filling.data..].iter_mut().zip(means) {
                if let Some(mean) = mean {
                    *own = write(mean);
                }
            }
        }
        all
    }

    /// A column of the data's vertices, with entries for the filled ones: numbers, vectors, pairs and colors are mixed, colors as light;
    /// of whole numbers and flags those of the nearest data are taken, or of the exemplars. Pairs may be
    /// texture coordinates, which faces share here, so that those of exemplars would tear the picture: they are mixed.
    fn vertex(&self, attribute: &Attribute) -> Attribute {
        match attribute {
            Attribute::Number(column) => {
                Attribute::Number(self.voted(column, |x| [x], |[x]| x).into())
            }
            Attribute::Pair(column) => Attribute::Pair(self.spread(column, |x| x, |x| x).into()),
            Attribute::Vector(column) => Attribute::Vector(self.voted(column, |x| x, |x| x).into()),
            Attribute::Color(column) => Attribute::Color(
                self.voted(column, |color: [u8; 3]| color.map(light), |color| color.map(channel))
                    .into(),
            ),
            Attribute::Index(_) | Attribute::Flag(_) => attribute.select(&self.examples()),
        }
    }

    /// The same, but normals are those of the filling.
    fn named(&self, name: &str, attribute: &Attribute) -> Attribute {
        match attribute {
            Attribute::Vector(column) if name == "normal" => {
                Attribute::Vector(self.normals(column).into())
            }
            _ => self.vertex(attribute),
        }
    }

    /// The attributes of `from` on `onto`, the mesh that is filled: the same vertices and faces, and those of the filling behind them.
    ///
    /// # Errors
    /// None, as long as `onto` is that mesh.
    pub(crate) fn onto(&self, from: &Mesh, mut onto: Mesh) -> Result<Mesh, MeshError> {
        for (name, attribute) in from.vertex().iter() {
            onto = onto.with_vertex(name, self.named(name, attribute))?;
        }
        // To find the corners and faces of all vertices takes a pass over all data, and is not always needed.
        if from.corner().iter().next().is_none() && from.face().iter().next().is_none() {
            return Ok(onto);
        }
        let (corners, faces) = self.beside(from);
        for (name, attribute) in from.corner().iter() {
            let of_vertices = self.named(name, &attribute.select(&corners));
            onto = onto.with_corner(name, self.corner(from, attribute, of_vertices))?;
        }
        let new_faces = &self.filling.faces[self.filling.kept..];
        for (name, attribute) in from.face().iter() {
            let places: Vec<u32> = (0..from.faces().len() as u32)
                .chain(new_faces.iter().map(|face| faces[self.example(face[0]) as usize]))
                .collect();
            onto = onto.with_face(name, attribute.select(&places))?;
        }
        Ok(onto)
    }

    fn example(&self, vertex: u32) -> u32 {
        let data = self.filling.data;
        if (vertex as usize) < data { vertex } else { self.nearest[vertex as usize - data] }
    }

    /// The first corner and the first face at each vertex of the data.
    fn beside(&self, mesh: &Mesh) -> (Vec<u32>, Vec<u32>) {
        let (mut corners, mut faces) = (vec![0; self.filling.data], vec![0; self.filling.data]);
        let mut corner = mesh.faces().corners().len() as u32;
        for face in (0..mesh.faces().len()).rev() {
            for &vertex in mesh.faces().face(face).iter().rev() {
                corner -= 1;
                corners[vertex as usize] = corner;
                faces[vertex as usize] = face as u32;
            }
        }
        (corners, faces)
    }

    /// A column per corner. Filled corners get the entries of their vertices, computed from one corner at each vertex of the data.
    fn corner(&self, mesh: &Mesh, attribute: &Attribute, of_vertices: Attribute) -> Attribute {
        let count = mesh.faces().corners().len() as u32;
        let new_corners = self.filling.faces[self.filling.kept..].as_flattened();
        let joined = |first: &Attribute| {
            // The places of both columns, one behind the other.
            let places: Vec<u32> =
                (0..count).chain(new_corners.iter().map(|&vertex| count + vertex)).collect();
            first.select(&places)
        };
        macro_rules! join {
            ($($kind:ident),+) => {
                match (attribute, &of_vertices) {
                    $((Attribute::$kind(old), Attribute::$kind(new)) => {
                        joined(&Attribute::$kind(old.iter().chain(new.iter()).copied().collect()))
                    })+
                    _ => unreachable!("a carried column has the kind of its source"),
                }
            };
        }
        let mut all = join!(Number, Index, Flag, Pair, Vector, Color);
        if let (Attribute::Pair(column), Some(copies)) = (&mut all, self.copies) {
            let shown: Vec<[f64; 2]> = self.shown(mesh, column, &copies.sources);
            *column = shown.into();
        }
        all
    }

    /// A column of pairs per corner, in which each filled face has those of the place that it copies.
    fn shown(&self, mesh: &Mesh, column: &[[f64; 2]], sources: &Sources) -> Vec<[f64; 2]> {
        let corners = mesh.triangle_corners();
        let mut shown = column.to_vec();
        let filled = shown[mesh.faces().corners().len()..].as_chunks_mut::<3>().0;
        for (face, own) in filled.iter_mut().enumerate() {
            let Some((source, shares)) = sources.of(face) else { continue };
            let there = corners[source as usize].map(|corner| column[corner as usize]);
            *own = shares
                .map(|shares| [0, 1].map(|axis| (0..3).map(|k| shares[k] * there[k][axis]).sum()));
        }
        shown
    }

    /// The data's normals, and those of the filled vertices by the areas of the faces around.
    fn normals(&self, data: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let filling = self.filling;
        let mut sums = vec![Vector3::zeros(); filling.points.len() - filling.data];
        for &face in &filling.faces[filling.kept..] {
            let area = area_vector(face.map(|vertex| filling.points[vertex as usize]));
            for vertex in face.into_iter().filter(|&vertex| filling.data <= vertex as usize) {
                sums[vertex as usize - filling.data] += area;
            }
        }
        data.iter()
            .copied()
            .chain(
                sums.into_iter()
                    .map(|sum: Vector3<f64>| sum.try_normalize(0.0).unwrap_or_default().into()),
            )
            .collect()
    }
}

/// The linear intensity of an sRGB channel, 0 to 1 (IEC 61966-2-1).
fn light(channel: u8) -> f64 {
    let c = f64::from(channel) / 255.0;
    if c <= 0.04045 { c / 12.92 } else { libm::pow((c + 0.055) / 1.055, 2.4) }
}

/// The sRGB channel of a linear intensity.
fn channel(light: f64) -> u8 {
    let light = light.clamp(0.0, 1.0);
    let c = match light <= 0.0031308 {
        true => light * 12.92,
        false => 1.055 * libm::pow(light, 1.0 / 2.4) - 0.055,
    };
    (c * 255.0).round() as u8
}

/// The data vertex nearest to each filled one: the first that a search from the lowest on meets, edge by edge.
fn nearest(filling: &Filling, neighbors: &[Vec<u32>]) -> Vec<u32> {
    let mut nearest = vec![NONE; neighbors.len()];
    let mut reached = Vec::with_capacity(neighbors.len());
    for (vertex, neighbors) in (0u32..).zip(neighbors) {
        if let Some(&first) = neighbors.iter().find(|&&other| (other as usize) < filling.data) {
            nearest[vertex as usize] = first;
            reached.push(vertex);
        }
    }
    let mut next = 0;
    while next < reached.len() {
        let vertex = reached[next] as usize;
        for &other in &neighbors[vertex] {
            let Some(other) = (other as usize).checked_sub(filling.data) else { continue };
            if nearest[other] == NONE {
                nearest[other] = nearest[vertex];
                reached.push(other as u32);
            }
        }
        next += 1;
    }
    nearest.iter().map(|&vertex| if vertex == NONE { 0 } else { vertex }).collect()
}

fn equations(filling: &Filling, neighbors: &[Vec<u32>]) -> Option<Equations> {
    let mut matrix = Symmetric { starts: vec![0], indices: Vec::new(), entries: Vec::new() };
    let mut known = Vec::with_capacity(neighbors.len());
    for (vertex, neighbors) in (0u32..).zip(neighbors) {
        let (data, filled): (Vec<u32>, Vec<u32>) =
            neighbors.iter().partition(|&&other| (other as usize) < filling.data);
        matrix.indices.extend(filled.iter().map(|other| other - filling.data as u32));
        matrix.entries.extend(filled.iter().map(|_| -1.0));
        matrix.indices.push(vertex);
        matrix.entries.push(neighbors.len() as f64);
        matrix.starts.push(matrix.indices.len() as u32);
        known.push(data);
    }
    Some(Equations { factors: Cholesky::new(&matrix)?, known })
}
