//! Refines a mesh towards a smooth surface.
//!
//! The part of the work that depends on topology alone is in `plan.rs` and memoized: a mesh whose vertices have only moved is
//! refined by sparse products.

use maquette::value::{Faces, Mesh, MeshError};
use maquette::{Context, Error, In, Node};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::plan::{Limit, Step, Topology};

/// Refines a mesh towards a smooth surface.
///
/// New vertices stand behind the old ones, which keep their numbers. Vertex attributes (texture coordinates among them) run
/// straight along old edges and corner attributes within old faces, so that a picture stays where it is; of indices the one
/// at the lower end is taken, and a flag is set between two vertices if it is at one of them. Faces hand their attributes
/// down to their parts. Normals are dropped, because they are no longer right.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Subdivide {
    /// What is refined: manifold, with triangles only for `Loop`. Its creases stay sharp, or soften by 1 a step.
    pub mesh: In<Mesh>,
    /// The rules.
    pub scheme: Scheme,
    /// How often each face is split; each step makes four times as many faces.
    #[schemars(range(max = 8))]
    #[serde(default = "two")]
    pub levels: u32,
    /// Moves the vertices on to where they would be after endless steps, and adds the surface's normals.
    #[serde(default)]
    pub limit: bool,
    /// What happens at the border of an open mesh.
    #[serde(default)]
    pub boundary: Boundary,
}

fn two() -> u32 {
    2
}

/// The rules of a subdivision.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Scheme {
    /// Loop (1987): triangles, which become box splines.
    Loop,
}

/// What happens at the border of an open mesh. The words are those of USD and OpenSubdiv.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Boundary {
    /// The border becomes a smooth curve, which passes through the vertices that have only one face.
    #[default]
    EdgeAndCorner,
    /// The whole border becomes a smooth curve.
    EdgeOnly,
    /// Faces that touch the border only support their neighbors and are left out of the result.
    None,
}

/// How a mesh is to be refined; the fields are those of [`Subdivide`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Subdivision {
    /// The rules.
    pub scheme: Scheme,
    /// Number of steps.
    pub levels: u32,
    /// Whether the vertices go on to the limit surface.
    pub limit: bool,
    /// What happens at the border.
    pub boundary: Boundary,
}

/// Why a mesh cannot be refined.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SubdivideError {
    /// A face that the scheme has no rule for.
    #[error("face {face} has {corners} corners, but Loop's scheme needs triangles")]
    NotTriangles {
        /// The first such face.
        face: usize,
        /// Its corners.
        corners: usize,
    },
    /// Edges with more than two faces or with faces of opposite orientation, or vertices at which several fans of faces meet.
    #[error(
        "the mesh is not a surface: {edges} edges have more than two faces or faces that disagree about their side, \
         {vertices} vertices join fans of faces; the first are the {first}"
    )]
    NonManifold {
        /// Number of bad edges.
        edges: usize,
        /// Number of bad vertices; not counted if there are bad edges.
        vertices: usize,
        /// The first few of them.
        first: String,
    },
    /// A result that memory could not hold.
    #[error(
        "{levels} levels would make {faces} faces with 4 to the power of {levels} parts each, which is too large"
    )]
    TooLarge {
        /// Number of steps.
        levels: u32,
        /// Number of faces before the first.
        faces: usize,
    },
    /// A place became infinite.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

/// Most corners that a result may have: some 90 million triangles, which with their plan take about 6 GB.
const MOST_CORNERS: usize = 1 << 28;

impl Node for Subdivide {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        let Self { scheme, levels, limit, boundary, .. } = *self;
        let softens = |(_, sharpness)| f64::from(levels) < sharpness && sharpness < 10.0;
        if limit && mesh.creases().any(softens) {
            cx.warn(format!(
                "some creases are still sharp after {levels} levels; their limit is computed as if they stayed so"
            ));
        }
        let mut done = 0;
        let step = |topology: &Topology| {
            cx.tick(f64::from(done) / f64::from(levels.max(1)))?;
            done += 1;
            cx.memo(topology, Step::memo)
        };
        let limits = |topology: &Topology| cx.memo(topology, Limit::memo);
        let how = Subdivision { scheme, levels, limit, boundary };
        Ok((subdivide_with::<Error>(mesh, how, step, limits)?,))
    }
}

/// Refines `mesh`. New vertices are the old ones, then the midpoints of the edges in the order of [`Mesh::edges`]; new
/// faces are four for each old one in their order: those at corners 0, 1 and 2, then the one in the middle. With
/// [`Boundary::None`] the vertices and faces that are left out are skipped in these orders.
///
/// Positions have the mesh's unit. With `limit` the vertex attribute `normal` holds unit normals, the mean of both sides on
/// a crease. Loop, "Smooth subdivision surfaces based on triangles" (1987); the masks are in `loop_masks.rs`.
///
/// # Errors
/// If a face is no triangle, the mesh is not manifold, or the result would be too large.
pub fn subdivide(mesh: &Mesh, how: Subdivision) -> Result<Mesh, SubdivideError> {
    subdivide_with(mesh, how, Step::new, Limit::new)
}

/// [`subdivide`] with plans from `step` and `limits`.
fn subdivide_with<E: From<SubdivideError>>(
    mesh: &Mesh,
    how: Subdivision,
    mut step: impl FnMut(&Topology) -> Result<Step, E>,
    limits: impl FnOnce(&Topology) -> Result<Limit, E>,
) -> Result<Mesh, E> {
    check_size(mesh, how.levels)?;
    let mut topology = Topology {
        scheme: how.scheme,
        boundary: how.boundary,
        vertices: mesh.positions().len(),
        faces: mesh.faces().clone(),
        creases: mesh.creases().collect(),
    };
    let mut refined = mesh.clone();
    let mut ancestors: Vec<u32> = (0..mesh.faces().len() as u32).collect();
    for _ in 0..how.levels {
        let step = step(&topology)?;
        refined = step.apply(&refined).map_err(SubdivideError::from)?;
        if how.boundary == Boundary::None {
            ancestors = step.parents().iter().map(|&parent| ancestors[parent as usize]).collect();
        }
        topology = step.refined();
    }
    if how.limit {
        refined = limits(&topology)?.apply(&refined).map_err(SubdivideError::from)?;
    }
    if how.boundary == Boundary::None {
        refined = without_border(mesh, &ancestors, &refined).map_err(SubdivideError::from)?;
    }
    Ok(refined)
}

fn check_size(mesh: &Mesh, levels: u32) -> Result<(), SubdivideError> {
    let growth = 4usize.checked_pow(levels);
    let corners = growth.and_then(|growth| mesh.faces().corners().len().checked_mul(growth));
    match corners {
        Some(corners) if corners <= MOST_CORNERS => Ok(()),
        _ => Err(SubdivideError::TooLarge { levels, faces: mesh.faces().len() }),
    }
}

/// `refined` without the faces whose ancestor in `mesh` touches the border, and without the vertices that then have no face.
fn without_border(mesh: &Mesh, ancestors: &[u32], refined: &Mesh) -> Result<Mesh, MeshError> {
    let edges = mesh.edges();
    let mut on_border = vec![false; mesh.positions().len()];
    let border = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
    border.flat_map(|(ends, _)| ends).for_each(|&end| on_border[end as usize] = true);
    let touches: Vec<bool> =
        mesh.faces().iter().map(|face| face.iter().any(|&v| on_border[v as usize])).collect();
    let kept = |face: &u32| !touches[ancestors[*face as usize] as usize];
    let faces: Vec<u32> = (0..refined.faces().len() as u32).filter(kept).collect();
    select_faces(refined, &faces)
}

/// The faces with these indices, and the vertices that they name, both in their old order.
fn select_faces(mesh: &Mesh, faces: &[u32]) -> Result<Mesh, MeshError> {
    const GONE: u32 = u32::MAX;
    let old = mesh.faces();
    let places: Vec<u32> = faces
        .iter()
        .map(|&face| face as usize)
        .flat_map(|face| (old.first_corner(face) as u32..).take(old.face(face).len()))
        .collect();
    let mut renamed = vec![GONE; mesh.positions().len()];
    places.iter().for_each(|&place| renamed[old.corners()[place as usize] as usize] = 0);
    let vertices: Vec<u32> =
        (0..renamed.len() as u32).filter(|&vertex| renamed[vertex as usize] != GONE).collect();
    (0..).zip(&vertices).for_each(|(new, &old)| renamed[old as usize] = new);
    let sides: Vec<usize> = faces.iter().map(|&face| old.face(face as usize).len()).collect();
    let corners = places.iter().map(|&place| renamed[old.corners()[place as usize] as usize]);
    let positions: Vec<_> = vertices.iter().map(|&v| mesh.positions()[v as usize]).collect();
    let creases = mesh
        .creases()
        .map(|(ends, sharpness)| (ends.map(|end| renamed[end as usize]), sharpness))
        .filter(|(ends, _)| !ends.contains(&GONE));
    let mut selected = Mesh::new(positions, Faces::polygons(&sides, corners.collect())?)?
        .with_creases(creases)
        .with_texture(mesh.texture().cloned())
        .with_frame(mesh.frame().copied());
    for (name, attribute) in mesh.vertex().iter() {
        selected = selected.with_vertex(name, attribute.select(&vertices))?;
    }
    for (name, attribute) in mesh.corner().iter() {
        selected = selected.with_corner(name, attribute.select(&places))?;
    }
    for (name, attribute) in mesh.face().iter() {
        selected = selected.with_face(name, attribute.select(faces))?;
    }
    Ok(selected)
}

#[cfg(test)]
mod tests;
