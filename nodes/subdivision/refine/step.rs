//! What of one step of a subdivision depends on topology alone: made once, applied to any positions and attributes.
//!
//! Applying a step adds the terms of each new place in a fixed order, so that the result is the same for any number of threads.

use std::ops::Range;
use std::sync::Arc;

use maquette_base::linear::carry::Carry;
use maquette_base::linear::mix::Mix;
use maquette_node::Error;
use maquette_value::Memo;
use maquette_value::{Attribute, Encoder, Faces, Mesh, MeshError};
use nalgebra::Point3;

use super::doo_sabin::Dual;
use super::level::Level;
use super::primal::Primal;
use super::topology::Topology;
use crate::SubdivideError;
use crate::limit::finer_dual_limit::FinerDualLimit;
use crate::limit::finer_limit::FinerLimit;

/// One step of a subdivision.
#[derive(Clone, Debug)]
pub(crate) struct Step {
    /// What the first step was made from.
    root: Arc<Topology>,
    /// The number of steps before.
    depth: usize,
    rules: Kind,
}

#[derive(Clone, Debug)]
enum Kind {
    Primal(Arc<Primal>),
    Dual(Arc<Dual>),
}

/// A function of the first topology and the depth, which therefore stand for it in the hash.
impl Memo for Step {
    const NAME: &'static str = "SubdivisionStep";

    fn encode(&self, to: &mut Encoder) {
        to.memo(&*self.root).counts(&[self.depth]);
    }

    fn size(&self) -> usize {
        let rules = match &self.rules {
            Kind::Primal(step) => step.size(),
            Kind::Dual(step) => step.size(),
        };
        rules + self.root.size()
    }
}

impl Step {
    /// The first step, of the scheme that `topology` names.
    ///
    /// # Errors
    /// Those of the scheme: faces that it cannot refine, or a mesh that is not manifold.
    pub(crate) fn first(topology: &Topology) -> Result<Self, SubdivideError> {
        let rules = match topology.rules.scheme.primal() {
            None => Kind::Dual(Dual::first(topology)?.into()),
            Some(scheme) => {
                Kind::Primal(Primal::new(Level::first(topology, scheme)?.into()).into())
            }
        };
        Ok(Self { root: topology.clone().into(), depth: 0, rules })
    }

    /// The same, as [`maquette_node::Context::memo`] wants it.
    pub(crate) fn memo_first(topology: &Topology) -> Result<Self, Error> {
        Ok(Self::first(topology)?)
    }

    /// The step after this one.
    ///
    /// # Errors
    /// If the refined mesh is not manifold.
    pub(crate) fn next(&self) -> Result<Self, SubdivideError> {
        let rules = match &self.rules {
            Kind::Primal(step) => Kind::Primal(Primal::new(step.next().into()).into()),
            Kind::Dual(step) => Kind::Dual(step.next()?.into()),
        };
        Ok(Self { root: self.root.clone(), depth: self.depth + 1, rules })
    }

    /// The same, as [`maquette_node::Context::memo`] wants it.
    pub(crate) fn memo_next(&self) -> Result<Self, Error> {
        Ok(self.next()?)
    }

    /// Its rules, if the scheme is primal.
    pub(crate) fn primal(&self) -> Option<&Primal> {
        match &self.rules {
            Kind::Primal(step) => Some(step),
            Kind::Dual(_) => None,
        }
    }

    /// The refined faces.
    pub(crate) fn finer(&self) -> &Faces {
        match &self.rules {
            Kind::Primal(step) => &step.finer,
            Kind::Dual(step) => &step.finer,
        }
    }

    /// The refined creases, sorted by vertices.
    pub(crate) fn finer_creases(&self) -> Vec<([u32; 2], f64)> {
        match &self.rules {
            Kind::Primal(step) => step.finer_creases(),
            Kind::Dual(_) => Vec::new(),
        }
    }

    /// The old face of each new one.
    pub(crate) fn parents(&self) -> Vec<u32> {
        match &self.rules {
            Kind::Primal(step) => step.parents(),
            Kind::Dual(step) => step.parents(),
        }
    }

    /// The refined vertices' places.
    pub(crate) fn positions(&self, old: &[Point3<f64>]) -> Vec<Point3<f64>> {
        match &self.rules {
            Kind::Primal(step) => step.positions(old),
            Kind::Dual(step) => step.positions(old),
        }
    }

    /// An attribute per vertex, refined.
    pub(crate) fn vertex_attribute(&self, old: &Attribute) -> Attribute {
        OnVertices(self).attribute(old)
    }

    /// An attribute per corner, refined.
    pub(crate) fn corner_attribute(&self, old: &Attribute) -> Attribute {
        OnCorners(self).attribute(old)
    }
}

struct OnVertices<'a>(&'a Step);

impl Carry for OnVertices<'_> {
    fn column<T: Mix>(&self, old: &[T]) -> Vec<T> {
        match &self.0.rules {
            Kind::Primal(step) => step.carry_vertices(old),
            Kind::Dual(step) => step.carry_vertices(old),
        }
    }
}

struct OnCorners<'a>(&'a Step);

impl Carry for OnCorners<'_> {
    fn column<T: Mix>(&self, old: &[T]) -> Vec<T> {
        match &self.0.rules {
            Kind::Primal(step) => step.carry_corners(old),
            Kind::Dual(step) => step.carry_corners(old),
        }
    }
}

/// Where the vertices go that a step has made.
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

/// A function of the first topology and the depth, which therefore stand for it in the hash.
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
    /// That of the vertices which `step` makes.
    ///
    /// # Errors
    /// If the refined mesh is not manifold.
    pub(crate) fn new(step: &Step) -> Result<Self, SubdivideError> {
        let limit = match &step.rules {
            Kind::Primal(step) => KindOfLimit::Primal(FinerLimit::new(step.last()).into()),
            Kind::Dual(dual) => KindOfLimit::Dual(FinerDualLimit::new(dual)?.into()),
        };
        Ok(Self { root: step.root.clone(), depth: step.depth, limit })
    }

    /// The same, as [`maquette_node::Context::memo`] wants it.
    pub(crate) fn memo(step: &Step) -> Result<Self, Error> {
        Ok(Self::new(step)?)
    }

    /// What [`apply`](Self::apply) makes of a mesh, made of what it made, `limit`, where others than the vertices in these rows have gone to
    /// the same places; none if all must be computed.
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

    /// The same mesh with its vertices on the limit surface, and the attribute `normal`.
    ///
    /// # Errors
    /// If a place becomes infinite.
    pub(crate) fn apply(&self, mesh: &Mesh) -> Result<Mesh, MeshError> {
        match &self.limit {
            KindOfLimit::Primal(limit) => limit.apply(mesh),
            KindOfLimit::Dual(limit) => limit.apply(mesh),
        }
    }
}
