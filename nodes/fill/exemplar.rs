//! Fills holes with shapes found elsewhere on the surface.
//!
//! Kawai, Sato and Yokoya, "Surface completion by minimizing energy based on similarity of shape" (2008): the vertices of the fill move
//! until each patch of the fill is as similar as possible to some patch of the input surface. This is done on levels from coarse to fine.
//! The mesh of the fill is as dense as the input mesh on all levels: on coarse levels only a sparse subset of the vertices moves, and the
//! others follow as a thin plate.
//!
//! [`Update::Exact`] differs from the publication where a change improved the filled surface in many test cases:
//! - An exemplar (a copied part of the input surface) is aligned with a patch by the best small shift and tilt. Local frames alone are not
//!   enough: one rough triangle rotates a frame.
//! - The normal of a frame is the mean over a part of the patch.
//! - If the initial fill is a thin plate, it counts as a separate estimate, with an error measured on the input surface. A vertex moves to
//!   the mean of both estimates, weighted by their inverse variances. Where no exemplar fits, the plate remains.
//! - Finally, each vertex gets the fine detail of its exemplar, amplified or weakened until the fill is as rough as the surface around the
//!   hole, where the nearest vertices count most. This restores detail: the mean of many patches is smoother than each of them, and the
//!   exemplar that fits a smooth patch best is smooth. Then the dihedral angles of the fill's edges get the distribution of the angles
//!   around the hole.
//! - A hole in a smooth part of the surface keeps its thin plate, see `gate`.
//!
//! Terms: the **data** are the vertices and faces of the input mesh; the **missing** vertices are those of the fill. A **patch** is the
//! part of a surface within a radius of a vertex; its **samples** are the points that are compared. An **exemplar** is a patch of the data,
//! stored as heights over the plane of its **frame**: a normal, a horizontal and an upward direction. The **match** of a patch is the most
//! similar exemplar, in one of several **orientations**.
//!
//! Between iterations no edge is split or collapsed, so that energies are comparable and no detail is lost by a new triangulation.
//! [`Update::Published`] follows the publication instead: each level has its own vertex density, set by splits and collapses, which removes
//! the wrinkles of a poor initial fill. Normals at the hole's rim come from the input surface only.

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
mod gate;
mod heights;
mod hole;
mod kd_tree;
mod level;
mod options;
mod orientations;
mod patches;
mod published;
mod relief;
mod rotations;
mod roughness;
mod seam;
mod search;
mod smoothness;
mod sources;
mod spread;
mod surface;
mod surroundings;
#[cfg(test)]
mod tests;
mod tints;
mod votes;
mod wavelength;

pub(super) use complete::complete;
pub(super) use completion::{CompletionInput, Copies};
pub use options::{ExemplarOptions, Falloff, Start, TextureSource, Update};
pub(super) use published::complete_as_published;
pub(super) use sources::Sources;
