//! Errors of the registration of scans.

use maquette_mesh::{MergeError, TransformError};
use maquette_node::{CancelledError, LimitError};
use maquette_value::MeshError;
use thiserror::Error;

use super::alignment::AlignmentError;

/// An error of the registration of scans.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum AlignError {
    /// There are fewer than two scans.
    #[error("expected at least 2 scans, found {count}")]
    TooFewScans {
        /// The number of given scans.
        count: usize,
    },
    /// A scan has too few different points.
    #[error("scan {scan} has {points} different points, expected at least {least}")]
    TooFewPoints {
        /// The number of the scan, from 1.
        scan: usize,
        /// The number of different points.
        points: usize,
        /// The minimum number of different points.
        least: usize,
    },
    /// The size or the position of a scan is extreme.
    #[error(
        "scan {scan} is too small, too large or too far from the origin: its bounding box has a diagonal of {size:e} mm"
    )]
    Size {
        /// The number of the scan, from 1.
        scan: usize,
        /// The diagonal of the bounding box, in mm.
        size: f64,
    },
    /// Two scans do not fit at any position that was found.
    #[error(
        "scans {scan} and {to} do not fit: at the best position found, {share:.1} % of scan {scan} is on scan {to} (at least {MIN_OVERLAP} % required), and {agreement:.0} % of the surface that both should see agrees (at least {MIN_AGREEMENT} % required); take scans with more overlap, or use `Pairs`"
    )]
    NoFit {
        /// The number of the scan that is moved, from 1.
        scan: usize,
        /// The number of the scan that it should fit, from 1.
        to: usize,
        /// The fraction of scan `scan` that lies on scan `to`, in percent.
        share: f64,
        /// The fraction of the common surface on which the scans agree, in percent.
        agreement: f64,
    },
    /// A scan is not near the other scans.
    #[error(
        "no part of scan {scan} is within {reach:.3} mm of a scan that is connected to the first one, with similar normals; increase `reach`, or use `Features` or `Pairs`"
    )]
    Apart {
        /// The number of the scan, from 1.
        scan: usize,
        /// The search distance, in mm.
        reach: f64,
    },
    /// There are fewer than three pairs of points.
    #[error("expected at least 3 pairs of points, found {count}")]
    TooFewPairs {
        /// The number of given pairs.
        count: usize,
    },
    /// The points of the pairs are on a line, which leaves a rotation undetermined.
    #[error(
        "the points of the pairs are on a line: their standard deviation is {off:.3e} mm across and {along:.3e} mm along it; add a pair beside the line"
    )]
    Line {
        /// The standard deviation of the distances from the line, in mm.
        off: f64,
        /// The standard deviation along the line, in mm.
        along: f64,
    },
    /// The pairs contradict each other: no rigid motion fits them.
    #[error(
        "the pairs contradict each other: after the best motion their distance is {off:.3} mm (root mean square) for points that spread over {spread:.3} mm, and pair {worst} is {most:.3} mm apart; check its points, the units of both scans, and that neither is mirrored"
    )]
    Contradiction {
        /// The root mean square distance of the pairs after the best motion, in mm.
        off: f64,
        /// The root mean square distance of the points from their centroid, in mm.
        spread: f64,
        /// The number of the pair with the largest distance, from 1.
        worst: usize,
        /// The distance of this pair after the best motion, in mm.
        most: f64,
    },
    /// A parameter is out of range.
    #[error("`{what}` is {value}, expected {must}")]
    Parameter {
        /// The name of the parameter.
        what: &'static str,
        /// The value of the parameter.
        value: f64,
        /// The range of valid values.
        must: &'static str,
    },
    /// A scan has no pose, but the options require it.
    #[error(
        "scan {scan} has no pose: only captures whose camera file has `world_from_camera_mm` have one, and only until they are moved"
    )]
    NoPose {
        /// The number of the scan, from 1.
        scan: usize,
    },
    /// The alignment has no scan with this number.
    #[error("unknown scan {scan}: the alignment has {count} scans")]
    NoScan {
        /// The number of the scan, from 1.
        scan: u32,
        /// The number of scans in the alignment.
        count: usize,
    },
    /// A position became infinite.
    #[error(transparent)]
    Moved(#[from] TransformError),
    /// A computed motion is invalid.
    #[error(transparent)]
    Alignment(#[from] AlignmentError),
    /// There are too many scans.
    #[error(transparent)]
    TooMuch(#[from] LimitError),
    /// A range image cannot be triangulated.
    #[error("{0}")]
    Range(String),
    /// The scans cannot be merged.
    #[error(transparent)]
    Merged(#[from] MergeError),
    /// A scan cannot be converted to a mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was cancelled.
    #[error(transparent)]
    Cancelled(#[from] CancelledError),
}

/// The minimum fraction of a scan that must lie on the other scan, in percent.
pub(super) const MIN_OVERLAP: f64 = 5.0;

/// The minimum fraction of the common surface on which the scans must agree, in percent.
pub(super) const MIN_AGREEMENT: f64 = 60.0;
