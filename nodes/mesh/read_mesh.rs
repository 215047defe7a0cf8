//! Reads a mesh from a file.

use maquette::value::Mesh;
use maquette::{Context, Error, FilePath, NoReader, Node, Reading, format};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Reads a mesh: an OBJ, PLY, STL or GLB file.
///
/// Coordinates are taken as they are: mm, y up. GLB has meters, which become mm, and its nodes' motions are applied. Corners of STL
/// and GLB that are at the same place become one vertex.
///
/// The picture of a GLB file is in it. Of an OBJ file it is that which its material file names (`map_Kd`), of the first material in
/// use that has one: a mesh has one picture. What is missing, and materials that are left out, are warned of.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadMesh {
    /// The file; its ending says of which format it is.
    #[schemars(extend("reads" = "Mesh"))]
    pub path: FilePath,
}

impl Node for ReadMesh {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((cx.read(&self.path)?,))
    }
}

/// The mesh in a file whose name ends in `ending`, of those that the engine reads; without what stands in other files.
///
/// # Errors
/// If the ending is another one, or the bytes are no such file.
pub fn read_mesh(bytes: &[u8], ending: &str) -> Result<Mesh, Error> {
    let name = format!("mesh.{ending}");
    format::read(&Reading::alone(&name, bytes)).map_err(|error| match error.downcast() {
        Some(NoReader { ending, known, .. }) => {
            NoReader { what: "mesh", ending: ending.clone(), known: known.clone() }.into()
        }
        None => error,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ending_says_what_is_read() {
        let triangle = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        assert_eq!(read_mesh(triangle, "obj").unwrap().faces().len(), 1);
        assert!(read_mesh(triangle, "ply").is_err());
        assert_eq!(
            read_mesh(&[[0; 80], [0; 80]].as_flattened()[..84], "stl").unwrap().faces().len(),
            0
        );
    }

    #[test]
    fn another_ending_is_an_error_that_lists_the_known_ones() {
        let error = read_mesh(b"", "fbx").unwrap_err();
        assert_eq!(
            error.to_string(),
            "no mesh can be read from `.fbx`; known are obj, ply, stl, glb"
        );
        assert!(matches!(error.downcast(), Some(NoReader { .. })));
    }
}
