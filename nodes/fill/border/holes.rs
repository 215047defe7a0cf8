//! Which rims of a mesh are holes, and which of these are chosen.

use maquette_base::topology::union_find::UnionFind;
use maquette_value::{Mesh, MeshError};
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::regions::{HoleRegion, cut};
use super::rims::enclosed;
use crate::triangles::triangulation::area_vector;

/// Which holes are filled.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
pub enum HoleChoice {
    /// All of them; the outer border of an open scan is none.
    #[default]
    All,
    /// The one with the longest rim.
    Largest,
    /// Small ones.
    Edges {
        /// The most edges around a hole.
        #[schemars(range(min = 3))]
        max: usize,
    },
    /// These rims, even if they are outer borders; they are numbered from 0 by their lowest vertices.
    Loops(Vec<usize>),
    /// Damaged data, which is cut out first; what is left of it is the hole.
    Region(HoleRegion),
}

/// The rims to fill, by number, and the outer borders that the choice would include if they were holes.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Chosen {
    pub(crate) holes: Vec<usize>,
    pub(crate) outer: Vec<usize>,
}

/// A component whose faces look to one side by more than this share of their area is an open scan: of a sphere that lacks a cap
/// this is the share of the cap, so that nearly half of it may be missing. A relief has one above 0.5 unless it is more rugged than any
/// landscape.
const OPEN: f64 = 0.4;

/// Chooses among the rims of `mesh`; `is_cut` says of a vertex whether data was cut out next to it.
///
/// # Errors
/// The number of a rim that does not exist.
pub(crate) fn choose(
    mesh: &Mesh,
    components: &Components,
    rims: &[Vec<u32>],
    choice: &HoleChoice,
    is_cut: &[bool],
) -> Result<Chosen, usize> {
    if let HoleChoice::Loops(numbers) = choice {
        if let Some(&number) = numbers.iter().find(|&&number| rims.len() <= number) {
            return Err(number);
        }
        let mut holes = numbers.clone();
        holes.sort_unstable();
        holes.dedup();
        return Ok(Chosen { holes, outer: Vec::new() });
    }
    let is_outer = outer_borders(mesh, components, rims);
    let (outer, holes): (Vec<usize>, Vec<usize>) = (0..rims.len()).partition(|&rim| is_outer[rim]);
    fn kept(rims: Vec<usize>, keep: &dyn Fn(usize) -> bool) -> Vec<usize> {
        rims.into_iter().filter(|&rim| keep(rim)).collect()
    }
    Ok(match choice {
        HoleChoice::All | HoleChoice::Loops(_) => Chosen { holes, outer },
        HoleChoice::Largest => {
            let holes: Vec<usize> = longest(mesh, rims, &holes).into_iter().collect();
            let outer = if holes.is_empty() { outer } else { Vec::new() };
            Chosen { holes, outer }
        }
        HoleChoice::Edges { max } => {
            let small = |rim: usize| rims[rim].len() <= *max;
            Chosen { holes: kept(holes, &small), outer: kept(outer, &small) }
        }
        HoleChoice::Region(_) => {
            let cut = |rim: usize| rims[rim].iter().any(|&vertex| is_cut[vertex as usize]);
            Chosen { holes: kept(holes, &cut), outer: kept(outer, &cut) }
        }
    })
}

fn length(mesh: &Mesh, rim: &[u32]) -> f64 {
    let ends = rim.iter().zip(rim[1..].iter().chain(&rim[..1]));
    ends.map(|(&a, &b)| (mesh.positions()[b as usize] - mesh.positions()[a as usize]).norm()).sum()
}

/// The longest of some rims, the first of several; `None` without rims.
fn longest(mesh: &Mesh, rims: &[Vec<u32>], candidates: &[usize]) -> Option<usize> {
    let length = |rim: usize| length(mesh, &rims[rim]);
    candidates.iter().copied().max_by(|&a, &b| length(a).total_cmp(&length(b)).then(b.cmp(&a)))
}

/// The connected components of a mesh.
pub(crate) struct Components {
    /// The number of the component of each vertex.
    of_vertices: Vec<u32>,
    /// The area of each component, and the sum of its faces' normals by their areas.
    areas: Vec<(f64, Vector3<f64>)>,
}

impl Components {
    pub(crate) fn new(mesh: &Mesh) -> Self {
        let of_vertices = connected_components(mesh);
        let count = of_vertices.iter().max().map_or(0, |&last| last as usize + 1);
        let mut areas = vec![(0.0, Vector3::zeros()); count];
        fn add(
            vertex: u32,
            area: Vector3<f64>,
            areas: &mut Vec<(f64, Vector3<f64>)>,
            of_vertices: &[u32],
        ) {
            let (sum, side) = &mut areas[of_vertices[vertex as usize] as usize];
            *sum += area.norm();
            *side += area;
        }
        match mesh.faces().as_triangles() {
            Some(faces) => {
                faces.iter().for_each(|face| {
                    add(
                        face[0],
                        area_vector(face.map(|vertex: u32| mesh.positions()[vertex as usize]))
                            / 2.0,
                        &mut areas,
                        &of_vertices,
                    )
                });
            }
            None => mesh
                .faces()
                .iter()
                .for_each(|face| add(face[0], mesh.area_vector(face), &mut areas, &of_vertices)),
        }
        Self { of_vertices, areas }
    }

    /// The number of the component that a vertex is in.
    pub(crate) fn of(&self, vertex: u32) -> u32 {
        self.of_vertices[vertex as usize]
    }

    /// How many there are that have faces.
    pub(crate) fn count(&self) -> usize {
        self.areas.iter().filter(|(area, _)| *area > 0.0).count()
    }
}

/// Whether each rim is the outer border of an open component: the one that runs around the side to which the component's faces look
/// together. Components that come from a capture are open, and others if their faces mostly look to one side.
fn outer_borders(mesh: &Mesh, components: &Components, rims: &[Vec<u32>]) -> Vec<bool> {
    let mut is_outer = vec![false; rims.len()];
    // Of each component the rim that has most of the faces on its outer side, and how much.
    let mut outermost = vec![(0.0, usize::MAX); components.areas.len()];
    for (rim, vertices) in rims.iter().enumerate() {
        let component = components.of_vertices[vertices[0] as usize] as usize;
        let (area, side) = components.areas[component];
        if mesh.frame().is_some() || side.norm() > OPEN * area {
            let towards = enclosed(mesh, vertices).dot(&side);
            if towards < outermost[component].0 {
                outermost[component] = (towards, rim);
            }
        }
    }
    let found = outermost.iter().filter(|(_, rim)| *rim != usize::MAX);
    found.for_each(|&(_, rim)| is_outer[rim] = true);
    is_outer
}

/// `mesh` without the components that a cut has isolated: those all of whose vertices lie next to the cut, as `is_cut` says. Nothing could
/// close them, and the rims around them are no holes.
///
/// # Errors
/// None that a mesh can cause.
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
    // A mesh of isolated components alone stays as it is: nothing would be left of it.
    if isolated.iter().all(|&isolated| isolated) || !isolated.contains(&true) {
        return Ok((mesh, is_cut));
    }
    let kept = is_cut.iter().zip(&isolated).filter(|(_, isolated)| !**isolated);
    Ok((cut(&mesh, &isolated)?.0, kept.map(|(&is_cut, _)| is_cut).collect()))
}

/// The number of the connected component of each vertex; components are numbered in the order of their lowest vertices.
fn connected_components(mesh: &Mesh) -> Vec<u32> {
    let mut sets = UnionFind::new(mesh.positions().len());
    match mesh.faces().as_triangles() {
        Some(faces) => faces.iter().for_each(|&[a, b, c]| {
            sets.join(a, b);
            sets.join(b, c);
        }),
        None => {
            let pairs = mesh.faces().iter().flat_map(|face| face.windows(2));
            pairs.for_each(|pair| sets.join(pair[0], pair[1]));
        }
    }
    sets.numbered().0
}
