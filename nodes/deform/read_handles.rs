//! Reads handles from a file.

use maquette_format::handles::{read_csv, read_json, read_ron};
use maquette_node::{Context, Error, FilePath, Node};
use maquette_value::{HandleSpace, Handles};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Reads handles from a text file: RON, JSON or CSV.
///
/// RON: `[(at: (0, 0, 0), to: (0, 0, 1), sigma: (1, 1, 1), weight: 1)]`, where everything except `at` may be omitted; or, with the space of
/// the numbers, `Handles(space: World, handles: [..])`. JSON: the same structure with `{"at": [0, 0, 0]}`. CSV: one handle per line; the
/// first line has the column names `x,y,z,to_x,to_y,to_z,sigma_x,sigma_y,sigma_z,weight`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadHandles {
    /// File to read: `ron`, `json` or `csv`.
    #[schemars(extend("reads" = "Handles"))]
    pub path: FilePath,
    /// Coordinate space of the numbers, if the file does not specify it.
    #[serde(default)]
    pub space: HandleSpace,
}

/// The error for a handle file with an unknown extension, which the field holds.
#[derive(Debug, thiserror::Error)]
#[error("unknown extension `.{0}` of a file of handles; expected ron, json or csv")]
struct UnknownExtension(String);

impl Node for ReadHandles {
    type Outputs = (Handles,);
    const OUTPUTS: [&'static str; 1] = ["handles"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let file = cx.file(&self.path)?;
        match read_handles(file.bytes(), &file.extension(), self.space) {
            Err(error) if error.downcast::<UnknownExtension>().is_some() => {
                Ok((cx.read(&self.path)?,))
            }
            handles => Ok((handles?,)),
        }
    }
}

/// Returns the handles in a file with the given extension: `ron`, `json` or `csv`. They are in `space` unless the file specifies a space.
///
/// # Errors
/// Returns an error if the extension is unknown or the bytes are not valid.
pub fn read_handles(bytes: &[u8], extension: &str, space: HandleSpace) -> Result<Handles, Error> {
    match extension {
        "ron" => read_ron(bytes, space),
        "json" => read_json(bytes, space),
        "csv" => read_csv(bytes, space),
        _ => Err(UnknownExtension(extension.to_owned()).into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_extension_selects_the_format() {
        let space = HandleSpace::World;
        let ron = read_handles(b"[(at: (1, 2, 3), to: (4, 5, 6))]", "ron", space).unwrap();
        let csv = read_handles(b"x,y,z,to_x,to_y,to_z\n1,2,3,4,5,6\n", "csv", space).unwrap();
        let json =
            read_handles(b"[{\"at\": [1, 2, 3], \"to\": [4, 5, 6]}]", "json", space).unwrap();
        assert!(ron == csv && csv == json);
        let error = read_handles(b"", "xyz", space).unwrap_err();
        assert_eq!(
            error.to_string(),
            "unknown extension `.xyz` of a file of handles; expected ron, json or csv"
        );
    }
}
