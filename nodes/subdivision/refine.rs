//! Refinement: steps of the schemes, planned once for a topology and applied to any positions and attributes.

pub(super) mod butterfly;
pub(super) mod by_faces;
pub(super) mod connectivity;
pub(super) mod doo_sabin;
pub(super) mod dual_halves;
pub(super) mod face_order;
pub(super) mod final_mesh;
pub(super) mod half_edges;
pub(super) mod level;
pub(super) mod local;
pub(super) mod manifold;
pub(super) mod moving_vertices;
pub(super) mod plan;
pub(super) mod primal;
pub(super) mod smooth_corners;
pub(super) mod split;
pub(super) mod step;
pub(super) mod topology;
pub(super) mod without_border;
