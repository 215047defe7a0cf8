//! Writes meshes and surfaces as pictures: rendered from the front, PNG.

use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::error::Error;
use maquette_value::{Mesh, Surface};

use crate::format::png;
use crate::render::{View, render};

/// A rendered mesh.
pub(super) struct MeshPng;

impl FileFormat for MeshPng {
    type Value = Mesh;
    const ENDING: &'static str = "png";

    fn write(mesh: &Mesh, name: &str) -> Result<Vec<NewFile>, Error> {
        let picture = render(mesh, &View::front());
        Ok(NewFile::only(name, png::encode_rgb(&picture)?))
    }
}

/// A rendered surface.
pub(super) struct SurfacePng;

impl FileFormat for SurfacePng {
    type Value = Surface;
    const ENDING: &'static str = "png";

    fn write(surface: &Surface, name: &str) -> Result<Vec<NewFile>, Error> {
        MeshPng::write(&surface.tessellate(0, 0)?, name)
    }
}
