//! Nodes on range images.

use maquette_node::{Pack, node};

mod average_normal;
mod denoise;
mod extract_region;
mod fill_range;
mod foreground;
mod grid;
mod holes;
mod range_file;
mod read_capture;
mod read_range;
mod triangulate;

pub use average_normal::{AverageNormal, Weight, average_normal, principal_normal};
pub use denoise::{Denoise, Denoising, denoise};
pub use extract_region::{ExtractRegion, Pick, RegionOptions, extract_region};
pub use fill_range::{FillRange, fill_range};
pub use foreground::{Foreground, ForegroundBy, foreground};
pub use grid::contour::contours;
pub use grid::grid_triangles::{GridTriangle, Half, Rays, grid_triangles};
pub use grid::joins::{GRAZING, JUMP, Joins, longest_edge};
pub use holes::shadows::{MAX_SHADOW_CELLS, fill_shadows, neighborhood};
pub use maquette_base::unit::Unit;
pub use range_file::Axes;
pub use read_capture::{ReadCapture, read_capture};
pub use read_range::{ReadRange, read_range};
pub use triangulate::{Triangulate, triangulate};

/// Nodes on range images.
pub static PACK: Pack = Pack {
    name: "range",
    version: env!("CARGO_PKG_VERSION"),
    build: maquette_node::this_build!(),
    nodes: &[
        node::<ReadCapture>(),
        node::<ReadRange>(),
        node::<Denoise>(),
        node::<FillRange>(),
        node::<Foreground>(),
        node::<ExtractRegion>(),
        node::<AverageNormal>(),
        node::<Triangulate>(),
    ],
    ..Pack::EMPTY
};
