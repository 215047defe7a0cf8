//! Linear equations: direct and iterative solvers, and the lists and sparse matrices that they work on.

pub mod banded;
pub mod carry;
pub mod cholesky;
pub mod columns;
pub mod laplace;
pub mod lu;
pub mod missed;
pub mod mix;
mod multigrid;
pub mod stencils;
pub mod transpose;
