//! Linear equations: direct and iterative solvers, and the lists and sparse matrices that they work on.

pub(crate) mod banded;
pub(crate) mod cholesky;
pub(crate) mod columns;
pub(crate) mod laplace;
pub(crate) mod lu;
pub(crate) mod missed;
pub(crate) mod mix;
pub(crate) mod stencils;
pub(crate) mod transpose;
