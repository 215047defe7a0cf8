//! Corner data by the rules of a scheme: the mesh is cut where they jump, and they are refined as places are.

use maquette_value::{Attribute, Faces, Mesh};
use nalgebra::Point3;

use super::connectivity::Connectivity;
use super::manifold::cut;
use super::step::Step;
use super::topology::Topology;
use crate::boundary::Boundary;
use crate::options::Subdivision;
use crate::rules::Rules;
use crate::subdivide_error::SubdivideError;

/// `refined`, which has been made of `mesh`, with its corner data by the rules of `how`.
///
/// # Errors
/// If the mesh is not manifold.
pub(crate) fn smooth_corners(
    mesh: &Mesh,
    how: Subdivision,
    mut refined: Mesh,
) -> Result<Mesh, SubdivideError> {
    let (connectivity, _) = Connectivity::new(mesh.faces(), mesh.positions().len())?;
    let smooth = |old: &[[f64; 3]]| {
        let (corners, firsts) = cut(&connectivity, old);
        let mut places: Vec<Point3<f64>> =
            firsts.iter().map(|&corner| old[corner as usize].into()).collect();
        let mut faces = topology(mesh, corners, firsts.len(), how)?;
        let mut step: Option<Step> = None;
        for _ in 0..how.levels {
            let next = step.as_ref().map_or_else(|| Step::first(&faces), Step::next)?;
            places = next.positions(&places);
            step = Some(next);
        }
        if let Some(last) = &step {
            faces.faces = last.finer().clone();
        }
        let corners = faces.faces.corners().iter().map(|&corner| places[corner as usize].into());
        Ok::<Vec<[f64; 3]>, SubdivideError>(corners.collect())
    };
    for (name, attribute) in mesh.corner().iter().filter(|(name, _)| *name != "normal") {
        let attribute = match attribute {
            Attribute::Number(old) => {
                let smooth = smooth(&old.iter().map(|&x| [x, 0.0, 0.0]).collect::<Vec<_>>())?;
                Attribute::Number(smooth.into_iter().map(|[x, _, _]| x).collect())
            }
            Attribute::Pair(old) => {
                let smooth = smooth(&old.iter().map(|&[x, y]| [x, y, 0.0]).collect::<Vec<_>>())?;
                Attribute::Pair(smooth.into_iter().map(|[x, y, _]| [x, y]).collect())
            }
            Attribute::Vector(old) => Attribute::Vector(smooth(old)?.into()),
            Attribute::Index(_) | Attribute::Flag(_) | Attribute::Color(_) => continue,
        };
        refined = refined.with_corner(name, attribute)?;
    }
    Ok(refined)
}

/// The mesh with other vertices at its corners, whose seams are borders, and without creases.
fn topology(
    mesh: &Mesh,
    corners: Vec<u32>,
    vertices: usize,
    how: Subdivision,
) -> Result<Topology, SubdivideError> {
    let boundary = match how.boundary {
        Boundary::None => Boundary::EdgeOnly,
        boundary => boundary,
    };
    let rules = Rules { boundary, ..how.rules() };
    let faces = match mesh.faces().sides() {
        Some(sides) => Faces::uniform(sides, corners),
        None => {
            let sides: Vec<usize> = mesh.faces().iter().map(<[u32]>::len).collect();
            Faces::polygons(&sides, corners)
        }
    };
    Ok(Topology { rules, vertices, faces: faces?, creases: Vec::new() })
}
