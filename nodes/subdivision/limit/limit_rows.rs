//! Where the vertices of a mesh go if it is subdivided forever, and which way the surface faces there.

use std::ops::Range;

use maquette_base::linear::stencils::Stencils;
use maquette_node::{Error, Limit as Most};
use maquette_value::Memo;
use maquette_value::parallel::*;
use maquette_value::{Attribute, Column, Encoder, Mesh, MeshError};
use nalgebra::{Point3, Vector3};

use super::dual_limit::DualLimit;
use crate::masks::catmull_clark::CatmullClarkMasks;
use crate::masks::closed_rows::closed_rows;
use crate::masks::loop_masks::LoopMasks;
use crate::masks::sharpness::Sharpness;
use crate::masks::stars::{Masks, Scratch, Stars};
use crate::refine::connectivity::Connectivity;
use crate::refine::half_edges::HalfEdges;
use crate::refine::level::{check_triangles, creases};
use crate::refine::topology::Topology;
use crate::rules::Rules;
use crate::{Scheme, SubdivideError};

/// Vertices that one task looks at.
const BLOCK: usize = 4096;

/// Entries of the limit's rows, places and tangents together some 5 GB: a face of `m` corners has some `m` in the row of each of its
/// corners.
const ENTRIES: Most =
    Most { most: 1 << 27, of: "numbers", help: "divide its faces with many corners" };

/// The limit of each vertex of a mesh without tangents: all that it takes to pass through points.
#[derive(Clone, Debug)]
pub(crate) struct LimitPlaces {
    /// What it was made from.
    pub(crate) topology: Topology,
    /// The places, as for [`Limit`].
    pub(crate) positions: Stencils,
}

/// A function of its topology, which therefore stands for it in the hash.
impl Memo for LimitPlaces {
    const NAME: &'static str = "SubdivisionLimitPlaces";

    fn encode(&self, to: &mut Encoder) {
        to.memo(&self.topology);
    }

    fn size(&self) -> usize {
        self.topology.size() + self.positions.size()
    }
}

impl LimitPlaces {
    /// The limit of the scheme that `topology` names.
    ///
    /// # Errors
    /// Those of [`Limit::new`].
    pub(crate) fn new(topology: &Topology) -> Result<Self, SubdivideError> {
        let positions = match closed_rows(topology) {
            Some(rows) => rows,
            None => SchemeLimit::new(topology)?.positions(),
        };
        Ok(Self { topology: topology.clone(), positions })
    }

    /// The same, as [`maquette_node::Context::memo`] wants it.
    pub(crate) fn memo(topology: &Topology) -> Result<Self, Error> {
        Ok(Self::new(topology)?)
    }
}

/// The limit of each vertex of a mesh, as sparse rows in terms of the mesh's own vertices.
#[derive(Clone, Debug)]
pub(crate) struct Limit {
    /// What it was made from.
    pub(crate) topology: Topology,
    /// The places.
    pub(crate) positions: Stencils,
    /// Rows in pairs: two tangents, the first turning counter-clockwise to the second; a pair for each side of a crease.
    pub(crate) tangents: Stencils,
    /// The first row of each vertex in `tangents`, and behind the last vertex the number of rows.
    pub(crate) sides: Column<u32>,
}

/// A function of its topology, which therefore stands for it in the hash.
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
    /// The limit of the scheme that `topology` names.
    ///
    /// # Errors
    /// Faces that the scheme has no rule for, or that are too large, or a mesh that is not manifold.
    pub(crate) fn new(topology: &Topology) -> Result<Self, SubdivideError> {
        let limit = SchemeLimit::new(topology)?;
        let (positions, (tangents, sides)) = (limit.positions(), limit.tangents());
        Ok(Self { topology: topology.clone(), positions, tangents, sides })
    }

    /// The same, as [`maquette_node::Context::memo`] wants it.
    pub(crate) fn memo(topology: &Topology) -> Result<Self, Error> {
        Ok(Self::new(topology)?)
    }

    /// The same mesh with its vertices on the limit surface, and the attribute `normal`.
    ///
    /// # Errors
    /// If a place becomes infinite.
    pub(crate) fn apply(&self, mesh: &Mesh) -> Result<Mesh, MeshError> {
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

/// Writes the normals of the `odd` vertices, each with a half-edge from it, by their pairs of `tangents` and the first row of each; and,
/// of all vertices, those that are zero, because tangents do not span a plane.
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

/// What [`Mesh::vertex_normals`] has for the vertex from which `start` runs.
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

/// The mean of the unit normals of the pairs of tangents in `rows`; as for [`Limit::normal`].
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

/// The limit positions and tangents at the vertices of a mesh, by the rules of its scheme.
enum SchemeLimit {
    Dual(DualLimit),
    Loop(MaskedMesh<LoopMasks>),
    CatmullClark(MaskedMesh<CatmullClarkMasks>),
}

impl SchemeLimit {
    fn new(topology: &Topology) -> Result<Self, SubdivideError> {
        let rules = topology.rules;
        if rules.scheme.needs_triangles() {
            check_triangles(&topology.faces)?;
        }
        check_faces(topology)?;
        let (mesh, starts) = Connectivity::new(&topology.faces, topology.vertices)?;
        let creases = creases(topology, &mesh);
        Ok(match rules.scheme {
            Scheme::DooSabin => Self::Dual(DualLimit::new(mesh, starts, rules.boundary)),
            Scheme::Loop => {
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
            Self::Dual(limit) => limit.positions(&limit.all()),
            Self::Loop(stars) => stars.positions(),
            Self::CatmullClark(stars) => stars.positions(),
        }
    }

    fn tangents(&self) -> (Stencils, Column<u32>) {
        match self {
            Self::Dual(limit) => limit.tangents(&limit.all()),
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
        let stars = Stars { mesh, sharpness, rules: rules.of_edges(), masks };
        let (rows, _) = Stencils::build(starts.len(), |scratch: &mut Scratch, vertex, rows| {
            stars.limit(scratch, vertex as u32, starts[vertex], rows);
            rows.end();
        });
        rows
    }

    /// Two rows for each side of each vertex, and the first row of each.
    fn tangents(&self) -> (Stencils, Column<u32>) {
        let Self { mesh, starts, creases, rules, masks } = self;
        let (rules, masks) = (*rules, *masks);
        let sharpness = &Sharpness::new(mesh, rules, creases);
        let stars = Stars { mesh, sharpness, rules: rules.of_edges(), masks };
        Stencils::build(starts.len(), |scratch: &mut Scratch, vertex, rows| {
            stars.tangents(scratch, vertex as u32, starts[vertex], rows);
        })
    }
}

fn check_faces(topology: &Topology) -> Result<(), SubdivideError> {
    if topology.rules.scheme.needs_triangles() {
        return Ok(());
    }
    let sides = topology.faces.iter().map(|face| face.len() as f64);
    Ok(ENTRIES.check("the limit of the mesh", sides.map(|sides| sides * sides).sum())?)
}
