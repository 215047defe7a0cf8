//! Cuts damaged regions out of a mesh.

use maquette_node::{Error, bail};
use maquette_value::{Attribute, Faces, Mesh, MeshError};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A region of damaged data.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub enum HoleRegion {
    /// The vertices in a ball.
    Ball {
        /// Center of the ball: x, y, z.
        #[schemars(extend("unit" = "mm"))]
        at: [f64; 3],
        /// Radius of the ball.
        #[schemars(range(min = 0.0), extend("unit" = "mm"))]
        radius: f64,
    },
    /// The vertices in an axis-aligned box, including its boundary.
    Box {
        /// Minimum corner of the box: x, y, z.
        #[schemars(extend("unit" = "mm", "most" = "high"))]
        low: [f64; 3],
        /// Maximum corner of the box: x, y, z.
        #[schemars(extend("unit" = "mm"))]
        high: [f64; 3],
    },
    /// The vertices at which the given attribute is not 0.
    Marked {
        /// Name of the attribute: a flag, an integer or a number per vertex.
        attribute: String,
    },
}

/// Returns, for each vertex, whether it is in the region.
///
/// # Errors
/// Returns an error if the region names an attribute that the mesh does not have as a flag or number per vertex.
pub(crate) fn vertices_in_region(mesh: &Mesh, region: &HoleRegion) -> Result<Vec<bool>, Error> {
    let points = mesh.positions().iter();
    Ok(match region {
        HoleRegion::Ball { at, radius } => {
            let center = Point3::from(*at);
            points.map(|point| (point - center).norm() <= *radius).collect()
        }
        HoleRegion::Box { low, high } => {
            points.map(|point| (0..3).all(|k| low[k] <= point[k] && point[k] <= high[k])).collect()
        }
        HoleRegion::Marked { attribute } => marked_vertices(mesh, attribute)?,
    })
}

/// Returns, for each vertex, whether the attribute `name` is not 0.
///
/// # Errors
/// Returns an error if the mesh has no flag or number named `name` per vertex.
pub(crate) fn marked_vertices(mesh: &Mesh, name: &str) -> Result<Vec<bool>, Error> {
    fn is_mark(attribute: &Attribute) -> bool {
        matches!(attribute, Attribute::Flag(_) | Attribute::Index(_) | Attribute::Number(_))
    }
    Ok(match mesh.vertex().get(name) {
        Some(Attribute::Flag(flags)) => flags.iter().map(|&flag| flag != 0).collect(),
        Some(Attribute::Index(numbers)) => numbers.iter().map(|&number| number != 0).collect(),
        Some(Attribute::Number(numbers)) => numbers.iter().map(|&number| number != 0.0).collect(),
        _ => {
            let others = mesh.vertex().iter().filter(|(_, attribute)| is_mark(attribute));
            let others: Vec<_> = others.map(|(name, _)| format!("`{name}`")).collect();
            let others = if others.is_empty() { "none".to_owned() } else { others.join(", ") };
            bail!("the mesh has no vertex attribute `{name}` of flags or numbers; it has {others}")
        }
    })
}

/// Removes the vertices for which `damaged` is true, their faces, and the vertices that lose all their faces. Returns the remaining mesh,
/// whose vertices and faces keep their order. Also returns, for each remaining vertex, whether one of its faces was removed.
///
/// # Errors
/// Does not fail for a valid mesh.
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
    // Keep a vertex that had no face before the cut.
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
