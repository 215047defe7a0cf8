//! Detection of folds.

use maquette_node::{Error, Progress};
use maquette_value::Mesh;

/// A refined surface has a fold between two neighboring faces if the cosine of the angle between their normals is less than this value.
const MIN_COSINE: f64 = -0.2;

/// Returns the sorted indices of the control faces at which a surface folds. `fine` is the surface after `levels` refinement steps.
pub(super) fn folds(fine: &Mesh, levels: u32) -> Vec<u32> {
    let edges = fine.edges();
    let mut sides = vec![None; edges.vertices.len()];
    let mut folds = Vec::new();
    for ((face, corners), of_corner) in
        (0_u32..).zip(fine.faces().iter()).zip(edges.of_corner.chunks(3))
    {
        let normal = fine.area_vector(corners).try_normalize(0.0).unwrap_or_default();
        for edge in of_corner {
            if let Some((other, there)) = sides[*edge as usize].replace((normal, face))
                && normal.dot(&other) < MIN_COSINE
            {
                folds.extend([face, there].map(|face| face >> (2 * levels)));
            }
        }
    }
    folds.sort_unstable();
    folds.dedup();
    folds
}

/// Returns the sorted indices of the control faces at which a surface runs through itself. `fine` is the surface after `levels` refinement
/// steps.
pub(super) fn crossings(
    fine: &Mesh,
    levels: u32,
    progress: &Progress<'_>,
) -> Result<Vec<u32>, Error> {
    let pairs = fine.crossings(|| progress.check())?;
    let mut faces: Vec<u32> = pairs.iter().flatten().map(|face| face >> (2 * levels)).collect();
    faces.sort_unstable();
    faces.dedup();
    Ok(faces)
}

/// Returns the corners of some faces and of all faces that have a corner in common with them, ascending.
pub(super) fn vertices_around(mesh: &Mesh, faces: &[u32]) -> Vec<u32> {
    let mut is_near = vec![false; mesh.positions().len()];
    let corners = faces.iter().flat_map(|&face| mesh.faces().face(face as usize));
    corners.for_each(|&vertex| is_near[vertex as usize] = true);
    let near = mesh.faces().iter().filter(|face| face.iter().any(|&v| is_near[v as usize]));
    let mut vertices: Vec<u32> = near.flatten().copied().collect();
    vertices.sort_unstable();
    vertices.dedup();
    vertices
}
