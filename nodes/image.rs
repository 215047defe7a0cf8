//! Nodes on pictures.

use maquette::{Pack, node};

mod combine_masks;
mod components;
mod connectivity;
mod edges;
mod fill_contour;
mod gaussian;
mod gradient;
mod grow_region;
mod hysteresis;
mod label;
mod mark_pixels;
mod morphology;
mod operator;
mod otsu;
mod outline;
mod percentile;
mod picture_error;
mod read_image;
mod select;
mod thin;
mod threshold;

pub use combine_masks::{CombineMasks, CombineMasksError, CombineMode, combine_masks};
pub use components::label;
pub use connectivity::Connectivity;
pub use edges::{Edges, EdgesError, High, Picture, edges};
pub use fill_contour::{FillContour, fill_contour};
pub use grow_region::{GrowRegion, grow_region};
pub use label::Label;
pub use mark_pixels::threshold;
pub use morphology::{close, dilate, open};
pub use operator::Operator;
pub use otsu::otsu;
pub use outline::{Outline, outline};
pub use picture_error::PictureError;
pub use read_image::ReadImage;
pub(crate) use select::level;
pub use select::{Channel, Select, Space};
pub use thin::{Thin, ThinError, ThinMethod, thin};
pub use threshold::Threshold;

/// Nodes on pictures.
pub const PACK: Pack = Pack {
    name: "image",
    nodes: &[
        node::<ReadImage>(),
        node::<Threshold>(),
        node::<GrowRegion>(),
        node::<Edges>(),
        node::<Outline>(),
        node::<Thin>(),
        node::<FillContour>(),
        node::<CombineMasks>(),
        node::<Label>(),
    ],
    values: &[],
    formats: &[],
    readers: &[],
};
