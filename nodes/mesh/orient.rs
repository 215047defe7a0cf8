//! Turns faces so that their outside is outside.

use maquette_node::{Carry, Context, Error, Fate, In, Node, Promise};
use maquette_value::{Attribute, Mesh, MeshError};
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
pub use sheets::OneSided;
use sheets::Sheets;
use side::outward_sides;
use thiserror::Error;

use super::turned_faces::turned_faces;

mod sheets;
mod side;

/// Turns faces so that neighbors look to the same side, and that side is the outside.
///
/// First the faces of each part, what hangs together by edges of two faces, are made to agree, by as few turns as possible. Then whole parts
/// are turned, as `outside` says. An edge of three and more faces joins no parts. Nothing moves, and normals turn with their faces.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Orient {
    /// What is turned.
    pub mesh: In<Mesh>,
    /// What is the outside.
    #[serde(default)]
    pub outside: Outside,
}

/// What is the outside.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Outside {
    /// That of each part. A closed part encloses a volume, and its outside is around it; within another closed part it is a cavity, whose
    /// faces look into it. An open part has its outside where it bulges: the mean of the winding number on it (Jacobson, Kavan and
    /// Sorkine-Hornung, "Robust inside-outside segmentation using generalized winding numbers", 2013) is positive. A flat part stays.
    #[default]
    Outward,
    /// The side that the sensor of a capture sees, of each part as much of it as possible; a closed part is turned outward.
    Sensor,
    /// The side of the largest part, which stays: all others look outward if it does, inward if it does not.
    LargestPart,
    /// The other side of each face, whatever its neighbors do.
    Flip,
}

/// Why faces have no outside.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum OrientError {
    /// A part like a Moebius strip.
    #[error(transparent)]
    OneSided(#[from] OneSided),
    /// No sensor is known.
    #[error("no capture gave this mesh, so that no sensor is known: choose `outside: Outward`")]
    NoSensor,
    /// Never happens.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

impl Node for Orient {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] = &[Carry::all("mesh", "mesh", Fate::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        if mesh.faces().is_empty() {
            cx.warn("there are no faces that could be turned");
        }
        let Oriented { mesh, undecided, crowded } = orient(mesh, self.outside)?;
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
                "{count} {edges} more than two faces, such as the one at vertices {a} to {b}: no face can agree with all others there"
            ));
        }
        Ok((mesh,))
    }
}

/// What became of a mesh.
pub struct Oriented {
    /// The mesh with its faces turned.
    pub mesh: Mesh,
    /// How many parts have no outside.
    pub undecided: usize,
    /// How many edges have more than two faces, and the first of them.
    pub crowded: Option<(usize, [u32; 2])>,
}

/// The mesh with its faces turned as `outside` says. Cost grows with the number of faces, and with that of parts that lie within the boxes
/// of others.
///
/// # Errors
/// If a part has only one side, or the sensor is not known.
pub fn orient(mesh: &Mesh, outside: Outside) -> Result<Oriented, OrientError> {
    if outside == Outside::Flip {
        let mesh = turned(mesh, &vec![true; mesh.faces().len()])?;
        return Ok(Oriented { mesh, undecided: 0, crowded: None });
    }
    if outside == Outside::Sensor && mesh.frame().is_none() {
        return Err(OrientError::NoSensor);
    }
    let sheets = Sheets::new(mesh)?;
    let agreeing = turned(mesh, &sheets.is_turned)?;
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
    Ok(Oriented { mesh: turned(&agreeing, &is_turned)?, undecided, crowded: sheets.crowded })
}

/// Of each part, how much of it the origin sees from outside, less what it sees from inside.
fn seen_sides(mesh: &Mesh, sheets: &Sheets) -> Vec<f64> {
    let mut sides = vec![0.0; sheets.is_closed.len()];
    for (face, &part) in mesh.faces().iter().zip(&sheets.of_face) {
        let to = mesh.positions()[face[0] as usize].coords;
        let seen = -mesh.area_vector(face).dot(&to) / to.norm_squared().max(f64::MIN_POSITIVE);
        sides[part as usize] += seen;
    }
    sides
}

/// Makes all parts look as the largest one does, which stays; a flat part looks as near as possible to where that one looks.
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

/// The mesh with some faces turned, and their normals with them: where only some faces of a vertex are, it gets the mean of all.
fn turned(mesh: &Mesh, is_turned: &[bool]) -> Result<Mesh, MeshError> {
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
        // Whether a vertex has faces that stay, and faces that are turned.
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
