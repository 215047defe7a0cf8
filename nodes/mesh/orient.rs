//! Orients faces outward.

use maquette_node::{Carry, Context, Error, In, Node, Promise, Transfer, bail};
use maquette_value::{Attribute, Mesh, MeshError};
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sheets::Sheets;
use side::outward_sides;

use super::turned_faces::turned_faces;

mod sheets;
mod side;

/// Orients faces consistently and outward.
///
/// First the faces of each part, connected by edges of two faces, are made consistent, by flipping as few as possible. Then whole parts are
/// flipped, as `outside` says. An edge of three or more faces does not connect parts. Positions do not change, and normals are flipped with
/// their faces.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Orient {
    /// The mesh.
    pub mesh: In<Mesh>,
    /// Rule for the outside.
    #[serde(default)]
    pub outside: Outside,
}

/// A rule for the outside.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Outside {
    /// The outside of each part. A closed part encloses a volume, and its outside is around it; within another closed part it is a cavity,
    /// whose faces look into it. An open part looks to the side where it bulges: the mean winding number on it (Jacobson, Kavan and
    /// Sorkine-Hornung, "Robust inside-outside segmentation using generalized winding numbers", 2013) is positive. A flat part does not
    /// change.
    #[default]
    Outward,
    /// The side that the sensor of a capture sees, as much as possible of each part; a closed part is oriented outward.
    Sensor,
    /// The side of the largest part, which does not change: all others are oriented outward if it is, inward if it is not.
    LargestPart,
    /// The opposite side of each face, regardless of its neighbors.
    Flip,
}

impl Node for Orient {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] = &[Carry::uniform("mesh", "mesh", Transfer::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        if mesh.faces().is_empty() {
            cx.warn("there are no faces that could be oriented");
        }
        let OrientedMesh { mesh, undecided, crowded } = cx
            .progress()
            .metered(VISITS_PER_FACE * mesh.faces().len(), || orient(mesh, self.outside))?;
        if undecided > 0 {
            let parts = match undecided {
                1 => "part is flat or bulges to neither side, and stays as it is",
                _ => "parts are flat or bulge to neither side, and stay as they are",
            };
            cx.warn(format!("{undecided} {parts}: `outside: Sensor` or `Flip` may help"));
        }
        if let Some((count, [a, b])) = crowded {
            let edges = if count == 1 { "edge has" } else { "edges have" };
            cx.warn(format!(
                "{count} {edges} more than two faces, such as the one at vertices {a} to {b}: no face can be consistent with all others there"
            ));
        }
        Ok((mesh,))
    }
}

/// The number of times that loops visit the elements around each face; for progress.
const VISITS_PER_FACE: usize = 40;

/// An oriented mesh, and the numbers of parts and edges that could not be handled.
pub struct OrientedMesh {
    /// The mesh after the rule `outside` was applied to its faces.
    pub mesh: Mesh,
    /// The number of parts for which no outside could be determined.
    pub undecided: usize,
    /// The number of edges with more than two faces, and the vertices of the first one; `None` if no edge has more than two faces.
    pub crowded: Option<(usize, [u32; 2])>,
}

/// Orients the faces of a mesh by the rule `outside`. The cost grows with the number of faces, and with the number of parts inside the
/// bounding boxes of other parts.
///
/// # Errors
/// Returns an error if a part has only one side, as a Moebius strip has, or the sensor is unknown.
pub fn orient(mesh: &Mesh, outside: Outside) -> Result<OrientedMesh, Error> {
    if outside == Outside::Flip {
        let mesh = flip_faces(mesh, &vec![true; mesh.faces().len()])?;
        return Ok(OrientedMesh { mesh, undecided: 0, crowded: None });
    }
    if outside == Outside::Sensor && mesh.frame().is_none() {
        bail!("the mesh is not from a capture, so its sensor is unknown: use `outside: Outward`");
    }
    let sheets = Sheets::new(mesh)?;
    let agreeing = flip_faces(mesh, &sheets.is_turned)?;
    let mut sides = outward_sides(&agreeing, &sheets);
    match outside {
        Outside::Sensor => {
            let seen = seen_sides(&agreeing, &sheets);
            let parts = sides.iter_mut().zip(seen).zip(&sheets.is_closed);
            parts.filter(|(_, is_closed)| !**is_closed).for_each(|((side, seen), _)| *side = seen);
        }
        Outside::LargestPart => like_the_largest(&agreeing, &sheets, &mut sides),
        Outside::Outward | Outside::Flip => {}
    }
    let is_turned: Vec<_> = sheets.of_face.iter().map(|&part| sides[part as usize] < 0.0).collect();
    let undecided = sides.iter().filter(|side| **side == 0.0).count();
    Ok(OrientedMesh {
        mesh: flip_faces(&agreeing, &is_turned)?,
        undecided,
        crowded: sheets.crowded,
    })
}

/// Returns, for each part, the solid angle of the faces whose front the sensor at the origin sees, minus the solid angle of the faces whose
/// back it sees.
fn seen_sides(mesh: &Mesh, sheets: &Sheets) -> Vec<f64> {
    let mut sides = vec![0.0; sheets.is_closed.len()];
    for (face, &part) in mesh.faces().iter().zip(&sheets.of_face) {
        let to = mesh.positions()[face[0] as usize].coords;
        let seen = -mesh.area_vector(face).dot(&to) / to.norm_squared().max(f64::MIN_POSITIVE);
        sides[part as usize] += seen;
    }
    sides
}

/// Orients all parts like the largest one, which does not change. A flat part is oriented such that its normal makes the smaller angle with
/// the normal of the largest part.
fn like_the_largest(mesh: &Mesh, sheets: &Sheets, sides: &mut [f64]) {
    let (mut areas, mut looks) = (vec![0.0; sides.len()], vec![Vector3::zeros(); sides.len()]);
    for (face, &part) in mesh.faces().iter().zip(&sheets.of_face) {
        let area = mesh.area_vector(face);
        areas[part as usize] += area.norm();
        looks[part as usize] += area;
    }
    let largest = (0..sides.len()).rev().max_by(|&a, &b| areas[a].total_cmp(&areas[b]));
    let Some(largest) = largest else { return };
    let like = sides[largest];
    for (side, look) in sides.iter_mut().zip(&looks) {
        *side = if *side == 0.0 || like == 0.0 { look.dot(&looks[largest]) } else { *side * like };
    }
    sides[largest] = 1.0;
}

/// Flips the faces marked in `is_turned`, and their normals. If only some faces of a vertex are flipped, the vertex gets the mean normal of
/// all its faces.
fn flip_faces(mesh: &Mesh, is_turned: &[bool]) -> Result<Mesh, MeshError> {
    if !is_turned.contains(&true) {
        return Ok(mesh.clone());
    }
    let mut turned = turned_faces(mesh, is_turned)?;
    fn opposite(normal: &[f64; 3]) -> [f64; 3] {
        normal.map(|x| -x)
    }
    if let Some(normals) = turned.corner().vectors("normal") {
        let faces = mesh.faces().iter().zip(is_turned);
        let flags = faces.flat_map(|(face, &flag)| std::iter::repeat_n(flag, face.len()));
        let normals = normals.iter().zip(flags);
        let normals = normals.map(|(normal, flag)| if flag { opposite(normal) } else { *normal });
        let normals = Attribute::Vector(normals.collect());
        turned = turned.with_corner("normal", normals)?;
    }
    if let Some(normals) = turned.vertex().vectors("normal") {
        // For each vertex two flags: true if at least one of its faces stays, and true if at least one is flipped.
        let mut has = vec![[false; 2]; mesh.positions().len()];
        for (face, &is_turned) in mesh.faces().iter().zip(is_turned) {
            face.iter().for_each(|&vertex| has[vertex as usize][usize::from(is_turned)] = true);
        }
        let means = turned.vertex_normals();
        let normals = normals.iter().zip(&has).zip(means).map(|((normal, has), mean)| match has {
            [_, false] => *normal,
            [false, true] => opposite(normal),
            [true, true] => mean.into(),
        });
        let normals = Attribute::Vector(normals.collect());
        turned = turned.with_vertex("normal", normals)?;
    }
    Ok(turned)
}

#[cfg(test)]
mod tests;
