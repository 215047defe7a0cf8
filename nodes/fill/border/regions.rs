//! Cuts damaged data out of a mesh.

use maquette_value::{Attribute, Faces, Mesh, MeshError};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Where data is damaged.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub enum HoleRegion {
    /// Within a ball.
    Ball {
        /// Its middle: x, y, z.
        #[schemars(extend("unit" = "mm"))]
        at: [f64; 3],
        /// Its radius.
        #[schemars(range(min = 0.0), extend("unit" = "mm"))]
        radius: f64,
    },
    /// Within a box along the axes, sides included.
    Box {
        /// Its lowest x, y, z.
        #[schemars(extend("unit" = "mm", "most" = "high"))]
        low: [f64; 3],
        /// Its highest x, y, z.
        #[schemars(extend("unit" = "mm"))]
        high: [f64; 3],
    },
    /// Where a vertex attribute is not 0.
    Marked {
        /// Its name: a flag, a whole or a real number per vertex.
        attribute: String,
    },
}

/// A vertex attribute that cannot mark anything.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("there is no flag or number per vertex named `{0}`")]
pub struct NoMarks(pub String);

/// Of each vertex whether it lies in the region.
///
/// # Errors
/// If the region names an attribute that the mesh does not have as a flag or number.
pub(crate) fn within(mesh: &Mesh, region: &HoleRegion) -> Result<Vec<bool>, NoMarks> {
    let points = mesh.positions().iter();
    Ok(match region {
        HoleRegion::Ball { at, radius } => {
            let middle = Point3::from(*at);
            points.map(|point| (point - middle).norm() <= *radius).collect()
        }
        HoleRegion::Box { low, high } => {
            let inside =
                |point: &Point3<f64>| (0..3).all(|k| low[k] <= point[k] && point[k] <= high[k]);
            points.map(inside).collect()
        }
        HoleRegion::Marked { attribute } => marks(mesh, attribute)?,
    })
}

/// Of each vertex whether an attribute marks it.
///
/// # Errors
/// If there is no such flag or number per vertex.
pub(crate) fn marks(mesh: &Mesh, name: &str) -> Result<Vec<bool>, NoMarks> {
    Ok(match mesh.vertex().get(name) {
        Some(Attribute::Flag(flags)) => flags.iter().map(|&flag| flag != 0).collect(),
        Some(Attribute::Index(numbers)) => numbers.iter().map(|&number| number != 0).collect(),
        Some(Attribute::Number(numbers)) => numbers.iter().map(|&number| number != 0.0).collect(),
        _ => return Err(NoMarks(name.to_owned())),
    })
}

/// The mesh without the marked vertices and their faces, and without vertices that no face has any more; and of each vertex that is left
/// whether a face next to it went. The others keep their order.
///
/// # Errors
/// None that a mesh can cause.
pub(crate) fn cut(mesh: &Mesh, damaged: &[bool]) -> Result<(Mesh, Vec<bool>), MeshError> {
    let count = mesh.positions().len();
    let (mut used, mut lost) = (vec![false; count], vec![false; count]);
    let (mut sides, mut corners) = (Vec::new(), Vec::new());
    let (mut kept_faces, mut kept_corners) = (Vec::new(), Vec::new());
    let mut first = 0;
    for (index, face) in (0..).zip(mesh.faces().iter()) {
        let is_cut = face.iter().any(|&vertex| damaged[vertex as usize]);
        let marks = if is_cut { &mut lost } else { &mut used };
        face.iter().for_each(|&vertex| marks[vertex as usize] = true);
        if !is_cut {
            sides.push(face.len());
            corners.extend_from_slice(face);
            kept_faces.push(index);
            kept_corners.extend(first..first + face.len() as u32);
        }
        first += face.len() as u32;
    }
    // A vertex that never had a face stays.
    let stays = |&vertex: &u32| {
        let vertex = vertex as usize;
        !damaged[vertex] && (used[vertex] || !lost[vertex])
    };
    let kept: Vec<u32> = (0..count as u32).filter(stays).collect();
    let mut numbers = vec![0; count];
    (0..).zip(&kept).for_each(|(number, &vertex)| numbers[vertex as usize] = number);
    corners.iter_mut().for_each(|corner| *corner = numbers[*corner as usize]);
    let positions: Vec<_> = kept.iter().map(|&vertex| mesh.positions()[vertex as usize]).collect();
    let creases = mesh.creases().filter(|(ends, _)| ends.iter().all(stays));
    let creases = creases.map(|(ends, sharp)| (ends.map(|end| numbers[end as usize]), sharp));
    let mut left = Mesh::new(positions, Faces::polygons(&sides, corners)?)?
        .with_creases(creases)?
        .with_materials(mesh.materials().clone())
        .with_frame(mesh.frame().copied());
    for (name, attribute) in mesh.vertex().iter() {
        left = left.with_vertex(name, attribute.select(&kept))?;
    }
    for (name, attribute) in mesh.corner().iter() {
        left = left.with_corner(name, attribute.select(&kept_corners))?;
    }
    for (name, attribute) in mesh.face().iter() {
        left = left.with_face(name, attribute.select(&kept_faces))?;
    }
    Ok((left, kept.iter().map(|&vertex| lost[vertex as usize]).collect()))
}
