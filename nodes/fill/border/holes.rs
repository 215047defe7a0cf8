//! Finds the rims (boundary loops) of a mesh that enclose holes, and selects those to fill.

use maquette_base::topology::union_find::UnionFind;
use maquette_value::{Mesh, MeshError};
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::regions::{HoleRegion, cut};
use super::rims::vector_area;
use crate::triangles::triangulation::area_vector;

/// Selects the holes to fill.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
pub enum HoleChoice {
    /// All holes. The outer border of an open scan is not a hole.
    #[default]
    All,
    /// The hole with the longest rim.
    Largest,
    /// Holes with few edges.
    Edges {
        /// Maximum number of edges around a hole.
        #[schemars(range(min = 3))]
        max: usize,
    },
    /// The rims with the given numbers, even if they are outer borders. Rims are numbered from 0 in the order of their lowest vertices.
    Loops(Vec<usize>),
    /// Damaged data: the region is cut out of the mesh first, and the gap is filled.
    Region(HoleRegion),
}

/// The numbers of the boundary loops to fill (`holes`), and of the open surface's outer borders (`outer`) that match the user's choice but
/// are not holes.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ChosenRims {
    pub(crate) holes: Vec<usize>,
    pub(crate) outer: Vec<usize>,
}

/// Minimum length of a component's vector area (sum of its face area vectors), divided by its area, at which the component counts as an
/// open scan. For a sphere that lacks a cap, the ratio is the cap's fraction of the sphere's area, so nearly half of the sphere may be
/// missing. The ratio of a relief is above 0.5 unless the relief is more rugged than any landscape.
const MIN_OPEN_FRACTION: f64 = 0.4;

/// Selects the rims (boundary loops) of `mesh` to fill. `is_cut` is true for vertices that lost a face when damaged parts were cut out.
///
/// # Errors
/// Returns the first number in [`HoleChoice::Loops`] that no rim has.
pub(crate) fn choose(
    mesh: &Mesh,
    components: &Components,
    rims: &[Vec<u32>],
    choice: &HoleChoice,
    is_cut: &[bool],
) -> Result<ChosenRims, usize> {
    if let HoleChoice::Loops(numbers) = choice {
        if let Some(&number) = numbers.iter().find(|&&number| rims.len() <= number) {
            return Err(number);
        }
        let mut holes = numbers.clone();
        holes.sort_unstable();
        holes.dedup();
        return Ok(ChosenRims { holes, outer: Vec::new() });
    }
    let is_outer = outer_borders(mesh, components, rims);
    let (outer, holes): (Vec<usize>, Vec<usize>) = (0..rims.len()).partition(|&rim| is_outer[rim]);
    let chosen = ChosenRims { holes, outer };
    Ok(match choice {
        HoleChoice::All | HoleChoice::Loops(_) => chosen,
        HoleChoice::Largest => {
            let holes: Vec<usize> = longest(mesh, rims, &chosen.holes).into_iter().collect();
            let outer = if holes.is_empty() { chosen.outer } else { Vec::new() };
            ChosenRims { holes, outer }
        }
        HoleChoice::Edges { max } => chosen.filter(|rim| rims[rim].len() <= *max),
        HoleChoice::Region(_) => {
            chosen.filter(|rim| rims[rim].iter().any(|&vertex| is_cut[vertex as usize]))
        }
    })
}

impl ChosenRims {
    /// Keeps only the rims for which `keep` is true.
    fn filter(mut self, keep: impl Fn(usize) -> bool) -> Self {
        self.holes.retain(|&rim| keep(rim));
        self.outer.retain(|&rim| keep(rim));
        self
    }
}

fn length(mesh: &Mesh, rim: &[u32]) -> f64 {
    let ends = rim.iter().zip(rim[1..].iter().chain(&rim[..1]));
    ends.map(|(&a, &b)| (mesh.positions()[b as usize] - mesh.positions()[a as usize]).norm()).sum()
}

/// Returns the longest of the candidate rims; if several are equally long, the first of them. Returns `None` if there are no candidates.
fn longest(mesh: &Mesh, rims: &[Vec<u32>], candidates: &[usize]) -> Option<usize> {
    candidates
        .iter()
        .copied()
        .max_by(|&a, &b| length(mesh, &rims[a]).total_cmp(&length(mesh, &rims[b])).then(b.cmp(&a)))
}

/// The connected components of a mesh.
pub(crate) struct Components {
    /// For each vertex, the index of its component.
    vertex_components: Vec<u32>,
    /// For each component, its area and the sum of its face normals weighted by area.
    areas: Vec<(f64, Vector3<f64>)>,
}

impl Components {
    pub(crate) fn new(mesh: &Mesh) -> Self {
        let vertex_components = connected_components(mesh);
        let count = vertex_components.iter().max().map_or(0, |&last| last as usize + 1);
        let mut components =
            Self { vertex_components, areas: vec![(0.0, Vector3::zeros()); count] };
        match mesh.faces().as_triangles() {
            Some(faces) => {
                for face in faces {
                    let corners = face.map(|vertex: u32| mesh.positions()[vertex as usize]);
                    components.add(face[0], area_vector(corners) / 2.0);
                }
            }
            None => {
                for face in mesh.faces().iter() {
                    components.add(face[0], mesh.area_vector(face));
                }
            }
        }
        components
    }

    /// Adds the area vector of a face to the totals of the component that contains `vertex`, one of the face's vertices.
    fn add(&mut self, vertex: u32, area: Vector3<f64>) {
        let (sum, side) = &mut self.areas[self.vertex_components[vertex as usize] as usize];
        *sum += area.norm();
        *side += area;
    }

    /// Returns the index of the component that contains a vertex.
    pub(crate) fn component_of(&self, vertex: u32) -> u32 {
        self.vertex_components[vertex as usize]
    }

    /// Returns the number of components that have faces.
    pub(crate) fn count(&self) -> usize {
        self.areas.iter().filter(|(area, _)| *area > 0.0).count()
    }
}

/// Returns, for each rim, whether it is the outer border of an open component. A component is open if the mesh comes from a scanner capture
/// or if its faces mostly face one side. Its outer border is the rim that runs around that side and encloses the largest area.
fn outer_borders(mesh: &Mesh, components: &Components, rims: &[Vec<u32>]) -> Vec<bool> {
    let mut is_outer = vec![false; rims.len()];
    // For each component: the signed area enclosed by the outermost rim found so far, and the index of that rim.
    let mut outermost = vec![(0.0, usize::MAX); components.areas.len()];
    for (rim, vertices) in rims.iter().enumerate() {
        let component = components.vertex_components[vertices[0] as usize] as usize;
        let (area, side) = components.areas[component];
        if mesh.frame().is_some() || side.norm() > MIN_OPEN_FRACTION * area {
            let towards = vector_area(mesh, vertices).dot(&side);
            if towards < outermost[component].0 {
                outermost[component] = (towards, rim);
            }
        }
    }
    let found = outermost.iter().filter(|(_, rim)| *rim != usize::MAX);
    found.for_each(|&(_, rim)| is_outer[rim] = true);
    is_outer
}

/// Returns `mesh` without the components that a cut has isolated: those whose vertices have all lost a face (`is_cut`). Such components
/// cannot be closed, and the rims around them are not holes.
///
/// # Errors
/// Does not fail for a valid mesh.
pub(crate) fn without_isolated_components(
    mesh: Mesh,
    is_cut: Vec<bool>,
) -> Result<(Mesh, Vec<bool>), MeshError> {
    let components = connected_components(&mesh);
    let mut is_isolated = vec![true; components.len()];
    for (&component, _) in components.iter().zip(&is_cut).filter(|(_, is_cut)| !**is_cut) {
        is_isolated[component as usize] = false;
    }
    let isolated: Vec<bool> =
        components.iter().map(|&component| is_isolated[component as usize]).collect();
    // If all components are isolated, the mesh is kept unchanged; otherwise nothing would be left.
    if isolated.iter().all(|&isolated| isolated) || !isolated.contains(&true) {
        return Ok((mesh, is_cut));
    }
    let kept = is_cut.iter().zip(&isolated).filter(|(_, isolated)| !**isolated);
    Ok((cut(&mesh, &isolated)?.0, kept.map(|(&is_cut, _)| is_cut).collect()))
}

/// Returns the component index of each vertex; components are numbered in the order of their lowest vertex indices.
fn connected_components(mesh: &Mesh) -> Vec<u32> {
    let mut sets = UnionFind::new(mesh.positions().len());
    match mesh.faces().as_triangles() {
        Some(faces) => faces.iter().for_each(|&[a, b, c]| {
            sets.union(a, b);
            sets.union(b, c);
        }),
        None => {
            let pairs = mesh.faces().iter().flat_map(|face| face.windows(2));
            pairs.for_each(|pair| sets.union(pair[0], pair[1]));
        }
    }
    sets.into_labels().0
}
