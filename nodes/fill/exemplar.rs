//! Completes a surface with shapes found elsewhere on it.
//!
//! Kawai, Sato and Yokoya, "Surface completion by minimizing energy based on similarity of shape" (2008): the missing part moves until each
//! of its patches is as similar as possible to some patch of the data, on levels from coarse to fine. The mesh stays as dense as the data:
//! on coarse levels only a sparse subset of the vertices moves, and the others follow as a thin plate.
//!
//! [`Update::Exact`] differs from the publication where that improved the filled surface in many test cases:
//! - An exemplar is aligned with a patch by the best small shift and tilt, not by frames only, which one rough triangle rotates.
//! - The normal of a frame is the mean over a part of the patch.
//! - If the start is a thin plate, it counts as a separate estimate, with an error measured where the data are known: a vertex moves to the
//!   mean of both estimates, weighted by their inverse variances. Where no exemplar fits, the plate stays.
//! - Finally, each vertex gets the fine detail of its exemplar, amplified until the fill is as rough as the data around the hole: the mean
//!   of many patches is smoother than each of them, and the best match of a smooth patch is smooth. Then the dihedral angles of the
//!   filled edges get the distribution of those around the hole.
//!
//! Terms: a **patch** is the part of a surface within a radius of a vertex; its **samples** are the points that are compared. An
//! **exemplar** is such a part of the data, stored as heights over the plane of its **frame**: a normal, a horizontal and an upward
//! direction. The **match** of a patch is the most similar exemplar, in one of several **orientations**. **Missing** vertices are those
//! of the fill.
//!
//! Between iterations no edge is split or collapsed, so that energies are comparable and no detail is lost by a new triangulation.
//! [`Update::Published`] follows the publication: each level has its own density, set by splits and collapses, which removes the wrinkles
//! of a poor start, and normals at the rim come from the data only.

mod best_match;
mod cells;
mod compare;
mod complete;
mod completion;
mod descriptor;
mod detail;
mod dihedral_angles;
mod exemplars;
mod frame;
mod heights;
mod hole;
mod kd_tree;
mod level;
mod options;
mod orientations;
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
mod votes;

pub(super) use complete::complete;
pub(super) use completion::{CompletionInput, Copies};
pub use options::{ExemplarOptions, Falloff, Start, TextureSource, Update};
pub(super) use published::complete_as_published;
pub(super) use sources::Sources;
