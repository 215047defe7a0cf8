//! What of a subdivision depends on topology alone, and its products.

use maquette_node::{Cancelled, Limit as Most, Progress};
use maquette_value::Value;
use maquette_value::{Attribute, Mesh};

use super::live::Live;
use super::local::Front;
use super::primal::Primal;
use super::smooth_corners::smooth_corners;
use super::step::{LastLimit, Step};
use super::topology::Topology;
use super::without_border::without_border;
use crate::boundary::Boundary;
use crate::corners::Corners;
use crate::limit::limit_rows::Limit;
use crate::options::Subdivision;
use crate::subdivide_error::SubdivideError;

/// Corners of a result: some 90 million triangles, which with their plan take about 6 GB.
const CORNERS: Most = Most { most: 1 << 28, of: "corners", help: "choose fewer `levels`" };

/// What a step comes after.
pub(crate) enum Before<'a> {
    Nothing(&'a Topology),
    Step(&'a Step),
}

/// What of a subdivision depends on the topology of a mesh alone: made once, applied to every mesh of this topology.
pub struct Plan {
    how: Subdivision,
    topology: Topology,
    steps: Vec<Step>,
    limit: Option<EndLimit>,
}

/// The limit of the last vertices.
pub(crate) enum EndLimit {
    Control(Limit),
    Refined(LastLimit),
}

impl Plan {
    /// The plan for the faces, creases and number of vertices of `mesh`.
    ///
    /// # Errors
    /// If the scheme cannot refine a face, the mesh is not manifold, or the result would be too large.
    pub fn new(mesh: &Mesh, how: Subdivision) -> Result<Self, SubdivideError> {
        Self::with(
            mesh,
            how,
            |before: Before<'_>| match before {
                Before::Nothing(topology) => Step::first(topology),
                Before::Step(step) => step.next(),
            },
            |before| match before {
                Before::Nothing(topology) => Ok(EndLimit::Control(Limit::new(topology)?)),
                Before::Step(step) => Ok(EndLimit::Refined(LastLimit::new(step)?)),
            },
        )
    }

    /// [`Self::new`] with parts from `step` and `limit`.
    pub(crate) fn with<E: From<SubdivideError>>(
        mesh: &Mesh,
        how: Subdivision,
        mut step: impl FnMut(Before<'_>) -> Result<Step, E>,
        limit: impl FnOnce(Before<'_>) -> Result<EndLimit, E>,
    ) -> Result<Self, E> {
        check_size(mesh, how.levels)?;
        let topology = Topology::of(mesh, how);
        let mut steps: Vec<Step> = Vec::with_capacity(how.levels as usize);
        for _ in 0..how.levels {
            steps.push(step(steps.last().map_or(Before::Nothing(&topology), Before::Step))?);
        }
        let end = steps.last().map_or(Before::Nothing(&topology), Before::Step);
        let limit = how.limit.then(|| limit(end)).transpose()?;
        Ok(Self { how, topology, steps, limit })
    }

    /// Refines `mesh` as [`subdivide`](crate::subdivide()) does.
    ///
    /// # Errors
    /// If its topology is not that of the plan, or a place becomes infinite.
    pub fn apply(&self, mesh: &Mesh) -> Result<Mesh, SubdivideError> {
        self.apply_within(mesh, &Progress::none())
    }

    /// As [`apply`](Self::apply).
    ///
    /// # Errors
    /// If its topology is not that of the plan, a place becomes infinite, or the evaluation is told to stop.
    pub(crate) fn apply_within(
        &self,
        mesh: &Mesh,
        progress: &Progress<'_>,
    ) -> Result<Mesh, SubdivideError> {
        let Self { how, steps, limit, .. } = self;
        self.check(mesh)?;
        let mut refined = apply(mesh, steps, progress)?;
        progress.tick(0.9)?;
        if how.corners == Corners::Smooth && !how.scheme.is_dual() && !steps.is_empty() {
            refined = smooth_corners(mesh, *how, refined)?;
        }
        progress.check()?;
        refined = match limit {
            Some(EndLimit::Control(limit)) => limit.apply(&refined)?,
            Some(EndLimit::Refined(limit)) => limit.apply(&refined)?,
            None => refined,
        };
        progress.check()?;
        if how.boundary == Boundary::None && !how.scheme.is_dual() {
            refined = without_border(mesh, &ancestors(mesh, steps), &refined)?;
        }
        Ok(refined)
    }

    /// What [`apply_within`](Self::apply_within) makes of `mesh`, made of what it made, `refined`, of a mesh that differs at most in the
    /// places of the vertices that have `moved`, in its picture and its frame. None if only the whole product can tell.
    ///
    /// # Errors
    /// If the evaluation is told to stop.
    pub(crate) fn follow(
        &self,
        mesh: &Mesh,
        moved: &[u32],
        refined: &Mesh,
        progress: &Progress<'_>,
    ) -> Result<Option<Mesh>, Cancelled> {
        let has_border = self.how.boundary != Boundary::None;
        let steps = self.primal_steps().filter(|_| has_border).unwrap_or_default();
        let Some((last, before)) = steps.split_last() else { return Ok(None) };
        let front = |wider| Front::new(mesh.faces(), mesh.positions(), moved, wider);
        // A place that is not finite is told of by the whole product.
        let followed = match &self.limit {
            None => {
                let mut front = front(0);
                front.take(before, progress)?;
                front.end(last, refined).ok()
            }
            Some(EndLimit::Refined(limit)) => {
                // Normals may be those of the faces around.
                let mut front = front(1);
                front.take(&steps, progress)?;
                limit.follow(front.core(), front.places(), refined)
            }
            Some(EndLimit::Control(_)) => None,
        };
        Ok(followed.map(|followed| {
            followed.with_materials(mesh.materials().clone()).with_frame(mesh.frame().copied())
        }))
    }

    /// Its steps, if the scheme is primal.
    pub(crate) fn primal_steps(&self) -> Option<Vec<&Primal>> {
        self.steps.iter().map(Step::primal).collect()
    }

    /// The vertices after the last step, which follow those of `mesh` one by one; before they go on to the limit, and before what
    /// touches the border is left out.
    ///
    /// # Errors
    /// If the topology of `mesh` is not that of the plan.
    pub fn live(&self, mesh: &Mesh) -> Result<Live<'_>, SubdivideError> {
        self.check(mesh)?;
        Ok(Live::new(&self.steps, mesh.positions()))
    }

    fn check(&self, mesh: &Mesh) -> Result<(), SubdivideError> {
        let topology = &self.topology;
        if mesh.positions().len() == topology.vertices
            && *mesh.faces() == topology.faces
            && mesh.creases().eq(topology.creases.iter().copied())
        {
            return Ok(());
        }
        Err(SubdivideError::OtherTopology)
    }
}

/// Refines the positions and attributes of a mesh step by step.
///
/// # Errors
/// If a place becomes infinite, or the evaluation is told to stop.
pub(crate) fn apply(
    mesh: &Mesh,
    steps: &[Step],
    progress: &Progress<'_>,
) -> Result<Mesh, SubdivideError> {
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
    let all = |attribute: &Attribute, carry: fn(&Step, &Attribute) -> Attribute| {
        later.iter().try_fold(carry(first, attribute), |carried, step| {
            progress.check()?;
            Ok::<_, SubdivideError>(carry(step, &carried))
        })
    };
    for (name, attribute) in mesh.vertex().iter().filter(|(name, _)| *name != "normal") {
        refined = refined.with_vertex(name, all(attribute, Step::vertex_attribute)?)?;
    }
    for (name, attribute) in mesh.corner().iter().filter(|(name, _)| *name != "normal") {
        refined = refined.with_corner(name, all(attribute, Step::corner_attribute)?)?;
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

/// The face of `mesh` from which each face comes that the last step makes.
fn ancestors(mesh: &Mesh, steps: &[Step]) -> Vec<u32> {
    let first = (0..mesh.faces().len() as u32).collect();
    steps.iter().fold(first, |ancestors: Vec<u32>, step| {
        step.parents().iter().map(|&parent| ancestors[parent as usize]).collect()
    })
}

/// How many corners a mesh has after so many levels.
fn corners_after(mesh: &Mesh, levels: u32) -> f64 {
    mesh.faces().corners().len() as f64 * libm::exp2(2.0 * f64::from(levels))
}

/// Bytes that refining a mesh takes at most, with its plan.
pub(crate) fn bytes(mesh: &Mesh, how: Subdivision) -> f64 {
    let Subdivision { scheme, levels, limit, boundary, corners, .. } = how;
    // As measured; for the limit there are rows of numbers, and normals.
    let (plain, of_limit) = if scheme.is_dual() { (34.0, 56.0) } else { (20.0, 17.0) };
    let extra =
        [(limit, of_limit), (boundary == Boundary::None, 15.0), (corners == Corners::Smooth, 10.0)];
    let extra: f64 = extra.iter().filter(|(is_so, _)| *is_so).map(|(_, bytes)| bytes).sum();
    // Attributes become as many times more as corners, and are there twice while they are carried over.
    let faces = mesh.clone().with_materials([]).size();
    let own = mesh.positions().size() + mesh.faces().corners().len() * size_of::<u32>();
    let attributes = 2.5 * faces.saturating_sub(own) as f64 * libm::exp2(2.0 * f64::from(levels));
    corners_after(mesh, levels) * (plain + extra) + attributes
}

fn check_size(mesh: &Mesh, levels: u32) -> Result<(), SubdivideError> {
    let need = corners_after(mesh, levels);
    Ok(CORNERS.check(format_args!("a mesh of {levels} levels more"), need)?)
}
