//! Completes a surface with shapes that are found elsewhere on it.
//!
//! Kawai, Sato and Yokoya, "Surface completion by minimizing energy based on similarity of shape" (2008): the missing part moves
//! until each patch of it is as similar as possible to some patch of the data, on levels from coarse to fine. The vertices themselves
//! stay as dense as the data: on coarse levels only a sparse subset is moved, and the others follow as a thin plate.
//!
//! [`Update::Exact`] differs from the publication where that made filled surfaces better in all of many cases:
//! - An exemplar is aligned with a patch by the best small shift and tilt, not by the frames alone, which one rough triangle turns.
//! - The normal of a frame is the mean over a part of the patch.
//! - A thin plate at the start counts as an estimate of its own, with an error that is measured where the data are known: a vertex
//!   moves to the mean of both estimates, weighed by the inverses of their variances. Where no exemplar fits, the plate stays.
//! - Last, each vertex gets the fine detail of its exemplar, amplified until the fill is as rough as the data around the hole: the mean of
//!   many patches is smoother than each of them, and the best match of a smooth patch is a smooth one. Then the dihedral angles of the
//!   filled edges get the distribution of those around the hole.
//!
//! Between iterations no edge is split or collapsed, so that energies are comparable and a new triangulation loses no detail.
//! [`Update::Published`] follows the publication: each level has its own density, by splits and collapses, which removes the wrinkles of a
//! poor start, and normals at the rim come from the data alone.

mod bends;
mod best_match;
mod cells;
mod compare;
mod complete;
mod completion;
mod descriptor;
mod detail;
mod exemplars;
mod frame;
mod heights;
mod hole;
mod kd_tree;
mod level;
mod options;
mod patches;
mod published;
mod roughness;
mod search;
mod smoothness;
mod sources;
mod spread;
mod surface;
#[cfg(test)]
mod tests;
mod tints;
mod turns;
mod votes;

pub(super) use complete::complete;
pub(super) use completion::{Copies, Given};
pub use options::{ExemplarOptions, Falloff, Shown, Start, Update};
pub(super) use published::complete_as_published;
pub(super) use sources::Sources;
