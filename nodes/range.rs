//! Nodes on range images.

use maquette::{Pack, node};

mod average_normal;
mod contour;
mod denoise;
mod extract_region;
mod footprint;
mod foreground;
mod grid_triangles;
mod range_file;
mod range_holes;
mod read_capture;
mod read_range;
mod triangulate;

pub use average_normal::{
    AverageNormal, AverageNormalError, Weight, average_normal, principal_normal,
};
pub(crate) use contour::contours;
pub use denoise::{Denoise, Denoising, denoise};
pub use extract_region::{ExtractRegion, ExtractRegionError, Pick, extract_region};
pub use foreground::{Foreground, ForegroundBy, ForegroundError, foreground};
pub use range_file::{Axes, CameraFileError, Unit};
pub use read_capture::{ReadCapture, ReadCaptureError, read_capture};
pub use read_range::{ReadRange, read_range};
pub use triangulate::{Triangulate, TriangulateError, triangulate};

/// Nodes on range images.
pub const PACK: Pack = Pack {
    name: "range",
    nodes: &[
        node::<ReadCapture>(),
        node::<ReadRange>(),
        node::<Denoise>(),
        node::<Foreground>(),
        node::<ExtractRegion>(),
        node::<AverageNormal>(),
        node::<Triangulate>(),
    ],
    values: &[],
    formats: &[],
};
