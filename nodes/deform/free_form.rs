//! Free-form deformation of objects by handles.

pub(super) mod drag;
pub(super) mod object;
pub(super) mod pull;
pub(super) mod reach;
pub(super) mod report;
