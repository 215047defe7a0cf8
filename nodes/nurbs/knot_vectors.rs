//! Knot vectors, and the parameters that they follow.

pub(super) mod even_knots;
pub(super) mod knot_vector;
