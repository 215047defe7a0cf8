//! What lies around moves of edges.

/// What a move needs to look at: it changes faces in the middle of `measured`, whose surface it moves.
pub(super) struct Surroundings {
    /// The control points that it may move.
    pub(super) free: Vec<u32>,
    /// The faces whose surface hangs on these.
    pub(super) measured: Vec<u32>,
    /// Those around, on which that surface hangs, too.
    pub(super) margin: Vec<u32>,
}
