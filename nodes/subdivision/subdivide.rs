//! Refines a mesh towards a smooth surface.
//!
//! The part of the work that depends on topology alone is in `refine/step.rs` and memoized: a mesh whose vertices have only moved is
//! refined by products.

use maquette_node::{Carry, Context, Error, Estimate, Fate, In, Node, Previous, Promise, Want};
use maquette_value::Mesh;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::boundary::Boundary;
use super::limit::limit_rows::Limit;
use super::options::Subdivision;
use super::refine::manifold::manifold;
use super::refine::plan::{Before, EndLimit, Plan, bytes};
use super::refine::step::{LastLimit, Step};
use super::scheme::Scheme;
use super::subdivide_error::SubdivideError;

/// Refines a mesh towards a smooth surface.
///
/// New vertices stand behind the old ones, which keep their numbers, but for `DooSabin`, which has a vertex for each corner of a
/// face. Vertex attributes (texture coordinates among them) run
/// straight along old edges and corner attributes within old faces, so that a picture stays where it is; of indices the one
/// at the lower end is taken, and a flag is set between two vertices if it is at one of them. Faces hand their attributes
/// down to their parts. Normals are dropped, because they are no longer right.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Subdivide {
    /// What is refined: a surface, of triangles only for `Loop`. Its creases stay sharp, or soften by 1 a step.
    pub mesh: In<Mesh>,
    /// How it is refined.
    #[serde(flatten)]
    pub how: Subdivision,
    /// Cuts a mesh apart where it is no surface: at edges with more than two faces or with faces that disagree about their side,
    /// and at vertices that join fans of faces. If left out, these are an error.
    #[serde(default)]
    pub split: bool,
}

impl Node for Subdivide {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const WANTS: &'static [Want<Self>] = &[
        Want::new("mesh", "Manifold").when("unless `split`", Self::wants_surface),
        Want::new("mesh", "Oriented").when("unless `split`", Self::wants_surface),
        Want::new("mesh", "Unpinched").when("unless `split`", Self::wants_surface),
        Want::new("mesh", "Triangles").when("with the scheme `Loop`", Self::wants_triangles),
    ];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::from("mesh", "Closed", "mesh").when("unless `split`", |it| !it.split),
        Promise::from("mesh", "Manifold", "mesh"),
        Promise::from("mesh", "Oriented", "mesh"),
        Promise::from("mesh", "Unpinched", "mesh")
            .when("with a `boundary` and a scheme other than `DooSabin`", Self::keeps_fans),
        Promise::from("mesh", "Triangles", "mesh")
            .when("with the scheme `Loop`", |it| it.how.scheme == Scheme::Loop),
        Promise::never("mesh", "Triangles")
            .when("with the scheme `CatmullClark`", Self::makes_quads),
        Promise::from("mesh", "NonEmpty", "mesh")
            .when("with a `boundary`", |it| it.how.boundary != Boundary::None),
    ];

    const CARRIES: &'static [Carry] = &[Carry::each(
        "mesh",
        "mesh",
        [Fate::Interpolated, Fate::Interpolated, Fate::Interpolated, Fate::Kept],
    )];

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let bytes = bytes(cx.get(&self.mesh), self.how);
        Some(Estimate { bytes, help: "choose fewer `levels`" })
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let split = self.split.then(|| manifold(cx.get(&self.mesh))).transpose()?;
        let mesh = split.as_ref().unwrap_or(cx.get(&self.mesh));
        self.warn(mesh, cx);
        let plan = self.plan(mesh, cx)?;
        Ok((plan.apply_within(mesh, cx.progress())?,))
    }

    /// Where only vertices have moved, computes what they reach.
    fn update(
        &self,
        cx: &Context<'_>,
        previous: &Previous<'_>,
    ) -> Result<Option<Self::Outputs>, Error> {
        let mesh = cx.get(&self.mesh);
        let (refined, moved) = (previous.output(0), mesh.moved_since(previous.get(&self.mesh)));
        let (Some(refined), Some(moved), false) = (refined, moved, self.split) else {
            return Ok(None);
        };
        let moved: Vec<_> = moved.vertices.into_iter().flatten().collect();
        self.warn(mesh, cx);
        let plan = self.plan(mesh, cx)?;
        let followed = plan.follow(mesh, &moved, refined, cx.progress())?;
        Ok(followed.map(|mesh| (mesh,)))
    }
}

impl Subdivide {
    /// Tells what of the creases of `mesh` is not as it should be.
    fn warn(&self, mesh: &Mesh, cx: &Context<'_>) {
        let Subdivision { scheme, levels, limit, .. } = self.how;
        if scheme.is_dual() && mesh.creases().len() > 0 {
            cx.warn("the scheme of Doo and Sabin knows no creases; they are dropped");
        }
        if limit
            && mesh
                .creases()
                .any(|(_, sharpness)| f64::from(levels) < sharpness && sharpness < 10.0)
        {
            cx.warn(format!(
                "some creases are still sharp after {levels} levels; their limit is computed as if they stayed so"
            ));
        }
    }

    /// The plan for `mesh`, of which nothing is made twice.
    fn plan(&self, mesh: &Mesh, cx: &Context<'_>) -> Result<Plan, Error> {
        let mut done = 0;
        Plan::with(
            mesh,
            self.how,
            |before: Before<'_>| {
                cx.tick(PLANNING * f64::from(done) / f64::from(self.how.levels.max(1)))?;
                done += 1;
                match before {
                    Before::Nothing(topology) => cx.memo(topology, Step::memo_first),
                    Before::Step(step) => cx.memo(step, Step::memo_next),
                }
            },
            |before: Before<'_>| match before {
                Before::Nothing(topology) => Ok(EndLimit::Control(cx.memo(topology, Limit::memo)?)),
                Before::Step(step) => {
                    cx.tick(PLANNING)?;
                    Ok(EndLimit::Refined(cx.memo(step, LastLimit::memo)?))
                }
            },
        )
    }

    /// Whether anything is done that asks for the surface around each vertex.
    fn wants_surface(&self) -> bool {
        !self.split && (0 < self.how.levels || self.how.limit)
    }

    fn wants_triangles(&self) -> bool {
        self.how.scheme == Scheme::Loop && (0 < self.how.levels || self.how.limit)
    }

    fn makes_quads(&self) -> bool {
        self.how.scheme == Scheme::CatmullClark && 0 < self.how.levels
    }

    fn keeps_fans(&self) -> bool {
        self.how.boundary != Boundary::None && !self.how.scheme.is_dual()
    }
}

/// The share of the time that plans take; about.
const PLANNING: f64 = 0.7;

/// Refines `mesh`. New vertices and faces have a fixed order, in terms of the old vertices, the faces, and the edges as
/// [`Mesh::edges`] gives them; n steps at once give the same as n steps one after the other.
///
/// - `Scheme::Loop`, `Scheme::CatmullClark`: the old vertices, those on the edges, and with the latter those in the faces.
///   Loop makes four faces of each: those at corners 0, 1 and 2, each beginning there, then the one in the middle; Catmull and
///   Clark one at each corner, beginning there. With `Boundary::None` the vertices and faces that are left out are skipped.
/// - `Scheme::DooSabin`: a vertex at each corner of each face; then for each edge of the border, as its face runs, those at
///   1/4 and 3/4 of it. The faces inside the old ones, those across the edges, those around the vertices.
///
/// Positions have the mesh's unit. With `limit` the vertex attribute `normal` holds unit normals, the mean of both sides on
/// a crease. The masks and their sources are in `masks/` and `refine/doo_sabin.rs`.
///
/// # Errors
/// If the scheme cannot refine a face, the mesh is not manifold, or the result would be too large.
pub fn subdivide(mesh: &Mesh, how: Subdivision) -> Result<Mesh, SubdivideError> {
    Plan::new(mesh, how)?.apply(mesh)
}

#[cfg(test)]
mod tests;
