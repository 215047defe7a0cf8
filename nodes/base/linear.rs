//! Linear equations: direct and iterative solvers, and the vectors and sparse matrices they operate on.

pub mod attribute_transfer;
pub mod banded;
pub mod cholesky;
pub mod columns;
pub mod laplace;
pub mod lu;
pub mod membrane;
mod multigrid;
pub mod residuals;
pub mod stencils;
pub mod transpose;
pub mod weighted_mean;
