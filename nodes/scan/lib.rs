//! Nodes that isolate an object in its scans: they remove tables, walls and stray points.

use maquette_node::{Pack, Recipe, node};

mod crop;
mod dominant_plane;
mod hull;
mod keep_cells;
mod pieces;
mod plane;
mod scan;
mod within;

pub use crop::{Crop, crop};
pub use dominant_plane::{DominantPlane, PlaneInScan, dominant_plane};
pub use keep_cells::{KeepCells, keep_cells};
pub use pieces::{Keep, Pieces, pieces};
pub use plane::Plane;
pub use scan::Scan;
pub use within::Region;

/// The nodes that isolate an object in its scans.
pub static PACK: Pack = Pack {
    name: "scan",
    version: env!("CARGO_PKG_VERSION"),
    build: maquette_node::this_build!(),
    nodes: &[node::<KeepCells>(), node::<Crop>(), node::<Pieces>(), node::<DominantPlane>()],
    recipes: &[
        Recipe { name: "capture", text: include_str!("recipes/capture.ron") },
        Recipe { name: "range", text: include_str!("recipes/range.ron") },
        Recipe { name: "mesh", text: include_str!("recipes/mesh.ron") },
        Recipe { name: "points", text: include_str!("recipes/points.ron") },
    ],
    ..Pack::EMPTY
};
