//! Inputs of nodes that accept a picture or a mask.

use maquette_value::{Image, Mask};

maquette_node::union! {
    /// A picture, or a mask.
    pub enum Picture { Image(Image), Mask(Mask) }
}

impl Picture {
    /// Returns the width and height in pixels.
    pub fn size(&self) -> [usize; 2] {
        match self {
            Self::Image(image) => [image.width(), image.height()],
            Self::Mask(mask) => [mask.width(), mask.height()],
        }
    }
}
