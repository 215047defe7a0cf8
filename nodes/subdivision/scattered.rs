//! What a surface is fitted to.

use maquette::value::{self, Mesh, RangeImage};

maquette::union! {
    /// Points in space.
    pub enum Scattered {
        Points(value::Points),
        RangeImage(RangeImage),
        Mesh(Mesh),
    }
}
