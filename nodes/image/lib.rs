//! Nodes that process pictures and masks.

use maquette_node::{Pack, node};

mod checks;
mod combine_masks;
mod connectivity;
mod edges;
mod fill_contour;
mod filter;
mod grow_region;
mod label;
mod mask_shape;
mod operator;
mod outline;
mod painted_mask;
mod picture;
mod read_image;
mod segment;
mod thin;
mod threshold;

pub use combine_masks::{CombineMasks, CombineMode, combine_masks};
pub use connectivity::Connectivity;
pub use edges::{Edges, High, edges};
pub use fill_contour::{FillContour, fill_contour};
pub use filter::morphology::{close, dilate, open};
pub use grow_region::{GrowRegion, grow_region};
pub use label::Label;
pub use mask_shape::{MaskShape, Shape, mask_shape};
pub use operator::Operator;
pub use outline::{Outline, outline};
pub use painted_mask::{Paint, PaintedMask, painted_mask};
pub use picture::Picture;
pub use read_image::ReadImage;
pub use segment::components::label;
pub use segment::mark_pixels::threshold;
pub use segment::otsu::otsu;
pub use segment::select::level;
pub use segment::select::{Channel, Select, Space};
pub use thin::{Thin, ThinMethod, thin};
pub use threshold::Threshold;

/// The pack of nodes that process pictures and masks.
pub static PACK: Pack = Pack {
    name: "image",
    version: env!("CARGO_PKG_VERSION"),
    build: maquette_node::this_build!(),
    nodes: &[
        node::<ReadImage>(),
        node::<PaintedMask>(),
        node::<MaskShape>(),
        node::<Threshold>(),
        node::<GrowRegion>(),
        node::<Edges>(),
        node::<Outline>(),
        node::<Thin>(),
        node::<FillContour>(),
        node::<CombineMasks>(),
        node::<Label>(),
    ],
    ..Pack::EMPTY
};
