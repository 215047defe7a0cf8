//! One step of a subdivision: the part that depends only on the topology, and its application to positions and attributes.
//!
//! The terms of each new position are added in a fixed order, so the result does not depend on the number of threads.

use std::ops::Range;
use std::sync::Arc;

use maquette_base::linear::attribute_transfer::AttributeTransfer;
use maquette_base::linear::weighted_mean::WeightedMean;
use maquette_node::{Error, bail};
use maquette_value::Memo;
use maquette_value::{Attribute, Encoder, Faces, Mesh, MeshError};
use nalgebra::Point3;

use super::butterfly::Butterfly;
use super::doo_sabin::Dual;
use super::level::Level;
use super::primal::Primal;
use super::topology::Topology;
use crate::limit::finer_dual_limit::FinerDualLimit;
use crate::limit::finer_limit::FinerLimit;
use crate::scheme::{PrimalScheme, Scheme};

/// One step of a subdivision.
#[derive(Clone, Debug)]
pub(crate) struct Step {
    /// The topology of the control mesh.
    root: Arc<Topology>,
    /// The number of refinement steps that precede this step.
    depth: usize,
    rules: Kind,
}

#[derive(Clone, Debug)]
enum Kind {
    Primal(Arc<Primal>),
    Dual(Arc<Dual>),
    Butterfly(Arc<Butterfly>),
}

/// A step is a function of the topology and the depth, so only these two are encoded for the hash.
impl Memo for Step {
    const NAME: &'static str = "SubdivisionStep";

    fn encode(&self, to: &mut Encoder) {
        to.memo(&*self.root).counts(&[self.depth]);
    }

    fn size(&self) -> usize {
        let rules = match &self.rules {
            Kind::Primal(step) => step.size(),
            Kind::Dual(step) => step.size(),
            Kind::Butterfly(step) => step.size(),
        };
        rules + self.root.size()
    }
}

impl Step {
    /// Computes the first refinement step of a subdivision, by the scheme in `topology`.
    ///
    /// # Errors
    /// If the scheme cannot refine a face, or the mesh is not manifold.
    pub(crate) fn from_topology(topology: &Topology) -> Result<Self, Error> {
        fn primal(topology: &Topology, scheme: PrimalScheme) -> Result<Kind, Error> {
            Ok(Kind::Primal(Primal::new(Level::from_topology(topology, scheme)?.into()).into()))
        }
        let rules = match topology.rules.scheme {
            Scheme::Loop => primal(topology, PrimalScheme::Loop)?,
            Scheme::CatmullClark => primal(topology, PrimalScheme::CatmullClark)?,
            Scheme::DooSabin => Kind::Dual(Dual::from_topology(topology)?.into()),
            Scheme::Butterfly => Kind::Butterfly(Butterfly::from_topology(topology)?.into()),
        };
        Ok(Self { root: topology.clone().into(), depth: 0, rules })
    }

    /// Performs [`Self::from_topology`] with the signature that [`maquette_node::Context::memo`] requires.
    pub(crate) fn memo_first(topology: &Topology) -> Result<Self, Error> {
        Self::from_topology(topology)
    }

    /// Computes the refinement step that follows this one.
    ///
    /// # Errors
    /// If the refined mesh is not manifold.
    pub(crate) fn next(&self) -> Result<Self, Error> {
        let rules = match &self.rules {
            Kind::Primal(step) => Kind::Primal(Primal::new(step.next().into()).into()),
            Kind::Dual(step) => Kind::Dual(step.next()?.into()),
            Kind::Butterfly(step) => Kind::Butterfly(step.next().into()),
        };
        Ok(Self { root: self.root.clone(), depth: self.depth + 1, rules })
    }

    /// Performs [`Self::next`] with the signature that [`maquette_node::Context::memo`] requires.
    pub(crate) fn memo_next(&self) -> Result<Self, Error> {
        self.next()
    }

    /// Returns the step as a step of an approximating primal scheme; `None` for other schemes.
    pub(crate) fn primal(&self) -> Option<&Primal> {
        match &self.rules {
            Kind::Primal(step) => Some(step),
            Kind::Dual(_) | Kind::Butterfly(_) => None,
        }
    }

    /// The faces of the mesh after this refinement step.
    pub(crate) fn finer(&self) -> &Faces {
        match &self.rules {
            Kind::Primal(step) => &step.finer,
            Kind::Dual(step) => &step.finer,
            Kind::Butterfly(step) => &step.finer,
        }
    }

    /// Returns the creases of the refined mesh, sorted by their vertices.
    pub(crate) fn finer_creases(&self) -> Vec<([u32; 2], f64)> {
        match &self.rules {
            Kind::Primal(step) => step.finer_creases(),
            Kind::Dual(_) => Vec::new(),
            Kind::Butterfly(step) => step.finer_creases(),
        }
    }

    /// Returns for each new face the old face from which it gets its attributes.
    pub(crate) fn parents(&self) -> Vec<u32> {
        match &self.rules {
            Kind::Primal(step) => step.parents(),
            Kind::Dual(step) => step.parents(),
            Kind::Butterfly(step) => step.parents(),
        }
    }

    /// Computes the positions of all vertices after this step, given the positions `old` before the step.
    pub(crate) fn positions(&self, old: &[Point3<f64>]) -> Vec<Point3<f64>> {
        match &self.rules {
            Kind::Primal(step) => step.positions(old),
            Kind::Dual(step) => step.positions(old),
            Kind::Butterfly(step) => step.positions(old),
        }
    }

    /// Returns a vertex attribute of the mesh after the step, given that of the mesh before the step.
    pub(crate) fn vertex_attribute(&self, old: &Attribute) -> Attribute {
        OnVertices(self).attribute(old)
    }

    /// Returns a corner attribute of the mesh after the step, given that of the mesh before the step.
    pub(crate) fn corner_attribute(&self, old: &Attribute) -> Attribute {
        OnCorners(self).attribute(old)
    }
}

struct OnVertices<'a>(&'a Step);

impl AttributeTransfer for OnVertices<'_> {
    fn column<T: WeightedMean>(&self, old: &[T]) -> Vec<T> {
        match &self.0.rules {
            Kind::Primal(step) => step.carry_vertices(old),
            Kind::Dual(step) => step.carry_vertices(old),
            Kind::Butterfly(step) => step.carry_vertices(old),
        }
    }
}

struct OnCorners<'a>(&'a Step);

impl AttributeTransfer for OnCorners<'_> {
    fn column<T: WeightedMean>(&self, old: &[T]) -> Vec<T> {
        match &self.0.rules {
            Kind::Primal(step) => step.carry_corners(old),
            Kind::Dual(step) => step.carry_corners(old),
            Kind::Butterfly(step) => step.carry_corners(old),
        }
    }
}

/// The limit masks for the vertices that the last step made.
#[derive(Clone, Debug)]
pub(crate) struct LastLimit {
    root: Arc<Topology>,
    depth: usize,
    limit: KindOfLimit,
}

#[derive(Clone, Debug)]
enum KindOfLimit {
    Primal(Arc<FinerLimit>),
    Dual(Arc<FinerDualLimit>),
}

/// The limit masks are a function of the topology and the depth, so only these two are encoded for the hash.
impl Memo for LastLimit {
    const NAME: &'static str = "SubdivisionLastLimit";

    fn encode(&self, to: &mut Encoder) {
        to.memo(&*self.root).counts(&[self.depth]);
    }

    fn size(&self) -> usize {
        let limit = match &self.limit {
            KindOfLimit::Primal(limit) => limit.size(),
            KindOfLimit::Dual(limit) => limit.size(),
        };
        limit + self.root.size()
    }
}

impl LastLimit {
    /// Computes the limit masks for the vertices that `step` made.
    ///
    /// # Errors
    /// If the refined mesh is not manifold, or the scheme has no limit masks.
    pub(crate) fn new(step: &Step) -> Result<Self, Error> {
        let limit = match &step.rules {
            Kind::Primal(step) => KindOfLimit::Primal(FinerLimit::new(step.final_mesh()).into()),
            Kind::Dual(dual) => KindOfLimit::Dual(FinerDualLimit::new(dual)?.into()),
            Kind::Butterfly(_) => bail!("the scheme has no formulas for its limit surface"),
        };
        Ok(Self { root: step.root.clone(), depth: step.depth, limit })
    }

    /// Performs [`Self::new`] with the signature that [`maquette_node::Context::memo`] requires.
    pub(crate) fn memo(step: &Step) -> Result<Self, Error> {
        Self::new(step)
    }

    /// Updates `limit`, an earlier result of [`apply`](Self::apply), if only the limits of the vertices in `rows` have changed. Returns
    /// `None` if a full computation is necessary.
    pub(crate) fn follow(
        &self,
        rows: &[Range<u32>],
        control: &[Point3<f64>],
        limit: &Mesh,
    ) -> Option<Mesh> {
        match &self.limit {
            KindOfLimit::Primal(own) => own.follow(rows, control, limit),
            KindOfLimit::Dual(_) => None,
        }
    }

    /// Moves the vertices of `mesh` to the limit surface, and adds the attribute `normal`.
    ///
    /// # Errors
    /// If a position becomes infinite.
    pub(crate) fn apply(&self, mesh: &Mesh) -> Result<Mesh, MeshError> {
        match &self.limit {
            KindOfLimit::Primal(limit) => limit.apply(mesh),
            KindOfLimit::Dual(limit) => limit.apply(mesh),
        }
    }
}
