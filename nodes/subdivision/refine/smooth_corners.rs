//! Smooth data: the mesh is cut at the seams of corner data, and the data are refined by the rules of the scheme, like positions. Data of
//! vertices have no seams.

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

/// Recomputes the data of the corners and vertices of `refined`, the refinement of `mesh` by `steps`, by the rules in `options`.
///
/// # Errors
/// If the mesh is not manifold.
pub(crate) fn smooth_corners(
    mesh: &Mesh,
    options: Subdivision,
    steps: &[Step],
    mut refined: Mesh,
) -> Result<Mesh, Error> {
    let (connectivity, _) = Connectivity::new(mesh.faces(), mesh.positions().len())?;
    for (name, attribute) in mesh.corner().iter().filter(|(name, _)| *name != "normal") {
        let smooth =
            smooth_attribute(attribute, |old| refine_data(mesh, &connectivity, old, options))?;
        if let Some(attribute) = smooth {
            refined = refined.with_corner(name, attribute)?;
        }
    }
    let of_vertices = mesh.vertex().iter().filter(|(name, _)| *name != "normal");
    let of_vertices = Vec::from_iter(of_vertices);
    if of_vertices.is_empty() {
        return Ok(refined);
    }
    let own;
    let steps = if mesh.creases().len() == 0 && options.boundary != Boundary::None {
        steps
    } else {
        let vertices = mesh.positions().len();
        own = plan_steps(
            &topology(mesh, mesh.faces().corners().to_vec(), vertices, options)?,
            options,
        )?;
        &own
    };
    for (name, attribute) in of_vertices {
        let smooth = smooth_attribute(attribute, |old| {
            let old = old.iter().map(|&row| row.into()).collect();
            let new =
                steps.iter().fold(old, |points: Vec<Point3<f64>>, step| step.positions(&points));
            Ok(new.into_iter().map(<[f64; 3]>::from).collect())
        })?;
        if let Some(attribute) = smooth {
            refined = refined.with_vertex(name, attribute)?;
        }
    }
    Ok(refined)
}

/// Applies `refine` to the numbers of an attribute. Returns `None` if the attribute has a type that is not refined smoothly.
fn smooth_attribute(
    attribute: &Attribute,
    refine: impl Fn(&[[f64; 3]]) -> Result<Vec<[f64; 3]>, Error>,
) -> Result<Option<Attribute>, Error> {
    Ok(Some(match attribute {
        Attribute::Number(old) => {
            let old: Vec<_> = old.iter().map(|&x| [x, 0.0, 0.0]).collect();
            Attribute::Number(refine(&old)?.into_iter().map(|[x, _, _]| x).collect())
        }
        Attribute::Pair(old) => {
            let old: Vec<_> = old.iter().map(|&[x, y]| [x, y, 0.0]).collect();
            Attribute::Pair(refine(&old)?.into_iter().map(|[x, y, _]| [x, y]).collect())
        }
        Attribute::Vector(old) => Attribute::Vector(refine(old)?.into()),
        Attribute::Index(_) | Attribute::Flag(_) | Attribute::Color(_) => return Ok(None),
    }))
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

/// Returns the refinement steps of a topology.
fn plan_steps(topology: &Topology, options: Subdivision) -> Result<Vec<Step>, Error> {
    let mut steps: Vec<Step> = Vec::with_capacity(options.levels as usize);
    for _ in 0..options.levels {
        steps.push(steps.last().map_or_else(|| Step::from_topology(topology), Step::next)?);
    }
    Ok(steps)
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
