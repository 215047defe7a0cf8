//! Transfers the attributes of a mesh to the vertices and faces that fill its holes.

use std::cell::OnceCell;

use maquette_base::linear::cholesky::{Cholesky, Symmetric};
use maquette_value::{Attribute, Mesh, MeshError};
use nalgebra::Vector3;

use crate::exemplar::{Copies, Sources};
use crate::triangles::filling::Filling;
use crate::triangles::triangulation::{NONE, area_vector};

/// Returns true if a mesh has attributes that a fill copies together with the shape of exemplars.
pub(crate) fn copies_attributes(mesh: &Mesh) -> bool {
    let is_copied = |(name, attribute): (&str, &Attribute)| match attribute {
        Attribute::Number(_) | Attribute::Color(_) => true,
        Attribute::Vector(_) => name != "normal",
        Attribute::Pair(_) | Attribute::Index(_) | Attribute::Flag(_) => false,
    };
    mesh.corner().iter().next().is_some() || mesh.vertex().iter().any(is_copied)
}

/// Computes attributes for the vertices that fill holes, from their neighbors and from the input vertices that they copy.
pub(crate) struct AttributeCarrier<'a> {
    filling: &'a Filling,
    /// The parts of the input surface from which attributes are copied; `None` if the fill copies nothing.
    copies: Option<&'a Copies>,
    /// For each vertex of the fill, the input vertex that it copies; if it copies none, the input vertex that is nearest along edges.
    nearest: Vec<u32>,
    neighbors: Vec<Vec<u32>>,
    /// The interpolation equations, factored on first use; the inner `None` means that the matrix cannot be factored.
    equations: OnceCell<Option<Equations>>,
}

/// The linear system of harmonic interpolation: the value at each vertex of the fill is the mean of the values at its neighbors.
struct Equations {
    factors: Cholesky,
    /// For each vertex of the fill, its neighbors among the vertices of the input mesh.
    data_neighbors: Vec<Vec<u32>>,
}

impl<'a> AttributeCarrier<'a> {
    pub(crate) fn new(filling: &'a Filling, copies: Option<&'a Copies>) -> Self {
        let count = filling.points.len() - filling.n_data_vertices;
        let mut neighbors: Vec<Vec<u32>> = vec![Vec::new(); count];
        for face in &filling.faces[filling.n_data_faces..] {
            for k in 0..3 {
                if filling.n_data_vertices <= face[k] as usize {
                    neighbors[face[k] as usize - filling.n_data_vertices]
                        .extend([face[(k + 1) % 3], face[(k + 2) % 3]]);
                }
            }
        }
        neighbors.iter_mut().for_each(|neighbors| {
            neighbors.sort_unstable();
            neighbors.dedup();
        });
        let mut nearest = nearest_data_vertices(filling, &neighbors);
        let exemplars = copies.iter().flat_map(|copies| &copies.exemplar);
        for (nearest, &exemplar) in nearest.iter_mut().zip(exemplars) {
            if exemplar != NONE {
                *nearest = exemplar;
            }
        }
        Self { filling, copies, nearest, neighbors, equations: OnceCell::new() }
    }

    /// Returns, for each vertex of the filled mesh, the input vertex whose attributes it takes. An input vertex takes its own attributes. A
    /// vertex of the fill takes those of the vertex that it copies, otherwise those of the nearest input vertex along edges of the fill.
    pub(crate) fn example_vertices(&self) -> Vec<u32> {
        (0..self.filling.n_data_vertices as u32).chain(self.nearest.iter().copied()).collect()
    }

    /// Returns `column` extended to the vertices of the fill by harmonic interpolation: each new entry is the mean of its neighbors'
    /// entries.
    fn interpolate<T: Copy, const N: usize>(
        &self,
        column: &[T],
        read: impl Fn(T) -> [f64; N],
        write: impl Fn([f64; N]) -> T,
    ) -> Vec<T> {
        let mut all = column.to_vec();
        let equations =
            self.equations.get_or_init(|| harmonic_equations(self.filling, &self.neighbors));
        let Some(equations) = equations else {
            all.extend(self.nearest.iter().map(|&vertex| column[vertex as usize]));
            return all;
        };
        let mut x: Vec<[f64; 3]> = equations
            .data_neighbors
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

    /// Like [`interpolate`](Self::interpolate), but a vertex of the fill that copies input vertices gets the weighted mean of their
    /// entries.
    fn interpolate_from_exemplars<T: Copy, const N: usize>(
        &self,
        column: &[T],
        read: impl Fn(T) -> [f64; N] + Copy,
        write: impl Fn([f64; N]) -> T + Copy,
    ) -> Vec<T> {
        let mut all = self.interpolate(column, read, write);
        if let Some(copies) = self.copies {
            let means = copies.votes.mean(|vertex| read(column[vertex as usize]));
            for (own, mean) in all[self.filling.n_data_vertices..].iter_mut().zip(means) {
                if let Some(mean) = mean {
                    *own = write(mean);
                }
            }
        }
        all
    }

    /// Returns a column of the input vertices with entries appended for the vertices of the fill. Numbers, vectors, pairs and colors are
    /// interpolated, colors in linear light. Integers and flags are copied from one input vertex, see `nearest`. Pairs are interpolated
    /// even if the fill copies other parts of the surface: they may be texture coordinates, and copies from different places would tear the
    /// texture apart.
    fn vertex_column(&self, attribute: &Attribute) -> Attribute {
        match attribute {
            Attribute::Number(column) => {
                Attribute::Number(self.interpolate_from_exemplars(column, |x| [x], |[x]| x).into())
            }
            Attribute::Pair(column) => {
                Attribute::Pair(self.interpolate(column, |x| x, |x| x).into())
            }
            Attribute::Vector(column) => {
                Attribute::Vector(self.interpolate_from_exemplars(column, |x| x, |x| x).into())
            }
            Attribute::Color(column) => Attribute::Color(
                self.interpolate_from_exemplars(
                    column,
                    |color: [u8; 3]| color.map(linear_intensity),
                    |color| color.map(srgb_channel),
                )
                .into(),
            ),
            Attribute::Index(_) | Attribute::Flag(_) => attribute.select(&self.example_vertices()),
        }
    }

    /// Like [`vertex_column`](Self::vertex_column), but recomputes the attribute `normal` from the filled surface.
    fn named_column(&self, name: &str, attribute: &Attribute) -> Attribute {
        match attribute {
            Attribute::Vector(column) if name == "normal" => {
                Attribute::Vector(self.normals(column).into())
            }
            _ => self.vertex_column(attribute),
        }
    }

    /// Transfers the attributes of `from` to the filled mesh `onto`. The first vertices and faces of `onto` are those of `from`; the
    /// vertices and faces of the fill follow.
    ///
    /// # Errors
    /// Does not fail if `onto` begins with the vertices and faces of `from`.
    pub(crate) fn transfer(&self, from: &Mesh, mut onto: Mesh) -> Result<Mesh, MeshError> {
        for (name, attribute) in from.vertex().iter() {
            onto = onto.with_vertex(name, self.named_column(name, attribute))?;
        }
        // Only corner and face attributes need a corner and a face of each vertex. Without such attributes, skip the search, which reads
        // the whole mesh.
        if from.corner().iter().next().is_none() && from.face().iter().next().is_none() {
            return Ok(onto);
        }
        let (corners, faces) = self.first_corners_and_faces(from);
        for (name, attribute) in from.corner().iter() {
            let of_vertices = self.named_column(name, &attribute.select(&corners));
            onto = onto.with_corner(name, self.corner_column(from, attribute, of_vertices))?;
        }
        let new_faces = &self.filling.faces[self.filling.n_data_faces..];
        for (name, attribute) in from.face().iter() {
            let indices: Vec<u32> = (0..from.faces().len() as u32)
                .chain(new_faces.iter().map(|face| faces[self.example_vertex(face[0]) as usize]))
                .collect();
            onto = onto.with_face(name, attribute.select(&indices))?;
        }
        Ok(onto)
    }

    fn example_vertex(&self, vertex: u32) -> u32 {
        let data = self.filling.n_data_vertices;
        if (vertex as usize) < data { vertex } else { self.nearest[vertex as usize - data] }
    }

    /// Returns, for each input vertex, the lowest index of its corners and the lowest index of its faces.
    fn first_corners_and_faces(&self, mesh: &Mesh) -> (Vec<u32>, Vec<u32>) {
        let (mut corners, mut faces) =
            (vec![0; self.filling.n_data_vertices], vec![0; self.filling.n_data_vertices]);
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

    /// Returns a corner attribute extended to the corners of the fill. A new corner gets the entry of its vertex; for an input vertex, that
    /// is the entry of one of its corners.
    fn corner_column(
        &self,
        mesh: &Mesh,
        attribute: &Attribute,
        of_vertices: Attribute,
    ) -> Attribute {
        let count = mesh.faces().corners().len() as u32;
        let new_corners = self.filling.faces[self.filling.n_data_faces..].as_flattened();
        macro_rules! join {
            ($($kind:ident),+) => {
                match (attribute, &of_vertices) {
                    $((Attribute::$kind(old), Attribute::$kind(new)) => {
                        Attribute::$kind(old.iter().chain(new.iter()).copied().collect())
                    })+
                    _ => unreachable!("a carried column has the kind of its source"),
                }
            };
        }
        let joined = join!(Number, Index, Flag, Pair, Vector, Color);
        // `indices` refer to the entries of the input corners, followed by the entries of all vertices.
        let indices: Vec<u32> =
            (0..count).chain(new_corners.iter().map(|&vertex| count + vertex)).collect();
        let mut all = joined.select(&indices);
        if let (Attribute::Pair(column), Some(copies)) = (&mut all, self.copies) {
            let shown: Vec<[f64; 2]> = self.copied_pairs(mesh, column, &copies.sources);
            *column = shown.into();
        }
        all
    }

    /// Extends a column of texture coordinates per corner: each face of the fill gets the texture coordinates at the input position that it
    /// copies.
    fn copied_pairs(&self, mesh: &Mesh, column: &[[f64; 2]], sources: &Sources) -> Vec<[f64; 2]> {
        let corners = mesh.triangle_corners();
        let mut shown = column.to_vec();
        let filled = shown[mesh.faces().corners().len()..].as_chunks_mut::<3>().0;
        for (face, own) in filled.iter_mut().enumerate() {
            let Some((source, weights)) = sources.get(face) else { continue };
            let other_positions = corners[source as usize].map(|corner| column[corner as usize]);
            *own = weights.map(|weights| {
                [0, 1].map(|axis| (0..3).map(|k| weights[k] * other_positions[k][axis]).sum())
            });
        }
        shown
    }

    /// Returns the normals of the input vertices, followed by those of the vertices of the fill, which are means of face normals weighted
    /// by area.
    fn normals(&self, data: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let filling = self.filling;
        let mut sums = vec![Vector3::zeros(); filling.points.len() - filling.n_data_vertices];
        for &face in &filling.faces[filling.n_data_faces..] {
            let area = area_vector(face.map(|vertex| filling.points[vertex as usize]));
            for vertex in
                face.into_iter().filter(|&vertex| filling.n_data_vertices <= vertex as usize)
            {
                sums[vertex as usize - filling.n_data_vertices] += area;
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

/// Converts an sRGB channel, 0 to 255, to linear intensity, 0 to 1 (IEC 61966-2-1).
fn linear_intensity(channel: u8) -> f64 {
    let c = f64::from(channel) / 255.0;
    if c <= 0.04045 { c / 12.92 } else { libm::pow((c + 0.055) / 1.055, 2.4) }
}

/// Converts a linear intensity, 0 to 1, to an sRGB channel.
fn srgb_channel(light: f64) -> u8 {
    let light = light.clamp(0.0, 1.0);
    let c = match light <= 0.0031308 {
        true => light * 12.92,
        false => 1.055 * libm::pow(light, 1.0 / 2.4) - 0.055,
    };
    (c * 255.0).round() as u8
}

/// Returns, for each vertex of the fill, the nearest input vertex, found by a breadth-first search along edges. The search starts from the
/// vertices of the fill that have input neighbors, in the order of their indices. Of several equally near input vertices, the first found
/// is returned.
fn nearest_data_vertices(filling: &Filling, neighbors: &[Vec<u32>]) -> Vec<u32> {
    let mut nearest = vec![NONE; neighbors.len()];
    let mut reached = Vec::with_capacity(neighbors.len());
    for (vertex, neighbors) in (0u32..).zip(neighbors) {
        if let Some(&first) =
            neighbors.iter().find(|&&other| (other as usize) < filling.n_data_vertices)
        {
            nearest[vertex as usize] = first;
            reached.push(vertex);
        }
    }
    let mut next = 0;
    while next < reached.len() {
        let vertex = reached[next] as usize;
        for &other in &neighbors[vertex] {
            let Some(other) = (other as usize).checked_sub(filling.n_data_vertices) else {
                continue;
            };
            if nearest[other] == NONE {
                nearest[other] = nearest[vertex];
                reached.push(other as u32);
            }
        }
        next += 1;
    }
    nearest.iter().map(|&vertex| if vertex == NONE { 0 } else { vertex }).collect()
}

fn harmonic_equations(filling: &Filling, neighbors: &[Vec<u32>]) -> Option<Equations> {
    let mut matrix = Symmetric { starts: vec![0], indices: Vec::new(), entries: Vec::new() };
    let mut known = Vec::with_capacity(neighbors.len());
    for (vertex, neighbors) in (0u32..).zip(neighbors) {
        let (data, filled): (Vec<u32>, Vec<u32>) =
            neighbors.iter().partition(|&&other| (other as usize) < filling.n_data_vertices);
        matrix.indices.extend(filled.iter().map(|other| other - filling.n_data_vertices as u32));
        matrix.entries.extend(filled.iter().map(|_| -1.0));
        matrix.indices.push(vertex);
        matrix.entries.push(neighbors.len() as f64);
        matrix.starts.push(matrix.indices.len() as u32);
        known.push(data);
    }
    Some(Equations { factors: Cholesky::new(&matrix)?, data_neighbors: known })
}
