//! Subdivision plans: the part of a subdivision that depends only on the topology.

use maquette_node::{CancelledError, Error, Limit as Most, Progress, ValueSize, bail};
use maquette_value::Value;
use maquette_value::{Attribute, Mesh};

use super::local::LocalRefinement;
use super::moving_vertices::MovingVertices;
use super::primal::Primal;
use super::smooth_corners::smooth_corners;
use super::step::{LastLimit, Step};
use super::topology::Topology;
use super::without_border::without_border;
use crate::boundary::Boundary;
use crate::corners::Corners;
use crate::limit::limit_rows::Limit;
use crate::options::Subdivision;
use crate::scheme::Scheme;

/// The maximum number of corners of a result: enough for about 90 million triangles, which need about 6 GB with their plan.
const MAX_CORNERS: Most = Most { max: 1 << 28, items: "corners", help: "choose fewer `levels`" };

/// The input from which a step is created: the topology for the first step, or the previous step.
pub(crate) enum PreviousStep<'a> {
    Nothing(&'a Topology),
    Step(&'a Step),
}

/// A subdivision plan: the part of a subdivision that depends only on the topology. It can be applied to every mesh of this topology.
pub struct Plan {
    options: Subdivision,
    topology: Topology,
    steps: Vec<Step>,
    limit: Option<EndLimit>,
}

/// The limit masks that are applied after the last step.
pub(crate) enum EndLimit {
    Control(Limit),
    Refined(LastLimit),
}

impl Plan {
    /// Creates the plan for the faces, creases and number of vertices of `mesh`.
    ///
    /// # Errors
    /// If the scheme cannot refine a face, the mesh is not manifold, or the result would be too large.
    pub fn new(mesh: &Mesh, options: Subdivision) -> Result<Self, Error> {
        Self::new_with(
            mesh,
            options,
            |before: PreviousStep<'_>| match before {
                PreviousStep::Nothing(topology) => Step::from_topology(topology),
                PreviousStep::Step(step) => step.next(),
            },
            |before| match before {
                PreviousStep::Nothing(topology) => Ok(EndLimit::Control(Limit::new(topology)?)),
                PreviousStep::Step(step) => Ok(EndLimit::Refined(LastLimit::new(step)?)),
            },
        )
    }

    /// Creates the plan like [`Self::new`]. `step` creates a refinement step, and `limit` the limit masks; both may look up memoized
    /// results.
    pub(crate) fn new_with(
        mesh: &Mesh,
        options: Subdivision,
        mut step: impl FnMut(PreviousStep<'_>) -> Result<Step, Error>,
        limit: impl FnOnce(PreviousStep<'_>) -> Result<EndLimit, Error>,
    ) -> Result<Self, Error> {
        check_size(mesh, options.levels)?;
        if options.limit {
            options.scheme.check_limit()?;
        }
        let topology = Topology::from_mesh(mesh, options);
        let mut steps: Vec<Step> = Vec::with_capacity(options.levels as usize);
        for _ in 0..options.levels {
            steps.push(step(
                steps.last().map_or(PreviousStep::Nothing(&topology), PreviousStep::Step),
            )?);
        }
        let end = steps.last().map_or(PreviousStep::Nothing(&topology), PreviousStep::Step);
        let limit = options.limit.then(|| limit(end)).transpose()?;
        Ok(Self { options, topology, steps, limit })
    }

    /// Refines `mesh` as [`subdivide`](crate::subdivide()) does.
    ///
    /// # Errors
    /// If the topology of `mesh` is not that of the plan, or a position becomes infinite.
    pub fn apply(&self, mesh: &Mesh) -> Result<Mesh, Error> {
        self.apply_within(mesh, &Progress::silent())
    }

    /// Refines `mesh` like [`apply`](Self::apply), with progress reports and cancellation.
    ///
    /// # Errors
    /// If the topology of `mesh` is not that of the plan, a position becomes infinite, or the evaluation is cancelled.
    pub(crate) fn apply_within(&self, mesh: &Mesh, progress: &Progress<'_>) -> Result<Mesh, Error> {
        let Self { options, steps, limit, .. } = self;
        self.check(mesh)?;
        let mut refined = apply(mesh, steps, progress)?;
        progress.tick(0.9)?;
        if options.corners == Corners::Smooth && !options.scheme.is_dual() && !steps.is_empty() {
            refined = smooth_corners(mesh, *options, steps, refined)?;
        }
        progress.check()?;
        refined = match limit {
            Some(EndLimit::Control(limit)) => limit.apply(&refined)?,
            Some(EndLimit::Refined(limit)) => limit.apply(&refined)?,
            None => refined,
        };
        progress.check()?;
        if options.boundary == Boundary::None && !options.scheme.is_dual() {
            refined = without_border(mesh, &ancestors(mesh, steps), &refined)?;
        }
        Ok(refined)
    }

    /// Updates `refined`, an earlier result of [`apply_within`](Self::apply_within). The new mesh must differ from the earlier one only in
    /// the positions of the vertices `moved`, in its picture and in its frame. Returns `None` if a full refinement is necessary.
    ///
    /// # Errors
    /// If the evaluation is cancelled.
    pub(crate) fn follow(
        &self,
        mesh: &Mesh,
        moved: &[u32],
        refined: &Mesh,
        progress: &Progress<'_>,
    ) -> Result<Option<Mesh>, CancelledError> {
        let has_border = self.options.boundary != Boundary::None;
        let steps = self.primal_steps().filter(|_| has_border).unwrap_or_default();
        let Some((last, before)) = steps.split_last() else { return Ok(None) };
        let front = |wider| LocalRefinement::new(mesh.faces(), mesh.positions(), moved, wider);
        // If a position is not finite, `None` is returned, and the full refinement that follows reports the error.
        let followed = match &self.limit {
            None => {
                let mut front = front(0);
                front.take(before, progress)?;
                front.end(last, refined).ok()
            }
            Some(EndLimit::Refined(limit)) => {
                // A normal may depend on the faces around its vertex, so the core (the recomputed faces) must be wider by one ring.
                let mut front = front(1);
                front.take(&steps, progress)?;
                limit.follow(front.core(), front.positions(), refined)
            }
            Some(EndLimit::Control(_)) => None,
        };
        Ok(followed.map(|followed| {
            followed.with_materials(mesh.materials().clone()).with_frame(mesh.frame().copied())
        }))
    }

    /// Returns the steps as steps of an approximating primal scheme; `None` for other schemes.
    pub(crate) fn primal_steps(&self) -> Option<Vec<&Primal>> {
        self.steps.iter().map(Step::primal).collect()
    }

    /// Creates the positions of the vertices after the last step, which can be updated when vertices of `mesh` move. They are not moved to
    /// the limit surface, and border faces are not removed.
    ///
    /// # Errors
    /// If the topology of `mesh` is not that of the plan.
    pub fn moving_vertices(&self, mesh: &Mesh) -> Result<MovingVertices<'_>, Error> {
        self.check(mesh)?;
        Ok(MovingVertices::new(&self.steps, mesh.positions()))
    }

    fn check(&self, mesh: &Mesh) -> Result<(), Error> {
        let topology = &self.topology;
        if mesh.positions().len() == topology.vertices
            && *mesh.faces() == topology.faces
            && mesh.creases().eq(topology.creases.iter().copied())
        {
            return Ok(());
        }
        bail!("the plan was made for a mesh with another topology")
    }
}

/// Refines the positions and attributes of a mesh step by step.
///
/// # Errors
/// If a position becomes infinite, or the evaluation is cancelled.
pub(crate) fn apply(mesh: &Mesh, steps: &[Step], progress: &Progress<'_>) -> Result<Mesh, Error> {
    let Some((first, later)) = steps.split_first() else {
        return Ok(mesh.clone());
    };
    let last = later.last().unwrap_or(first);
    let mut positions = first.positions(mesh.positions());
    for step in later {
        progress.check()?;
        positions = step.positions(&positions);
    }
    progress.check()?;
    let refined = Mesh::new(positions, last.finer().clone())?;
    progress.check()?;
    let mut refined = refined
        .with_creases(last.finer_creases())?
        .with_materials(mesh.materials().clone())
        .with_frame(mesh.frame().copied());
    for (name, attribute) in mesh.vertex().iter().filter(|(name, _)| *name != "normal") {
        let attribute = refine_attribute(attribute, steps, Step::vertex_attribute, progress)?;
        refined = refined.with_vertex(name, attribute)?;
    }
    for (name, attribute) in mesh.corner().iter().filter(|(name, _)| *name != "normal") {
        let attribute = refine_attribute(attribute, steps, Step::corner_attribute, progress)?;
        refined = refined.with_corner(name, attribute)?;
    }
    if mesh.face().iter().next().is_some() {
        let ancestors = ancestors(mesh, steps);
        for (name, attribute) in mesh.face().iter() {
            progress.check()?;
            refined = refined.with_face(name, attribute.select(&ancestors))?;
        }
    }
    Ok(refined)
}

/// Refines an attribute in all steps, each time by `refine`.
fn refine_attribute(
    attribute: &Attribute,
    steps: &[Step],
    refine: fn(&Step, &Attribute) -> Attribute,
    progress: &Progress<'_>,
) -> Result<Attribute, CancelledError> {
    let mut attribute = attribute.clone();
    for (k, step) in steps.iter().enumerate() {
        if k > 0 {
            progress.check()?;
        }
        attribute = refine(step, &attribute);
    }
    Ok(attribute)
}

/// Returns, for each face after the last step, the index of the face of `mesh` from which it was made.
fn ancestors(mesh: &Mesh, steps: &[Step]) -> Vec<u32> {
    let first = (0..mesh.faces().len() as u32).collect();
    steps.iter().fold(first, |ancestors: Vec<u32>, step| {
        step.parents().iter().map(|&parent| ancestors[parent as usize]).collect()
    })
}

/// The number of corners of a mesh after `levels` steps.
fn corners_after(mesh: &Mesh, levels: u32) -> f64 {
    mesh.faces().corners().len() as f64 * libm::exp2(2.0 * f64::from(levels))
}

/// Returns an upper bound of the memory for refining a mesh, including its plan, in bytes.
pub(crate) fn bytes(mesh: &Mesh, options: Subdivision) -> f64 {
    let all = mesh.clone().with_materials([]).size();
    let own = mesh.positions().size() + mesh.faces().corners().len() * size_of::<u32>();
    bytes_for(corners_after(mesh, options.levels), all.saturating_sub(own) as f64, options)
}

/// Returns the memory in bytes for refining a mesh of this size.
pub(crate) fn bytes_of_size(mesh: ValueSize, options: Subdivision) -> f64 {
    let factor = libm::exp2(2.0 * f64::from(options.levels));
    bytes_for(mesh.corners * factor, attribute_bytes(mesh), options)
}

/// Returns the memory in bytes of the attributes of a mesh of this size.
fn attribute_bytes(mesh: ValueSize) -> f64 {
    (mesh.bytes - ValueSize::mesh(mesh.points, mesh.faces, mesh.corners).bytes).max(0.0)
}

/// Returns the size of a mesh after it is refined. The numbers of vertices and faces follow from Euler's formula, because a step does not
/// change `vertices - edges + faces`; for a mesh with borders they are a little smaller than the true ones.
pub(crate) fn size_after(mesh: ValueSize, options: Subdivision) -> ValueSize {
    if options.levels == 0 {
        return mesh;
    }
    let factor = libm::exp2(2.0 * f64::from(options.levels));
    let corners = mesh.corners * factor;
    let characteristic = mesh.points - mesh.corners / 2.0 + mesh.faces;
    let (vertices, faces) = match options.scheme {
        Scheme::Loop | Scheme::Butterfly => (corners / 6.0 + characteristic, corners / 3.0),
        Scheme::CatmullClark => (corners / 4.0 + characteristic, corners / 4.0),
        Scheme::DooSabin => (corners / 4.0, corners / 4.0 + characteristic),
    };
    let normals = if options.limit { 24.0 * vertices } else { 0.0 };
    let size = ValueSize::mesh(vertices.max(0.0), faces.max(0.0), corners);
    size.with_more_bytes(normals + factor * attribute_bytes(mesh)).at_most(mesh.certainty)
}

/// Returns the memory in bytes for refining a mesh to this number of corners. `attributes` is the memory of its attributes.
fn bytes_for(corners_after: f64, attributes: f64, options: Subdivision) -> f64 {
    let Subdivision { scheme, levels, limit, boundary, corners, .. } = options;
    // Measured bytes per corner. The limit needs additional matrix rows and normals.
    let (plain, of_limit) = match scheme {
        Scheme::DooSabin => (34.0, 56.0),
        Scheme::Butterfly => (55.0, 0.0),
        Scheme::Loop | Scheme::CatmullClark => (20.0, 17.0),
    };
    let extra =
        [(limit, of_limit), (boundary == Boundary::None, 15.0), (corners == Corners::Smooth, 10.0)];
    let extra: f64 = extra.iter().filter(|(is_so, _)| *is_so).map(|(_, bytes)| bytes).sum();
    // The size of attributes is proportional to the number of corners, and two copies exist during the transfer.
    let attributes = 2.5 * attributes * libm::exp2(2.0 * f64::from(levels));
    corners_after * (plain + extra) + attributes
}

fn check_size(mesh: &Mesh, levels: u32) -> Result<(), Error> {
    let need = corners_after(mesh, levels);
    Ok(MAX_CORNERS.check(format_args!("a mesh of {levels} levels more"), need)?)
}
