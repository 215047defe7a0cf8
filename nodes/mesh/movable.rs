//! The types of values that `Transform` moves.

use maquette::value::{ControlNet, Curve, Mesh, Points, RangeImage};

maquette::union! {
    /// What can be moved.
    pub enum Movable {
        Mesh(Mesh),
        RangeImage(RangeImage),
        Points(Points),
        Curve(Curve),
        ControlNet(ControlNet),
    }
}
