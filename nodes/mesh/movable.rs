//! The types of values that `Transform` moves.

use maquette_value::{ControlNet, Curve, Mesh, Points, RangeImage};

maquette_node::union! {
    /// A movable value.
    pub enum Movable {
        Mesh(Mesh),
        RangeImage(RangeImage),
        Points(Points),
        Curve(Curve),
        ControlNet(ControlNet),
    }
}
