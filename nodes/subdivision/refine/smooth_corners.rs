//! Smooth corner data: the mesh is cut at the seams, and the data are refined by the rules of the scheme, like positions.

use maquette_node::Error;
use maquette_value::{Attribute, Faces, Mesh};
use nalgebra::Point3;

use super::connectivity::Connectivity;
use super::manifold::cut;
use super::step::Step;
use super::topology::Topology;
use crate::boundary::Boundary;
use crate::options::Subdivision;
use crate::rules::Rules;

/// Recomputes the corner data of `refined`, the refinement of `mesh`, by the rules in `options`.
///
/// # Errors
/// If the mesh is not manifold.
pub(crate) fn smooth_corners(
    mesh: &Mesh,
    options: Subdivision,
    mut refined: Mesh,
) -> Result<Mesh, Error> {
    let (connectivity, _) = Connectivity::new(mesh.faces(), mesh.positions().len())?;
    for (name, attribute) in mesh.corner().iter().filter(|(name, _)| *name != "normal") {
        let attribute = match attribute {
            Attribute::Number(old) => {
                let old: Vec<_> = old.iter().map(|&x| [x, 0.0, 0.0]).collect();
                let smooth = refine_data(mesh, &connectivity, &old, options)?;
                Attribute::Number(smooth.into_iter().map(|[x, _, _]| x).collect())
            }
            Attribute::Pair(old) => {
                let old: Vec<_> = old.iter().map(|&[x, y]| [x, y, 0.0]).collect();
                let smooth = refine_data(mesh, &connectivity, &old, options)?;
                Attribute::Pair(smooth.into_iter().map(|[x, y, _]| [x, y]).collect())
            }
            Attribute::Vector(old) => {
                Attribute::Vector(refine_data(mesh, &connectivity, old, options)?.into())
            }
            Attribute::Index(_) | Attribute::Flag(_) | Attribute::Color(_) => continue,
        };
        refined = refined.with_corner(name, attribute)?;
    }
    Ok(refined)
}

/// Refines corner data by the rules in `options`, as if they were vertex positions of the mesh after cutting it at seams. Returns the data
/// at the refined corners.
fn refine_data(
    mesh: &Mesh,
    connectivity: &Connectivity,
    old: &[[f64; 3]],
    options: Subdivision,
) -> Result<Vec<[f64; 3]>, Error> {
    let (corners, firsts) = cut(connectivity, old);
    let mut positions: Vec<Point3<f64>> =
        firsts.iter().map(|&corner| old[corner as usize].into()).collect();
    let mut faces = topology(mesh, corners, firsts.len(), options)?;
    let mut step: Option<Step> = None;
    for _ in 0..options.levels {
        let next = step.as_ref().map_or_else(|| Step::from_topology(&faces), Step::next)?;
        positions = next.positions(&positions);
        step = Some(next);
    }
    if let Some(last) = &step {
        faces.faces = last.finer().clone();
    }
    Ok(faces.faces.corners().iter().map(|&corner| positions[corner as usize].into()).collect())
}

/// Returns the topology of the mesh after cutting it at seams. The seams become borders, and there are no creases.
fn topology(
    mesh: &Mesh,
    corners: Vec<u32>,
    vertices: usize,
    options: Subdivision,
) -> Result<Topology, Error> {
    let boundary = match options.boundary {
        Boundary::None => Boundary::EdgeOnly,
        boundary => boundary,
    };
    let rules = Rules { boundary, ..options.rules() };
    let faces = match mesh.faces().sides() {
        Some(sides) => Faces::uniform(sides, corners),
        None => {
            let sides: Vec<usize> = mesh.faces().iter().map(<[u32]>::len).collect();
            Faces::polygons(&sides, corners)
        }
    };
    Ok(Topology { rules, vertices, faces: faces?, creases: Vec::new() })
}
