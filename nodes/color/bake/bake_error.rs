//! Why captures were not put on a mesh.

use maquette_node::{Cancelled, TooMuch};
use maquette_value::MeshError;

use super::super::layout::LayoutError;

/// Why captures were not put on a mesh.
#[derive(Debug, thiserror::Error)]
pub enum BakeError {
    /// No captures.
    #[error("the list `captures` is empty: there is nothing to take colors from")]
    NoCaptures,
    /// A mesh without a picture.
    #[error("capture {capture} has no {what}: give it its picture by `Texture`")]
    NoPicture {
        /// Its place in the list, from 1.
        capture: usize,
        /// What it lacks.
        what: &'static str,
    },
    /// A capture whose camera is not known.
    #[error(
        "the camera of capture {capture} is not known, and its texture coordinates do not tell it ({why}): give a camera file, or leave the \
         capture where it was taken"
    )]
    NoCamera {
        /// Its place in the list, from 1.
        capture: usize,
        /// Why not.
        why: String,
    },
    /// A capture without a pose.
    #[error(
        "capture {capture} has no pose: only captures whose camera file has `world_from_camera_mm` have one, and only until they are moved"
    )]
    NoPose {
        /// Its place in the list, from 1.
        capture: usize,
    },
    /// Captures of something else.
    #[error(
        "none of the {captures} captures sees anything of the mesh: its vertices are {distance:.3} mm from the nearest capture in the middle \
         of all, and {tolerance:.3} mm are tolerated; are `poses` and `tolerance` right?"
    )]
    NothingSeen {
        /// How many captures.
        captures: usize,
        /// The median distance, in mm.
        distance: f64,
        /// The largest tolerance of a capture, in mm.
        tolerance: f64,
    },
    /// A parameter out of its range.
    #[error("`{what}` is {value}, but must be a length, or 0")]
    Parameter {
        /// Its name.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// No texture coordinates.
    #[error(transparent)]
    Layout(#[from] LayoutError),
    /// Too many captures.
    #[error(transparent)]
    TooMuch(#[from] TooMuch),
    /// Places out of the numbers.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
