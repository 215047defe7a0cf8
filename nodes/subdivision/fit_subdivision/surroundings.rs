//! The neighborhood of an edge operation.

/// The neighborhood that an edge operation reads and changes. The faces that the operation replaces are in the middle of `measured`.
pub(super) struct Surroundings {
    /// The control points that may move when the edge operation is evaluated.
    pub(super) free: Vec<u32>,
    /// The faces whose limit surface depends on the free control points.
    pub(super) measured: Vec<u32>,
    /// The faces around `measured`. The limit surface over `measured` depends on these faces, too.
    pub(super) margin: Vec<u32>,
}
