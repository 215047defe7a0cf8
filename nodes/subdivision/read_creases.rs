//! Reads the creases of a mesh from a file.

use std::collections::BTreeSet;

use maquette_node::{Carry, Context, Error, Fate, FilePath, In, Node, Promise};
use maquette_value::Mesh;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::sharp_edges::merged;

/// Makes edges of a mesh sharp as a JSON file says: `{"edges": [{"v": [0, 1], "sharpness": 2.5}, ..]}`.
///
/// Vertices count from 0. Edges may also stand in groups: `{"groups": [{"name": "rim", "edges": [..]}, ..]}`; any other word is for
/// people. A crease that the mesh has already gets the new sharpness.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadCreases {
    /// The mesh.
    pub mesh: In<Mesh>,
    /// The file.
    pub path: FilePath,
}

/// Why a file holds no creases of a mesh.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ReadCreasesError {
    /// The file is not what is expected.
    #[error("no list of creases: {0}")]
    Json(String),
    /// Two vertices without an edge between them.
    #[error("there is no edge between the vertices {} and {}", ends[0], ends[1])]
    NoEdge {
        /// The vertices.
        ends: [u32; 2],
    },
    /// A sharpness below 0.
    #[error("the edge between the vertices {} and {} cannot have the sharpness {sharpness}", ends[0], ends[1])]
    Sharpness {
        /// The vertices.
        ends: [u32; 2],
        /// The sharpness.
        sharpness: f64,
    },
}

#[derive(Deserialize)]
struct File {
    #[serde(default)]
    edges: Vec<Edge>,
    #[serde(default)]
    groups: Vec<Group>,
}

#[derive(Deserialize)]
struct Group {
    edges: Vec<Edge>,
}

#[derive(Deserialize)]
struct Edge {
    v: [u32; 2],
    sharpness: f64,
}

impl Node for ReadCreases {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] = &[Carry::all("mesh", "mesh", Fate::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((read_creases(cx.get(&self.mesh), cx.file(&self.path)?.bytes())?,))
    }
}

/// `mesh` with the creases in a JSON file; the sharpness of the edges named there replaces theirs, 0 takes a crease away.
///
/// # Errors
/// If the bytes are no list of creases, or it names what is no edge of the mesh.
pub fn read_creases(mesh: &Mesh, bytes: &[u8]) -> Result<Mesh, ReadCreasesError> {
    let file: File =
        serde_json::from_slice(bytes).map_err(|error| ReadCreasesError::Json(error.to_string()))?;
    let edges: BTreeSet<[u32; 2]> = mesh.edges().vertices.into_iter().collect();
    let groups = file.groups.into_iter().flat_map(|group| group.edges);
    let creases: Vec<Edge> = file.edges.into_iter().chain(groups).collect();
    for &Edge { v: [a, b], sharpness } in &creases {
        if !edges.contains(&[a.min(b), a.max(b)]) {
            return Err(ReadCreasesError::NoEdge { ends: [a, b] });
        }
        if !sharpness.is_finite() || sharpness < 0.0 {
            return Err(ReadCreasesError::Sharpness { ends: [a, b], sharpness });
        }
    }
    Ok(merged(mesh, creases.iter().map(|edge| (edge.v, edge.sharpness)), |_, new| new))
}

#[cfg(test)]
mod tests {
    use expect_test::{Expect, expect};
    use maquette_value::Faces;
    use nalgebra::Point3;

    use super::*;

    fn read(json: &str) -> Result<Mesh, ReadCreasesError> {
        let mesh =
            Mesh::new(vec![Point3::origin(); 4], Faces::triangles(vec![[0, 1, 2], [2, 1, 3]]));
        read_creases(&mesh.unwrap().with_creases([([0, 1], 7.0)]).unwrap(), json.as_bytes())
    }

    #[test]
    fn edges_in_groups_and_without_become_sharp() {
        let mesh = read(
            r#"{"mesh": "a word", "edges": [{"v": [2, 1], "sharpness": 1.5}], "groups": [{"name": "rim", "edges":
                [{"v": [1, 3], "sharpness": 10}, {"v": [0, 1], "sharpness": 0}]}]}"#,
        );
        let creases: Vec<_> = mesh.unwrap().creases().collect();
        assert_eq!(creases, [([1, 2], 1.5), ([1, 3], 10.0)]);
    }

    fn check(json: &str, error: Expect) {
        error.assert_eq(&read(json).unwrap_err().to_string());
    }

    #[test]
    fn what_is_no_crease_is_an_error() {
        check("[", expect!["no list of creases: EOF while parsing a list at line 1 column 1"]);
        check(
            r#"{"edges": [{"v": [0, 3], "sharpness": 1}]}"#,
            expect!["there is no edge between the vertices 0 and 3"],
        );
        check(
            r#"{"edges": [{"v": [0, 9], "sharpness": 1}]}"#,
            expect!["there is no edge between the vertices 0 and 9"],
        );
        check(
            r#"{"edges": [{"v": [0, 1], "sharpness": -1}]}"#,
            expect!["the edge between the vertices 0 and 1 cannot have the sharpness -1"],
        );
    }
}
