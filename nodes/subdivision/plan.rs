//! What of a subdivision depends on topology alone: made once, applied to any positions and attributes.
//!
//! A plan of one step is a sparse matrix from old to new vertices for the positions, another one for attributes, and the
//! refined faces. Applying it is a sparse product, row by row in parallel; each row adds its terms in a fixed order, so that
//! the result is the same for any number of threads.

use maquette::value::{Attribute, Column, Encoder, Faces, Mesh, MeshError, Summary};
use maquette::{Error, Value};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::carry::{Carry, Mix};
use super::{Boundary, Scheme, SubdivideError, loop_masks};

/// Rows that one task computes: enough to outweigh the cost of giving it to a thread, some 10 us.
const BLOCK: usize = 4096;

/// A mesh without places, and the rules: all that a plan depends on.
#[derive(Clone, Debug)]
pub(super) struct Topology {
    pub(super) scheme: Scheme,
    pub(super) boundary: Boundary,
    /// Number of vertices.
    pub(super) vertices: usize,
    pub(super) faces: Faces,
    /// Sharp edges by vertices (a < b), sorted.
    pub(super) creases: Vec<([u32; 2], f64)>,
}

impl Value for Topology {
    const NAME: &'static str = "SubdivisionTopology";

    fn encode(&self, to: &mut Encoder) {
        to.plain(&(self.scheme as u8)).plain(&(self.boundary as u8)).counts(&[self.vertices]);
        self.faces.encode(to);
        for (ends, sharpness) in &self.creases {
            to.plain(ends).plain(sharpness);
        }
    }

    fn size(&self) -> usize {
        self.faces.corners().size() + size_of_val(&self.creases[..])
    }

    fn describe(&self) -> Summary {
        Summary::default().with("vertices", self.vertices).with("faces", self.faces.len())
    }
}

/// A sparse matrix by rows: row `r` has the entries `starts[r]..starts[r + 1]`.
#[derive(Clone, Debug)]
pub(super) struct Stencils {
    starts: Column<u32>,
    indices: Column<u32>,
    weights: Column<f64>,
}

/// Rows of a sparse matrix while they are written.
#[derive(Default)]
pub(super) struct Rows {
    ends: Vec<u32>,
    indices: Vec<u32>,
    weights: Vec<f64>,
}

impl Rows {
    /// Adds an entry to the current row.
    pub(super) fn push(&mut self, index: u32, weight: f64) {
        self.indices.push(index);
        self.weights.push(weight);
    }

    /// Ends the current row.
    pub(super) fn end(&mut self) {
        self.ends.push(self.indices.len() as u32);
    }
}

impl Stencils {
    /// The rows that `write` writes for each of `items`, in their order, and the first row of each item (with the number of
    /// rows behind the last). `write` gets a scratch space, an item, and where to write its rows.
    pub(super) fn build<S: Default>(
        items: usize,
        write: impl Fn(&mut S, usize, &mut Rows) + Sync,
    ) -> (Self, Column<u32>) {
        let blocks: Vec<(Vec<u32>, Rows)> = (0..items.div_ceil(BLOCK))
            .into_par_iter()
            .map(|block| {
                let (mut scratch, mut rows) = (S::default(), Rows::default());
                rows.indices.reserve(BLOCK * 4);
                rows.weights.reserve(BLOCK * 4);
                let items = block * BLOCK..items.min((block + 1) * BLOCK);
                let ends = items.map(|item| {
                    write(&mut scratch, item, &mut rows);
                    rows.ends.len() as u32
                });
                (ends.collect(), rows)
            })
            .collect();
        let total = |len: fn(&Rows) -> usize| blocks.iter().map(|(_, rows)| len(rows)).sum();
        let mut groups = Vec::with_capacity(items + 1);
        let mut starts = Vec::with_capacity(total(|rows| rows.ends.len()) + 1);
        let mut indices = Vec::with_capacity(total(|rows| rows.indices.len()));
        let mut weights = Vec::with_capacity(indices.capacity());
        groups.push(0);
        starts.push(0);
        for (ends, rows) in &blocks {
            let (row, entry) = (starts.len() as u32 - 1, indices.len() as u32);
            groups.extend(ends.iter().map(|end| row + end));
            starts.extend(rows.ends.iter().map(|end| entry + end));
            indices.extend_from_slice(&rows.indices);
            weights.extend_from_slice(&rows.weights);
        }
        let stencils =
            Self { starts: starts.into(), indices: indices.into(), weights: weights.into() };
        (stencils, groups.into())
    }

    /// Number of rows.
    pub(super) fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// The entries of a row: indices and weights.
    pub(super) fn row(&self, row: usize) -> (&[u32], &[f64]) {
        let entries = self.starts[row] as usize..self.starts[row + 1] as usize;
        (&self.indices[entries.clone()], &self.weights[entries])
    }

    /// One row times a column.
    pub(super) fn apply_row<T: Mix>(&self, row: usize, column: &[T]) -> T {
        let (indices, weights) = self.row(row);
        T::mix(
            weights.iter().zip(indices).map(|(&weight, &index)| (weight, column[index as usize])),
        )
    }

    /// The matrix times a column.
    pub(super) fn apply<T: Mix>(&self, column: &[T]) -> Vec<T> {
        let rows = (0..self.len()).into_par_iter().with_min_len(BLOCK);
        rows.map(|row| self.apply_row(row, column)).collect()
    }

    fn size(&self) -> usize {
        self.starts.size() + self.indices.size() + self.weights.size()
    }
}

/// One step of a subdivision scheme.
#[derive(Clone, Debug)]
pub(super) struct Step {
    /// What it was made from.
    pub(super) topology: Topology,
    /// The new vertices' places.
    pub(super) positions: Stencils,
    /// So many vertices come first and keep the attributes of the old vertices.
    pub(super) kept: usize,
    /// The attributes of the vertices behind them.
    pub(super) between: Stencils,
    /// The refined mesh.
    pub(super) faces: Faces,
    /// Its creases.
    pub(super) creases: Vec<([u32; 2], f64)>,
}

/// A function of its topology, which therefore stands for it in the hash.
impl Value for Step {
    const NAME: &'static str = "SubdivisionStep";

    fn encode(&self, to: &mut Encoder) {
        to.value(&self.topology);
    }

    fn size(&self) -> usize {
        let faces = self.faces.corners().size() + size_of_val(&self.creases[..]);
        self.topology.size() + self.positions.size() + self.between.size() + faces
    }

    fn describe(&self) -> Summary {
        Summary::default().with("vertices", self.positions.len()).with("faces", self.faces.len())
    }
}

impl Step {
    /// The plan of the scheme that `topology` names.
    ///
    /// # Errors
    /// Those of the scheme: faces that it cannot refine, or a mesh that is not manifold.
    pub(super) fn new(topology: &Topology) -> Result<Self, SubdivideError> {
        match topology.scheme {
            Scheme::Loop => loop_masks::refine(topology),
        }
    }

    /// The same, as [`maquette::Context::memo`] wants it.
    pub(super) fn memo(topology: &Topology) -> Result<Self, Error> {
        Ok(Self::new(topology)?)
    }

    /// The topology of the refined mesh.
    pub(super) fn refined(&self) -> Topology {
        Topology {
            vertices: self.positions.len(),
            faces: self.faces.clone(),
            creases: self.creases.clone(),
            ..self.topology
        }
    }

    /// The old face of each new one.
    pub(super) fn parents(&self) -> Vec<u32> {
        match self.topology.scheme {
            Scheme::Loop => (0..self.faces.len() as u32).map(|face| face / 4).collect(),
        }
    }

    /// Refines a mesh of this plan's topology.
    ///
    /// # Errors
    /// If a place becomes infinite.
    pub(super) fn apply(&self, mesh: &Mesh) -> Result<Mesh, MeshError> {
        let mut refined = Mesh::new(self.positions.apply(mesh.positions()), self.faces.clone())?
            .with_creases(self.creases.iter().copied())
            .with_texture(mesh.texture().cloned())
            .with_frame(mesh.frame().copied());
        for (name, attribute) in mesh.vertex().iter().filter(|(name, _)| *name != "normal") {
            refined = refined.with_vertex(name, BetweenVertices(self).attribute(attribute))?;
        }
        for (name, attribute) in mesh.corner().iter().filter(|(name, _)| *name != "normal") {
            refined = refined.with_corner(name, WithinFaces(self).attribute(attribute))?;
        }
        if mesh.face().iter().next().is_some() {
            let parents = self.parents();
            for (name, attribute) in mesh.face().iter() {
                refined = refined.with_face(name, attribute.select(&parents))?;
            }
        }
        Ok(refined)
    }
}

/// Vertex attributes: straight between old vertices, so that a picture bound to the mesh stays where it is.
struct BetweenVertices<'a>(&'a Step);

impl Carry for BetweenVertices<'_> {
    fn column<T: Mix>(&self, old: &[T]) -> Vec<T> {
        let mut new = Vec::with_capacity(self.0.positions.len());
        new.extend_from_slice(&old[..self.0.kept]);
        new.extend(self.0.between.apply(old));
        new
    }
}

/// Corner attributes: straight within each face, so that seams stay.
struct WithinFaces<'a>(&'a Step);

impl Carry for WithinFaces<'_> {
    fn column<T: Mix>(&self, old: &[T]) -> Vec<T> {
        match self.0.topology.scheme {
            Scheme::Loop => loop_masks::carry_corners(old),
        }
    }
}

/// Where the vertices of a mesh go if it is subdivided forever, and which way the surface faces there.
#[derive(Clone, Debug)]
pub(super) struct Limit {
    /// What it was made from.
    pub(super) topology: Topology,
    /// The places.
    pub(super) positions: Stencils,
    /// Rows in pairs: two tangents, the first turning counter-clockwise to the second; a pair for each side of a crease.
    pub(super) tangents: Stencils,
    /// The first row of each vertex in `tangents`, and behind the last vertex the number of rows.
    pub(super) sides: Column<u32>,
}

/// A function of its topology, which therefore stands for it in the hash.
impl Value for Limit {
    const NAME: &'static str = "SubdivisionLimit";

    fn encode(&self, to: &mut Encoder) {
        to.value(&self.topology);
    }

    fn size(&self) -> usize {
        let tangents = self.tangents.size() + self.sides.size();
        self.topology.size() + self.positions.size() + tangents
    }

    fn describe(&self) -> Summary {
        Summary::default().with("vertices", self.positions.len())
    }
}

impl Limit {
    /// The limit of the scheme that `topology` names.
    ///
    /// # Errors
    /// Those of [`Step::new`].
    pub(super) fn new(topology: &Topology) -> Result<Self, SubdivideError> {
        match topology.scheme {
            Scheme::Loop => loop_masks::limit(topology),
        }
    }

    /// The same, as [`maquette::Context::memo`] wants it.
    pub(super) fn memo(topology: &Topology) -> Result<Self, Error> {
        Ok(Self::new(topology)?)
    }

    /// The same mesh with its vertices on the limit surface, and the attribute `normal`.
    ///
    /// # Errors
    /// If a place becomes infinite.
    pub(super) fn apply(&self, mesh: &Mesh) -> Result<Mesh, MeshError> {
        let limit = mesh.with_positions(self.positions.apply(mesh.positions()))?;
        let fallback = limit.vertex_normals();
        let normals: Vec<[f64; 3]> = (0..self.positions.len())
            .into_par_iter()
            .with_min_len(BLOCK)
            .map(|vertex| self.normal(vertex, mesh.positions(), fallback[vertex]).into())
            .collect();
        limit.without("normal").with_vertex("normal", Attribute::Vector(normals.into()))
    }

    /// The unit normal at a vertex: on a crease the mean of its sides. `fallback` is taken where the tangents do not span a
    /// plane, and tells which way a side of a corner faces, whose tangents may be more than a half turn apart.
    fn normal(
        &self,
        vertex: usize,
        control: &[Point3<f64>],
        fallback: Vector3<f64>,
    ) -> Vector3<f64> {
        let rows = self.sides[vertex] as usize..self.sides[vertex + 1] as usize;
        let several = rows.len() > 2;
        let sides = rows.step_by(2).map(|row| {
            let [along, across] =
                [row, row + 1].map(|row| self.tangents.apply_row(row, control).coords);
            let normal = along.cross(&across).try_normalize(0.0).unwrap_or_default();
            if several && normal.dot(&fallback) < 0.0 { -normal } else { normal }
        });
        sides.sum::<Vector3<f64>>().try_normalize(1e-6).unwrap_or(fallback)
    }
}
