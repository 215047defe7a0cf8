//! Limit masks: matrices for the limit positions and tangents of the vertices of a mesh.

use std::ops::Range;

use maquette_base::linear::stencils::Stencils;
use maquette_node::{Error, Limit as Most};
use maquette_value::Memo;
use maquette_value::parallel::*;
use maquette_value::{Attribute, Column, Encoder, Mesh, MeshError};
use nalgebra::{Point3, Vector3};

use super::dual_limit::DualLimit;
use crate::Scheme;
use crate::masks::catmull_clark::CatmullClarkMasks;
use crate::masks::closed_rows::closed_rows;
use crate::masks::loop_masks::LoopMasks;
use crate::masks::sharpness::Sharpness;
use crate::masks::vertex_rings::{Masks, RingMasks, Scratch};
use crate::refine::connectivity::Connectivity;
use crate::refine::half_edges::HalfEdges;
use crate::refine::level::{check_triangles, creases};
use crate::refine::topology::Topology;
use crate::rules::Rules;

/// The number of vertices per parallel task.
const BLOCK: usize = 4096;

/// The maximum number of entries in the limit masks of a mesh. Masks of this size need about 5 GB of memory for positions and tangents. A
/// face with `m` corners causes about `m` entries for each of its corners.
const ENTRIES: Most =
    Most { max: 1 << 27, items: "numbers", help: "divide its faces with many corners" };

/// The limit positions of the vertices of a mesh, without tangents. Interpolation needs no tangents.
#[derive(Clone, Debug)]
pub(crate) struct LimitPositions {
    /// The topology from which the masks were computed.
    pub(crate) topology: Topology,
    /// The matrix rows of the limit positions, as in [`Limit`].
    pub(crate) positions: Stencils,
}

/// The masks are a function of the topology, so only the topology is encoded for the hash.
impl Memo for LimitPositions {
    const NAME: &'static str = "SubdivisionLimitPlaces";

    fn encode(&self, to: &mut Encoder) {
        to.memo(&self.topology);
    }

    fn size(&self) -> usize {
        self.topology.size() + self.positions.size()
    }
}

impl LimitPositions {
    /// Computes the masks by the scheme in `topology`.
    ///
    /// # Errors
    /// The errors of [`Limit::new`].
    pub(crate) fn new(topology: &Topology) -> Result<Self, Error> {
        let positions = match closed_rows(topology) {
            Some(rows) => rows,
            None => SchemeLimit::new(topology)?.positions(),
        };
        Ok(Self { topology: topology.clone(), positions })
    }

    /// Performs [`Self::new`] with the signature that [`maquette_node::Context::memo`] requires.
    pub(crate) fn memo(topology: &Topology) -> Result<Self, Error> {
        Self::new(topology)
    }
}

/// The limit masks of the vertices of a mesh, as sparse matrix rows. The columns are the vertices of the mesh.
#[derive(Clone, Debug)]
pub(crate) struct Limit {
    /// The topology from which the masks were computed.
    pub(crate) topology: Topology,
    /// The matrix rows of the limit positions.
    pub(crate) positions: Stencils,
    /// The matrix rows of the tangents: a pair for each side of a crease. The second tangent is counter-clockwise from the first.
    pub(crate) tangents: Stencils,
    /// The index of each vertex's first row in `tangents`, followed by the number of rows.
    pub(crate) sides: Column<u32>,
}

/// The masks are a function of the topology, so only the topology is encoded for the hash.
impl Memo for Limit {
    const NAME: &'static str = "SubdivisionLimit";

    fn encode(&self, to: &mut Encoder) {
        to.memo(&self.topology);
    }

    fn size(&self) -> usize {
        let tangents = self.tangents.size() + self.sides.size();
        self.topology.size() + self.positions.size() + tangents
    }
}

impl Limit {
    /// Computes the masks by the scheme in `topology`.
    ///
    /// # Errors
    /// If the scheme cannot refine a face, a face is too large, or the mesh is not manifold.
    pub(crate) fn new(topology: &Topology) -> Result<Self, Error> {
        let limit = SchemeLimit::new(topology)?;
        let (positions, (tangents, sides)) = (limit.positions(), limit.tangents());
        Ok(Self { topology: topology.clone(), positions, tangents, sides })
    }

    /// Performs [`Self::new`] with the signature that [`maquette_node::Context::memo`] requires.
    pub(crate) fn memo(topology: &Topology) -> Result<Self, Error> {
        Self::new(topology)
    }

    /// Moves the vertices of `mesh` to the limit surface, and adds the attribute `normal`.
    ///
    /// # Errors
    /// If a position becomes infinite.
    pub(crate) fn apply(&self, mesh: &Mesh) -> Result<Mesh, MeshError> {
        let limit = mesh.with_positions(self.positions.apply(mesh.positions()))?;
        let fallback = limit.vertex_normals();
        let normals: Vec<[f64; 3]> = (0..self.positions.len())
            .into_par_iter()
            .with_min_len(BLOCK)
            .map(|vertex| self.normal(vertex, mesh.positions(), fallback[vertex]).into())
            .collect();
        limit.without_attribute("normal").with_vertex("normal", Attribute::Vector(normals.into()))
    }

    /// Returns the unit normal at a vertex; on a crease the mean of its sides' normals. `fallback` is returned if the tangents do not span
    /// a plane. It also determines the sign of the normal for a side of a corner, whose tangents may be more than 180 degrees apart.
    pub(crate) fn normal(
        &self,
        vertex: usize,
        control: &[Point3<f64>],
        fallback: Vector3<f64>,
    ) -> Vector3<f64> {
        let rows = self.sides[vertex] as usize..self.sides[vertex + 1] as usize;
        side_normals(&self.tangents, rows, control, fallback)
    }
}

/// Writes the normals of the `odd` vertices (each given with a half-edge from it), computed from the pairs of `tangents`. `sides` has the
/// index of each vertex's first row in `tangents`. Also replaces all normals that are zero because the tangents do not span a plane.
pub(crate) fn complete_normals(
    normals: &mut [[f64; 3]],
    limit: &Mesh,
    control: &[Point3<f64>],
    mesh: &impl HalfEdges,
    odd: &[[u32; 2]],
    (tangents, sides): (&Stencils, &[u32]),
) {
    let items = (0..odd.len()).into_par_iter().with_min_len(BLOCK);
    let made = items.map_init(Vec::new, |faces, item| {
        let rows = sides[item] as usize..sides[item + 1] as usize;
        let fallback = vertex_normal(limit, mesh, odd[item][1], faces);
        side_normals(tangents, rows, control, fallback).into()
    });
    let made: Vec<[f64; 3]> = made.collect();
    odd.iter().zip(made).for_each(|([vertex, _], normal)| normals[*vertex as usize] = normal);
    fn is_missing(normal: &[f64; 3]) -> bool {
        *normal == [0.0; 3]
    }
    if normals.par_iter().with_min_len(BLOCK).any(is_missing) {
        let missing = normals.iter_mut().zip(limit.vertex_normals());
        missing.filter(|(normal, _)| is_missing(normal)).for_each(|(to, from)| *to = from.into());
    }
}

/// Computes the normal as in [`Mesh::vertex_normals`], for the vertex at which `start` starts.
pub(crate) fn vertex_normal(
    limit: &Mesh,
    mesh: &impl HalfEdges,
    start: u32,
    faces: &mut Vec<u32>,
) -> Vector3<f64> {
    faces.clear();
    faces.extend(mesh.fan(start).map(|half| mesh.face_of(half)));
    faces.sort_unstable();
    let areas = faces.iter().map(|&face| limit.area_vector(limit.faces().face(face as usize)));
    areas.sum::<Vector3<f64>>().try_normalize(0.0).unwrap_or_default()
}

/// Returns the mean of the unit normals for the pairs of tangents in `rows`. `fallback` is used as in [`Limit::normal`].
pub(crate) fn side_normals(
    tangents: &Stencils,
    rows: Range<usize>,
    control: &[Point3<f64>],
    fallback: Vector3<f64>,
) -> Vector3<f64> {
    let several = rows.len() > 2;
    let sides = rows.step_by(2).map(|row| {
        let [along, across] = [row, row + 1].map(|row| tangents.apply_row(row, control).coords);
        let normal = along.cross(&across).try_normalize(0.0).unwrap_or_default();
        if several && normal.dot(&fallback) < 0.0 { -normal } else { normal }
    });
    sides.sum::<Vector3<f64>>().try_normalize(1e-6).unwrap_or(fallback)
}

/// Computes limit positions and tangents at the vertices of a mesh by the rules of its scheme.
enum SchemeLimit {
    Dual(DualLimit),
    Loop(MaskedMesh<LoopMasks>),
    CatmullClark(MaskedMesh<CatmullClarkMasks>),
}

impl SchemeLimit {
    fn new(topology: &Topology) -> Result<Self, Error> {
        let rules = topology.rules;
        rules.scheme.check_limit()?;
        if rules.scheme.needs_triangles() {
            check_triangles(&topology.faces, "Loop's scheme")?;
        }
        check_faces(topology)?;
        let (mesh, starts) = Connectivity::new(&topology.faces, topology.vertices)?;
        let creases = creases(topology, &mesh);
        Ok(match rules.scheme {
            Scheme::DooSabin => Self::Dual(DualLimit::new(mesh, starts, rules.boundary)),
            // Refused above.
            Scheme::Loop | Scheme::Butterfly => {
                Self::Loop(MaskedMesh { mesh, starts, creases, rules, masks: LoopMasks })
            }
            Scheme::CatmullClark => {
                let masks = CatmullClarkMasks;
                Self::CatmullClark(MaskedMesh { mesh, starts, creases, rules, masks })
            }
        })
    }

    fn positions(&self) -> Stencils {
        match self {
            Self::Dual(limit) => limit.positions(&limit.vertices()),
            Self::Loop(stars) => stars.positions(),
            Self::CatmullClark(stars) => stars.positions(),
        }
    }

    fn tangents(&self) -> (Stencils, Column<u32>) {
        match self {
            Self::Dual(limit) => limit.tangents(&limit.vertices()),
            Self::Loop(stars) => stars.tangents(),
            Self::CatmullClark(stars) => stars.tangents(),
        }
    }
}

/// A mesh with the masks of a primal scheme.
struct MaskedMesh<M> {
    mesh: Connectivity,
    starts: Vec<u32>,
    creases: Vec<(u32, f64)>,
    rules: Rules,
    masks: M,
}

impl<M: Masks + Copy> MaskedMesh<M> {
    fn positions(&self) -> Stencils {
        let Self { mesh, starts, creases, rules, masks } = self;
        let (rules, masks) = (*rules, *masks);
        let sharpness = &Sharpness::new(mesh, rules, creases);
        let stars = RingMasks { mesh, sharpness, rules: rules.of_edges(), masks };
        let (rows, _) = Stencils::build(starts.len(), |scratch: &mut Scratch, vertex, rows| {
            stars.limit(scratch, vertex as u32, starts[vertex], rows);
            rows.end();
        });
        rows
    }

    /// Returns two rows of tangents for each side of each vertex, and the index of each vertex's first row.
    fn tangents(&self) -> (Stencils, Column<u32>) {
        let Self { mesh, starts, creases, rules, masks } = self;
        let (rules, masks) = (*rules, *masks);
        let sharpness = &Sharpness::new(mesh, rules, creases);
        let stars = RingMasks { mesh, sharpness, rules: rules.of_edges(), masks };
        Stencils::build(starts.len(), |scratch: &mut Scratch, vertex, rows| {
            stars.tangents(scratch, vertex as u32, starts[vertex], rows);
        })
    }
}

fn check_faces(topology: &Topology) -> Result<(), Error> {
    if topology.rules.scheme.needs_triangles() {
        return Ok(());
    }
    let sides = topology.faces.iter().map(|face| face.len() as f64);
    Ok(ENTRIES.check("the limit of the mesh", sides.map(|sides| sides * sides).sum())?)
}
