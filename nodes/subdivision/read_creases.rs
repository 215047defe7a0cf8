//! Reads the creases of a mesh from a file.

use std::collections::BTreeSet;

use maquette_node::{Carry, Context, Error, FilePath, In, Node, Promise, Transfer, bail};
use maquette_value::Mesh;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::sharp_edges::merge_creases;

/// Reads the creases of a mesh from a JSON file: `{"edges": [{"v": [0, 1], "sharpness": 2.5}, ..]}`.
///
/// Vertices count from 0. Edges may also be in groups: `{"groups": [{"name": "rim", "edges": [..]}, ..]}`. Other keys are ignored. An
/// existing crease gets the new sharpness.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadCreases {
    /// Mesh.
    pub mesh: In<Mesh>,
    /// JSON file.
    pub path: FilePath,
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

    const CARRIES: &'static [Carry] = &[Carry::uniform("mesh", "mesh", Transfer::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((read_creases(cx.get(&self.mesh), cx.file(&self.path)?.bytes())?,))
    }
}

/// Returns `mesh` with the creases of a JSON file. The sharpness in the file replaces the old one; 0 removes a crease.
///
/// # Errors
/// If the bytes are not a list of creases, or a listed edge does not exist in the mesh.
pub fn read_creases(mesh: &Mesh, bytes: &[u8]) -> Result<Mesh, Error> {
    let file: File = serde_json::from_slice(bytes)
        .map_err(|error| Error::new(format!("expected a list of creases: {error}")))?;
    let edges: BTreeSet<[u32; 2]> = mesh.edges().vertices.into_iter().collect();
    let groups = file.groups.into_iter().flat_map(|group| group.edges);
    let creases: Vec<Edge> = file.edges.into_iter().chain(groups).collect();
    for &Edge { v: [a, b], sharpness } in &creases {
        if !edges.contains(&[a.min(b), a.max(b)]) {
            bail!(
                "there is no edge between the vertices {a} and {b}; the file is for a mesh with this edge, the given one has {} vertices, numbered from 0",
                mesh.positions().len()
            );
        }
        if !sharpness.is_finite() || sharpness < 0.0 {
            bail!(
                "the edge between the vertices {a} and {b} has the sharpness {sharpness}, expected at least 0"
            );
        }
    }
    Ok(merge_creases(mesh, creases.iter().map(|edge| (edge.v, edge.sharpness)), |_, new| new))
}

#[cfg(test)]
mod tests {
    use expect_test::{Expect, expect};
    use maquette_value::Faces;
    use nalgebra::Point3;

    use super::*;

    fn read(json: &str) -> Result<Mesh, Error> {
        let mesh =
            Mesh::new(vec![Point3::origin(); 4], Faces::triangles(vec![[0, 1, 2], [2, 1, 3]]));
        read_creases(&mesh.unwrap().with_creases([([0, 1], 7.0)]).unwrap(), json.as_bytes())
    }

    #[test]
    fn edges_inside_and_outside_of_groups_become_creases() {
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
    fn an_invalid_crease_is_an_error() {
        check(
            "[",
            expect!["expected a list of creases: EOF while parsing a list at line 1 column 1"],
        );
        check(
            r#"{"edges": [{"v": [0, 3], "sharpness": 1}]}"#,
            expect![
                "there is no edge between the vertices 0 and 3; the file is for a mesh with this edge, the given one has 4 vertices, numbered from 0"
            ],
        );
        check(
            r#"{"edges": [{"v": [0, 9], "sharpness": 1}]}"#,
            expect![
                "there is no edge between the vertices 0 and 9; the file is for a mesh with this edge, the given one has 4 vertices, numbered from 0"
            ],
        );
        check(
            r#"{"edges": [{"v": [0, 1], "sharpness": -1}]}"#,
            expect![
                "the edge between the vertices 0 and 1 has the sharpness -1, expected at least 0"
            ],
        );
    }
}
