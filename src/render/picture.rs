//! PNG pictures of meshes and surfaces, rendered from the front.

use maquette_format::png;
use maquette_node::pack::{FileFormat, NewFile, Pack, format};
use maquette_syntax::error::Error;
use maquette_value::{Mesh, Surface};

use super::{View, render};

/// The pack of file formats that write meshes and surfaces as pictures.
pub static PACK: Pack = Pack {
    name: "render",
    version: env!("CARGO_PKG_VERSION"),
    build: maquette_node::this_build!(),
    formats: &[format::<MeshPng>(), format::<SurfacePng>()],
    ..Pack::EMPTY
};

/// The file format that writes a mesh as a picture.
pub(super) struct MeshPng;

impl FileFormat for MeshPng {
    type Value = Mesh;
    const EXTENSION: &'static str = "png";

    fn write(mesh: &Mesh, name: &str) -> Result<Vec<NewFile>, Error> {
        let picture = render(mesh, &View::front());
        Ok(NewFile::single(name, png::encode_rgb(&picture)?))
    }
}

/// The file format that writes a surface as a picture.
pub(super) struct SurfacePng;

impl FileFormat for SurfacePng {
    type Value = Surface;
    const EXTENSION: &'static str = "png";

    fn write(surface: &Surface, name: &str) -> Result<Vec<NewFile>, Error> {
        MeshPng::write(&surface.tessellate(0, 0)?, name)
    }
}
