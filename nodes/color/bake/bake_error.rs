//! Errors of baking.

use maquette_node::{CancelledError, LimitError};
use maquette_value::MeshError;

use super::super::layout::LayoutError;

/// Reasons why captures cannot be baked.
#[derive(Debug, thiserror::Error)]
pub enum BakeError {
    /// The list of captures is empty.
    #[error("the list `captures` is empty: there is nothing to take colors from")]
    NoCaptures,
    /// A capture has no picture.
    #[error("capture {capture} has no {what}: add its picture with `Texture`")]
    NoPicture {
        /// The number of the capture in the list, from 1.
        capture: usize,
        /// The name of the missing part.
        what: &'static str,
    },
    /// The camera of a capture is unknown.
    #[error(
        "the camera of capture {capture} is unknown and cannot be computed from its texture coordinates ({why}): give a camera file, or leave the \
         capture where it was taken"
    )]
    NoCamera {
        /// The number of the capture in the list, from 1.
        capture: usize,
        /// The reason why the camera cannot be computed.
        why: String,
    },
    /// A capture has no pose.
    #[error(
        "capture {capture} has no pose: only captures whose camera file has `world_from_camera_mm` have one, and only until they are moved"
    )]
    NoPose {
        /// The number of the capture in the list, from 1.
        capture: usize,
    },
    /// No capture sees the mesh; the captures show another object.
    #[error(
        "none of the {captures} captures sees anything of the mesh: its vertices are {distance:.3} mm from the nearest capture in the middle \
         of all, and {tolerance:.3} mm are tolerated; are `poses` and `tolerance` right?"
    )]
    NothingSeen {
        /// The number of given captures.
        captures: usize,
        /// The median distance of the vertices from the nearest capture in mm.
        distance: f64,
        /// The largest tolerance of a capture in mm.
        tolerance: f64,
    },
    /// A parameter is out of range.
    #[error("`{what}` is {value}, but must be a length, or 0")]
    Parameter {
        /// The name of the parameter.
        what: &'static str,
        /// The value of the parameter.
        value: f64,
    },
    /// The mesh has no texture coordinates.
    #[error(transparent)]
    Layout(#[from] LayoutError),
    /// There are too many captures for one texture.
    #[error(transparent)]
    TooMuch(#[from] LimitError),
    /// The positions exceed the largest coordinate of a mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was cancelled.
    #[error(transparent)]
    Cancelled(#[from] CancelledError),
}
