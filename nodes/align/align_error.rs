//! Why scans do not come together.

use maquette_mesh::{MergeError, TransformError};
use maquette_node::{Cancelled, TooMuch};
use maquette_range::TriangulateError;
use maquette_value::MeshError;
use thiserror::Error;

use super::alignment::AlignmentError;

/// Why scans do not come together.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum AlignError {
    /// Too few scans.
    #[error("there are {count} scans, but at least 2 are needed to bring them together")]
    TooFewScans {
        /// How many there are.
        count: usize,
    },
    /// A scan with next to nothing in it.
    #[error("scan {scan} has {points} different points, but at least {least} are needed")]
    TooFewPoints {
        /// Its place among the scans, from 1.
        scan: usize,
        /// Its points.
        points: usize,
        /// How many it must have.
        least: usize,
    },
    /// Places out of the numbers.
    #[error("scan {scan} is {size:e} mm large, which cannot be measured")]
    Size {
        /// Its place among the scans, from 1.
        scan: usize,
        /// The diagonal of its box, in mm.
        size: f64,
    },
    /// No place at which they fit.
    #[error(
        "scans {scan} and {to} do not fit: at the best place that was found {share:.1} % of scan {scan} lies on scan {to} (at least {LEAST_SHARE} % must) and {agreement:.0} % of where both should be seen agrees (at least {LEAST_AGREEMENT} % must). They need more overlap, or `Pairs` of points"
    )]
    NoFit {
        /// The scan that is moved, from 1.
        scan: usize,
        /// The scan that it should fit.
        to: usize,
        /// How much of it fits, in percent.
        share: f64,
        /// How much of what both should see agrees, in percent.
        agreement: f64,
    },
    /// Nothing lies near.
    #[error(
        "no part of scan {scan} is nearer than {reach:.3} mm to a scan that hangs together with the first one and looks the same way: raise `reach`, or bring them together by `Features` or `Pairs`"
    )]
    Apart {
        /// The scan, from 1.
        scan: usize,
        /// How far was searched, in mm.
        reach: f64,
    },
    /// Too few pairs of points.
    #[error("there are {count} pairs of points, but at least 3 are needed")]
    TooFewPairs {
        /// How many there are.
        count: usize,
    },
    /// Pairs that leave a turn open.
    #[error(
        "the points of the pairs lie on a line, from which they are {off:.3e} mm off where they spread over {along:.3e} mm: choose one beside it"
    )]
    Line {
        /// How far they are off the line, as standard deviation in mm.
        off: f64,
        /// How far they spread along it, as standard deviation in mm.
        along: f64,
    },
    /// Pairs of which some must be wrong.
    #[error(
        "the pairs contradict each other: brought together as well as can be they are {off:.3} mm apart, as mean squares go, where they spread over {spread:.3} mm, and pair {worst} is {most:.3} mm apart. Is it picked at the right place, in the same unit, and is neither scan mirrored?"
    )]
    Contradiction {
        /// The root mean square of their distances, in mm.
        off: f64,
        /// The root mean square of their distances from their middle, in mm.
        spread: f64,
        /// The pair that is farthest apart, from 1.
        worst: usize,
        /// How far, in mm.
        most: f64,
    },
    /// A number that means nothing.
    #[error("`{what}` is {value}, but must be {must}")]
    Parameter {
        /// Its name.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// A pose that is needed and not there.
    #[error(
        "scan {scan} has no pose: only captures whose camera file has `world_from_camera_mm` have one, and only until they are moved"
    )]
    NoPose {
        /// The scan, from 1.
        scan: usize,
    },
    /// A scan that an alignment does not have.
    #[error("the alignment is of {count} scans, so that there is no scan {scan}")]
    NoScan {
        /// The scan, from 1.
        scan: u32,
        /// How many there are.
        count: usize,
    },
    /// Places that become infinite.
    #[error(transparent)]
    Moved(#[from] TransformError),
    /// A motion out of the numbers.
    #[error(transparent)]
    Alignment(#[from] AlignmentError),
    /// More than can be done at once.
    #[error(transparent)]
    TooMuch(#[from] TooMuch),
    /// A range image that makes no mesh.
    #[error(transparent)]
    Range(#[from] TriangulateError),
    /// Scans that make no mesh together.
    #[error(transparent)]
    Merged(#[from] MergeError),
    /// A scan that makes no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// What of a scan must lie on the other, in percent.
pub(super) const LEAST_SHARE: f64 = 5.0;

/// How much of where both should be seen must agree, in percent.
pub(super) const LEAST_AGREEMENT: f64 = 60.0;
