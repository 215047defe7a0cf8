//! The input of nodes that fit a surface to points.

use maquette_value as value;
use maquette_value::{Mesh, RangeImage};

maquette_node::union! {
    /// Points in space, given as points, the cells of a range image, or the vertices of a mesh.
    pub enum Scattered {
        Points(value::Points),
        RangeImage(RangeImage),
        Mesh(Mesh),
    }
}
