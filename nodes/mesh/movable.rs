//! What can be moved.

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
