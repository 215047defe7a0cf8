//! Reads handles from a file.

use maquette_format::handles::{HandlesFileError, read_csv, read_json, read_ron};
use maquette_node::{Context, Error, FilePath, Node};
use maquette_value::{HandleSpace, Handles};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Reads handles from a small text: RON, JSON or CSV.
///
/// RON: `[(at: (0, 0, 0), to: (0, 0, 1), sigma: (1, 1, 1), weight: 1)]`, where everything but `at` may be left out; or, with
/// the space of the numbers, `Handles(space: World, handles: [..])`. JSON: the same with `{"at": [0, 0, 0]}`. CSV: a handle a
/// line, the first of which names the columns `x,y,z,to_x,to_y,to_z,sigma_x,sigma_y,sigma_z,weight`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadHandles {
    /// The file: `ron`, `json` or `csv`.
    #[schemars(extend("reads" = "Handles"))]
    pub path: FilePath,
    /// The space of the numbers, where the file does not say it.
    #[serde(default)]
    pub space: HandleSpace,
}

/// Why there are no handles.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ReadHandlesError {
    /// A file of another format.
    #[error("no handles can be read from `.{ending}`; known are ron, json, csv")]
    Ending {
        /// The ending of the file's name, without the dot.
        ending: String,
    },
    /// A file that holds no handles.
    #[error(transparent)]
    File(#[from] HandlesFileError),
}

impl Node for ReadHandles {
    type Outputs = (Handles,);
    const OUTPUTS: [&'static str; 1] = ["handles"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let file = cx.file(&self.path)?;
        match read_handles(file.bytes(), &file.ending(), self.space) {
            Err(ReadHandlesError::Ending { .. }) => Ok((cx.read(&self.path)?,)),
            handles => Ok((handles?,)),
        }
    }
}

/// The handles in a file whose name ends in `ending`: `ron`, `json` or `csv`. They are in `space` where the file does not say
/// it.
///
/// # Errors
/// If the ending is another one, or the bytes are no such file.
pub fn read_handles(
    bytes: &[u8],
    ending: &str,
    space: HandleSpace,
) -> Result<Handles, ReadHandlesError> {
    Ok(match ending {
        "ron" => read_ron(bytes, space)?,
        "json" => read_json(bytes, space)?,
        "csv" => read_csv(bytes, space)?,
        _ => return Err(ReadHandlesError::Ending { ending: ending.to_owned() }),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ending_says_what_is_read() {
        let space = HandleSpace::World;
        let ron = read_handles(b"[(at: (1, 2, 3), to: (4, 5, 6))]", "ron", space).unwrap();
        let csv = read_handles(b"x,y,z,to_x,to_y,to_z\n1,2,3,4,5,6\n", "csv", space).unwrap();
        let json =
            read_handles(b"[{\"at\": [1, 2, 3], \"to\": [4, 5, 6]}]", "json", space).unwrap();
        assert!(ron == csv && csv == json);
        let error = read_handles(b"", "xyz", space).unwrap_err();
        assert_eq!(
            error.to_string(),
            "no handles can be read from `.xyz`; known are ron, json, csv"
        );
    }
}
