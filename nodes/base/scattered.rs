//! What a surface is fitted to.

use maquette_value as value;
use maquette_value::{Mesh, RangeImage};

maquette_node::union! {
    /// Points in space.
    pub enum Scattered {
        Points(value::Points),
        RangeImage(RangeImage),
        Mesh(Mesh),
    }
}
