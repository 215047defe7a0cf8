//! Reads a mesh from a file.

use maquette_base::unit::Unit;
use maquette_node::{
    ColorRange, Context, Error, FilePath, Forecast, InputFile, NoReader, Node, Sizes,
};
use maquette_value::parallel::*;
use maquette_value::{Mesh, MeshError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Reads a mesh: an OBJ, PLY, STL, GLB, glTF or 3MF file.
///
/// Coordinates are read unchanged, with y up, and converted to mm. GLB and glTF files are in meters, and the transforms of their nodes are
/// applied. A 3MF file states its unit; all items on its plate are read at their positions, rotated so that y is up. Coincident corners of
/// STL, GLB and glTF become one vertex. Other formats store vertices, which are kept: a warning says if borders coincide, and `Weld` joins
/// them.
///
/// Materials of GLB, glTF and OBJ files are kept with all their textures; of several, the attribute `material` of faces has the index. Of a
/// 3MF or PLY file the mesh has one texture. Missing files are warned of.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadMesh {
    /// The file; its extension determines the format.
    #[schemars(extend("reads" = "Mesh"))]
    pub path: FilePath,
    /// The unit of the file's coordinates; they are converted to mm. GLB, glTF and 3MF files state their unit, which has precedence.
    #[serde(default, skip_serializing_if = "Unit::is_millimeters")]
    #[schemars(extend("default" = "Mm"))]
    pub unit: Unit,
    /// The range of colors in PLY and OBJ files, which many do not state. If omitted, it is determined from all colors of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colors: Option<ColorRange>,
}

impl Node for ReadMesh {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        let mesh = sizes.file::<Mesh>(&self.path)?;
        let help = "simplify the mesh before it is read";
        Some(Forecast::new([Some(mesh)]).with_memory(2.0 * mesh.bytes, help))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.read_with_colors(&self.path, self.colors)?;
        let says_its_unit = ["glb", "gltf", "3mf"].contains(&&cx.file(&self.path)?.extension()[..]);
        Ok((if says_its_unit { mesh } else { mesh_in_millimeters(mesh, self.unit)? },))
    }
}

/// Converts a mesh from `unit` to mm.
///
/// # Errors
/// Returns an error if a coordinate is too large for mm.
pub fn mesh_in_millimeters(mesh: Mesh, unit: Unit) -> Result<Mesh, MeshError> {
    if unit.is_millimeters() {
        return Ok(mesh);
    }
    let positions = mesh.positions().par_iter().with_min_len(4096);
    let positions = positions.map(|point| point.map(|length| unit.in_millimeters(length)));
    let mut scaled = mesh.with_positions(positions.collect())?;
    // Normals are unit vectors, which do not depend on the unit.
    if let Some(normals) = mesh.vertex().get("normal") {
        scaled = scaled.with_vertex("normal", normals.clone())?;
    }
    if let Some(normals) = mesh.corner().get("normal") {
        scaled = scaled.with_corner("normal", normals.clone())?;
    }
    Ok(scaled)
}

/// Reads the mesh in a file with the extension `ending`, in any format that maquette reads itself, without data from other files.
///
/// # Errors
/// Returns an error if the extension is unknown, or the bytes are not a file of this format.
pub fn read_mesh(bytes: &[u8], ending: &str) -> Result<Mesh, Error> {
    let name = format!("mesh.{ending}");
    maquette_format::read(&InputFile::standalone(&name, bytes)).map_err(|error| {
        match error.downcast() {
            Some(NoReader { extension: ending, known, .. }) => {
                NoReader { what: "mesh", extension: ending.clone(), known: known.clone() }.into()
            }
            None => error,
        }
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
    fn every_unit_is_converted_to_millimeters_and_normals_stay() {
        let text = b"v 1 2 3\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\n";
        let mesh = read_mesh(text, "obj").unwrap();
        for (unit, z) in [(Unit::Mm, 3.0), (Unit::Cm, 30.0), (Unit::M, 3000.0), (Unit::Inch, 76.2)]
        {
            let scaled = mesh_in_millimeters(mesh.clone(), unit).unwrap();
            assert_eq!(scaled.positions()[0].z, z);
            assert_eq!(scaled.corner().get("normal"), mesh.corner().get("normal"));
            assert_eq!(scaled.vertex().get("normal"), mesh.vertex().get("normal"));
            assert_eq!(scaled.faces(), mesh.faces());
        }
        let far = read_mesh(b"v 1e308 0 0\n", "obj").unwrap();
        assert!(mesh_in_millimeters(far, Unit::M).is_err());
    }

    #[test]
    fn a_decimal_number_is_the_same_in_every_unit() {
        for text in ["12.3", "0.0123", "-847.300001", "1234.567891", "98765.4321", "0.1", "700000"]
        {
            let millimeters: f64 = text.parse().unwrap();
            for (unit, digits) in [(Unit::Cm, 1), (Unit::M, 3)] {
                let length = format!("{text}e-{digits}").parse().unwrap();
                assert_eq!(unit.in_millimeters(length), millimeters, "{text} from {unit:?}");
            }
        }
        assert_eq!(Unit::Inch.in_millimeters(0.3), 7.62);
        assert_eq!(Unit::M.in_millimeters(1e300), 1e303);
    }

    #[test]
    fn an_unknown_extension_is_an_error_that_lists_the_known_ones() {
        let error = read_mesh(b"", "fbx").unwrap_err();
        assert_eq!(
            error.to_string(),
            "no mesh can be read from `.fbx`; supported extensions: obj, ply, stl, glb, gltf, 3mf"
        );
        assert!(matches!(error.downcast(), Some(NoReader { .. })));
    }
}
