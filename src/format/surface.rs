//! Writes surfaces as meshes fine enough that chords stay within a thousandth of the surface's size.

use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::error::Error;
use maquette_value::Surface;

use super::glb::MeshGlb;
use super::ply::MeshPly;

/// A surface as a mesh, PLY.
pub(super) struct SurfacePly;

impl FileFormat for SurfacePly {
    type Value = Surface;
    const ENDING: &'static str = "ply";

    fn write(surface: &Surface, name: &str) -> Result<Vec<NewFile>, Error> {
        MeshPly::write(&surface.tessellate(0, 0)?, name)
    }
}

/// A surface as a mesh, GLB.
pub(super) struct SurfaceGlb;

impl FileFormat for SurfaceGlb {
    type Value = Surface;
    const ENDING: &'static str = "glb";

    fn write(surface: &Surface, name: &str) -> Result<Vec<NewFile>, Error> {
        MeshGlb::write(&surface.tessellate(0, 0)?, name)
    }
}
