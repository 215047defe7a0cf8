//! A third-party pack for palettes: a value type, three nodes and a file format. It uses only maquette's public API.

use maquette::{Migration, NewValue, Pack, format, node, reader, value_type};

mod extract_palette;
mod palette;
mod posterize;
mod read_palette;

pub use extract_palette::{ExtractPalette, extract_palette};
pub use palette::{GimpPalette, GimpPaletteError, Palette};
pub use posterize::{Posterize, posterize};
pub use read_palette::ReadPalette;

/// The pack of nodes that reduce pictures to few colors.
pub const PACK: Pack = Pack {
    name: "palette",
    nodes: &[node::<ReadPalette>(), node::<ExtractPalette>(), node::<Posterize>()],
    values: &[value_type::<Palette>()],
    formats: &[format::<GimpPalette>()],
    readers: &[reader::<GimpPalette>()],
    migrations: &[
        // Version 0.2: the node uses a palette instead of making one.
        Migration::Node { old: "PaintPalette", new: "ApplyPalette" },
        // Version 0.3: the node is named after its effect, and the number of colors is called `count`.
        Migration::Node { old: "ApplyPalette", new: "Posterize" },
        Migration::Field {
            node: "ExtractPalette",
            old: "colors",
            new: "count",
            value: NewValue::Same,
        },
    ],
    ..Pack::EMPTY
};
