//! Refines a mesh towards a smooth surface.
//!
//! The part of the work that depends only on the topology is in `refine/step.rs` and memoized. If only the positions of vertices change,
//! the mesh is refined by matrix products with the memoized matrices.

use maquette_node::{
    Carry, Context, Error, Estimate, FieldError, Forecast, In, Node, Previous, Promise, Sizes,
    Transfer, Want,
};
use maquette_value::Mesh;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::boundary::Boundary;
use super::limit::limit_rows::Limit;
use super::options::Subdivision;
use super::refine::manifold::manifold;
use super::refine::plan::{EndLimit, Plan, PreviousStep, bytes, bytes_of_size, size_after};
use super::refine::step::{LastLimit, Step};
use super::scheme::Scheme;

/// Refines a mesh towards a smooth surface.
///
/// Old vertices keep their indices, and new ones come after them; only `DooSabin` has instead a vertex for each corner of a face. Vertex
/// attributes (such as texture coordinates) are interpolated linearly along old edges, and corner attributes within old faces, so that a
/// texture does not move, unless `corners` says otherwise. An index attribute takes the value at the end with the lower number; a flag is
/// set if it is set at either end. The parts of a face inherit its attributes. Normals are dropped, because they are no longer valid.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Subdivide {
    /// Mesh to refine. `Loop` and `Butterfly` need triangles. A crease loses 1 of its sharpness per step; from sharpness 10 on it stays
    /// sharp.
    pub mesh: In<Mesh>,
    /// Options of the subdivision.
    #[serde(flatten)]
    pub how: Subdivision,
    /// Cuts the mesh apart where it is not manifold: at edges with more than two faces or with faces of opposite orientation, and at
    /// vertices that join several fans of faces. Without `split` these are errors.
    #[serde(default)]
    pub split: bool,
}

impl Node for Subdivide {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const WANTS: &'static [Want<Self>] = &[
        Want::new("mesh", "Manifold").only_if("unless `split`", Self::wants_surface),
        Want::new("mesh", "Oriented").only_if("unless `split`", Self::wants_surface),
        Want::new("mesh", "Unpinched").only_if("unless `split`", Self::wants_surface),
        Want::new("mesh", "Triangles")
            .only_if("with the scheme `Loop` or `Butterfly`", Self::wants_triangles),
    ];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::from("mesh", "Closed", "mesh").only_if("unless `split`", |it| !it.split),
        Promise::from("mesh", "Manifold", "mesh"),
        Promise::from("mesh", "Oriented", "mesh"),
        Promise::from("mesh", "Unpinched", "mesh")
            .only_if("with a `boundary` and a scheme other than `DooSabin`", Self::keeps_fans),
        Promise::from("mesh", "Triangles", "mesh")
            .only_if("with the scheme `Loop` or `Butterfly`", |it| it.how.scheme.needs_triangles()),
        Promise::never_has("mesh", "Triangles")
            .only_if("with the scheme `CatmullClark`", Self::makes_quads),
        Promise::from("mesh", "NonEmpty", "mesh")
            .only_if("with a `boundary`", |it| it.how.boundary != Boundary::None),
    ];

    const CARRIES: &'static [Carry] = &[Carry::per_domain(
        "mesh",
        "mesh",
        [Transfer::Interpolated, Transfer::Interpolated, Transfer::Interpolated, Transfer::Kept],
    )];

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let bytes = bytes(cx.get(&self.mesh), self.how);
        Some(Estimate { bytes, help: "choose fewer `levels`" })
    }

    fn check(&self) -> Result<(), FieldError> {
        let help = "remove `limit`; the vertices are on the limit surface without it";
        match self.how.limit {
            true => {
                self.how.scheme.check_limit().map_err(|why| FieldError::new("limit", why, help))
            }
            false => Ok(()),
        }
    }

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        let mesh = sizes.get(&self.mesh)?;
        let forecast = Forecast::by_law(size_after(mesh, self.how));
        Some(forecast.with_memory(bytes_of_size(mesh, self.how), "choose fewer `levels`"))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let split = self.split.then(|| manifold(cx.get(&self.mesh))).transpose()?;
        let mesh = split.as_ref().unwrap_or(cx.get(&self.mesh));
        self.warn(mesh, cx);
        let plan = self.plan(mesh, cx)?;
        Ok((plan.apply_within(mesh, cx.progress())?,))
    }

    /// If only vertex positions have changed, recomputes the part of the previous result that depends on the moved vertices. Returns `None`
    /// if a full computation is necessary.
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
    /// Warns if the scheme ignores the creases of `mesh`, or if the limit treats semi-sharp creases as permanent.
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

    /// Returns the subdivision plan for `mesh`. The steps and limit masks of the plan are memoized.
    fn plan(&self, mesh: &Mesh, cx: &Context<'_>) -> Result<Plan, Error> {
        let mut done = 0;
        Plan::new_with(
            mesh,
            self.how,
            |before: PreviousStep<'_>| {
                cx.tick(PLANNING * f64::from(done) / f64::from(self.how.levels.max(1)))?;
                done += 1;
                match before {
                    PreviousStep::Nothing(topology) => cx.memo(topology, Step::memo_first),
                    PreviousStep::Step(step) => cx.memo(step, Step::memo_next),
                }
            },
            |before: PreviousStep<'_>| match before {
                PreviousStep::Nothing(topology) => {
                    Ok(EndLimit::Control(cx.memo(topology, Limit::memo)?))
                }
                PreviousStep::Step(step) => {
                    cx.tick(PLANNING)?;
                    Ok(EndLimit::Refined(cx.memo(step, LastLimit::memo)?))
                }
            },
        )
    }

    /// Returns true if the mesh must be manifold.
    fn wants_surface(&self) -> bool {
        !self.split && (0 < self.how.levels || self.how.limit)
    }

    fn wants_triangles(&self) -> bool {
        self.how.scheme.needs_triangles() && (0 < self.how.levels || self.how.limit)
    }

    fn makes_quads(&self) -> bool {
        self.how.scheme == Scheme::CatmullClark && 0 < self.how.levels
    }

    fn keeps_fans(&self) -> bool {
        self.how.boundary != Boundary::None && !self.how.scheme.is_dual()
    }
}

/// The approximate fraction of a subdivision's running time that is spent on making the plan.
const PLANNING: f64 = 0.7;

/// Refines `mesh`. The order of new vertices and faces follows from the order of the old vertices, of the faces, and of the edges as
/// returned by [`Mesh::edges`]. A call with n levels gives the same result as n calls with one level.
///
/// - `Scheme::Loop`, `Scheme::Butterfly`, `Scheme::CatmullClark`: first the old vertices, then those on edges, then (Catmull-Clark) those
///   in faces. Loop and Butterfly divide a face into four: first the faces at corners 0, 1 and 2, each beginning with its corner, then the
///   middle one. Catmull-Clark makes one face at each corner, beginning with this corner. With `Boundary::None` removed vertices and faces
///   are skipped.
/// - `Scheme::DooSabin`: first a vertex for each corner of each face, then for each border edge two vertices at 1/4 and 3/4 of its length,
///   in the direction of its face. The faces inside old faces come first, then the faces across edges, then the faces around vertices.
///
/// Positions are in mm. With `limit` the vertex attribute `normal` has unit normals; on a crease the normal is the mean of both sides. The
/// masks and their sources are in `masks/` and `refine/doo_sabin.rs`.
///
/// # Errors
/// If the scheme cannot refine a face, the mesh is not manifold, or the result would be too large.
pub fn subdivide(mesh: &Mesh, options: Subdivision) -> Result<Mesh, Error> {
    Plan::new(mesh, options)?.apply(mesh)
}

#[cfg(test)]
mod tests;
