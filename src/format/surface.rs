//! Writes surfaces as meshes whose chords deviate from the surface by at most a thousandth of its size.

use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::error::Error;
use maquette_value::Surface;

use super::glb::MeshGlb;
use super::ply::MeshPly;

/// Writes a surface as a mesh in PLY.
pub(super) struct SurfacePly;

impl FileFormat for SurfacePly {
    type Value = Surface;
    const EXTENSION: &'static str = "ply";

    fn write(surface: &Surface, name: &str) -> Result<Vec<NewFile>, Error> {
        MeshPly::write(&surface.tessellate(0, 0)?, name)
    }
}

/// Writes a surface as a mesh in GLB.
pub(super) struct SurfaceGlb;

impl FileFormat for SurfaceGlb {
    type Value = Surface;
    const EXTENSION: &'static str = "glb";

    fn write(surface: &Surface, name: &str) -> Result<Vec<NewFile>, Error> {
        MeshGlb::write(&surface.tessellate(0, 0)?, name)
    }
}
