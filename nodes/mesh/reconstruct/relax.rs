//! Relaxes the reconstructed mesh along the surface, and removes components that the points do not support.

use maquette_base::topology::lists::Lists;
use maquette_base::topology::union_find::UnionFind;
use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::contour::Skin;
use super::pieces::Pieces;
use super::poisson::{Field, SURFACE};
use super::surfels::place;

/// Number of rounds that move each vertex towards the centroid of its neighbors. After 4 rounds, the mesh's edges still show the grid; more
/// than 12 rounds improve nothing.
const ROUNDS: usize = 8;

/// Moves each vertex along the surface to the centroid of its neighbors, and back onto the surface.
pub(super) fn relax(
    skin: &mut Skin,
    field: &Field,
    depth: u32,
    progress: &Progress<'_>,
) -> Result<(), CancelledError> {
    let neighbors = Neighbors::new(skin);
    for round in 0..ROUNDS {
        let positions = &skin.positions;
        skin.positions = (0..positions.len())
            .into_par_iter()
            .map(|vertex: usize| {
                let near = neighbors.neighbors(vertex);
                if near.is_empty() {
                    return positions[vertex];
                }
                let sum: Vector3<f64> = near.iter().map(|&v| positions[v as usize].coords).sum();
                project(field, depth, &Point3::from(sum / near.len() as f64), &positions[vertex])
            })
            .collect();
        progress.tick((round + 1) as f64 / ROUNDS as f64)?;
    }
    Ok(())
}

/// Returns the point on the surface near `goal`, found by Newton steps along the gradient, each at most half a cell long, on the grids from
/// `depth` to the finest one. If the steps do not converge, returns `before`.
fn project(field: &Field, depth: u32, goal: &Point3<f64>, before: &Point3<f64>) -> Point3<f64> {
    let mut at = *goal;
    for depth in depth..=field.cube.depth {
        let half = 0.5 * field.cube.edge_at(depth);
        for _ in 0..3 {
            let (value, gradient) = field.at_point(&at, depth);
            let square = gradient.norm_squared();
            if square * half * half < 1e-8 {
                return *before;
            }
            let step = gradient * ((SURFACE - value) / square);
            let length = step.norm();
            at += step * (half / length.max(half));
            if length < 1e-3 * half {
                break;
            }
        }
    }
    if (at - goal).norm() > field.cube.edge_at(depth) { *before } else { at }
}

/// The vertices that share an edge with each vertex.
pub(super) struct Neighbors(Lists);

impl Neighbors {
    pub(super) fn new(skin: &Skin) -> Self {
        let mut edges: Vec<(u32, u32)> = skin
            .quads
            .par_iter()
            .flat_map_iter(|quad| {
                let quad = *quad;
                (0..4).flat_map(move |k| {
                    let (a, b) = (quad[k], quad[(k + 1) % 4]);
                    [(a, b), (b, a)]
                })
            })
            .collect();
        edges.par_sort_unstable();
        edges.dedup();
        Self(Lists::group_all(skin.positions.len(), edges.len(), |edge| {
            std::iter::once(edges[edge])
        }))
    }

    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    pub(super) fn neighbors(&self, vertex: usize) -> &[u32] {
        self.0.list(vertex)
    }
}

/// Maximum distance of a vertex from the plane of the points around it, in multiples of the points' spacing. A vertex farther away is on a
/// fold of the surface.
const OFF_PLANE: f64 = 0.5;

/// Returns, for each vertex, true if points support it: the nearest surfel is at most `reach` times the local spacing of points away, and
/// the vertex is near the surfel's plane.
pub(super) fn find_supported(skin: &Skin, pieces: &Pieces, reach: f64) -> Vec<bool> {
    let Pieces { pyramid, surfels, noise, skin_depth, .. } = pieces;
    let skin_edge = pyramid.cube.edge_at(*skin_depth);
    skin.positions
        .par_iter()
        .map(|at: &Point3<f64>| {
            let mut depth = pyramid.cube.depth;
            loop {
                let layer = &pyramid.layers[depth as usize];
                let edge = pyramid.cube.edge_at(depth);
                let near = layer.cells.neighbors(place(&pyramid.cube, at, depth));
                // For each surfel nearby, the amount by which its distance from the vertex exceeds the allowed distance.
                let excess = near.map(|cell| {
                    let surfel = &surfels[layer.finest[cell] as usize];
                    if surfel.normal == Vector3::zeros() {
                        return f64::INFINITY;
                    }
                    let spacing = surfel.spacing.max(skin_edge);
                    let away = at - surfel.on_plane;
                    let off = away.dot(&surfel.normal).abs() - OFF_PLANE * spacing;
                    (away.norm() - reach * spacing).max(off) - 3.0 * noise
                });
                let least = excess.fold(f64::INFINITY, f64::min);
                if least <= 0.0 {
                    return true;
                }
                // Cells farther away may contain sparser points, whose allowed distance is larger.
                let is_far = depth <= *skin_depth && least < f64::INFINITY && least > edge;
                if is_far || depth == 0 {
                    return false;
                }
                depth -= 1;
            }
        })
        .collect()
}

/// Removes connected components with hardly any supported vertex. Such components occur far from all points, where the values of the
/// function are accidental.
pub(super) fn drop_chance(skin: &mut Skin, supported: &mut Vec<bool>) {
    let parts = parts(skin);
    let n_parts = parts.iter().max().map_or(0, |&last| last as usize + 1);
    let mut counts = vec![[0_usize; 2]; n_parts];
    for (vertex, &part) in parts.iter().enumerate() {
        counts[part as usize][usize::from(supported[vertex])] += 1;
    }
    fn is_kept(part: u32, counts: &[[usize; 2]]) -> bool {
        let [without, with] = counts[part as usize];
        SUPPORTED * (without + with) as f64 <= with as f64
    }
    let keep: Vec<bool> = parts.iter().map(|&part| is_kept(part, &counts)).collect();
    skin.quads.retain(|quad| keep[quad[0] as usize]);
    compact(skin, supported);
}

/// Minimum fraction of a component's vertices that must be supported by points; other components are removed.
const SUPPORTED: f64 = 0.05;

/// Returns the component of each vertex; components are numbered by their first vertices.
pub(super) fn parts(skin: &Skin) -> Vec<u32> {
    let mut parts = UnionFind::new(skin.positions.len());
    for quad in &skin.quads {
        quad[1..].iter().for_each(|&vertex| parts.union(quad[0], vertex));
    }
    parts.into_labels().0
}

/// Removes the vertices that no quad uses.
fn compact(skin: &mut Skin, flags: &mut Vec<bool>) {
    let mut is_used = vec![false; skin.positions.len()];
    skin.quads.iter().flatten().for_each(|&vertex| is_used[vertex as usize] = true);
    let mut numbers = vec![0; skin.positions.len()];
    let (mut positions, mut kept) = (Vec::new(), Vec::new());
    for vertex in (0..skin.positions.len()).filter(|&vertex| is_used[vertex]) {
        numbers[vertex] = positions.len() as u32;
        positions.push(skin.positions[vertex]);
        kept.push(flags[vertex]);
    }
    skin.quads.iter_mut().flatten().for_each(|vertex| *vertex = numbers[*vertex as usize]);
    (skin.positions, *flags) = (positions, kept);
}

/// Removes quads without points nearby, and parts that touch the rest in single vertices; then smooths the borders, which otherwise show
/// the steps of the grid.
pub(super) fn remove_unsupported(skin: &mut Skin, supported: &mut Vec<bool>) {
    skin.quads.retain(|quad| quad.iter().all(|&vertex| supported[vertex as usize]));
    loop {
        // An interior vertex has as many faces as neighbors. A vertex on a border has one face less, and still fewer where several borders
        // meet.
        let neighbors = Neighbors::new(skin);
        let mut faces = vec![0; skin.positions.len()];
        skin.quads.iter().flatten().for_each(|&vertex| faces[vertex as usize] += 1);
        fn is_pinched(vertex: u32, neighbors: &Neighbors, faces: &[usize]) -> bool {
            let near = neighbors.neighbors(vertex as usize).len();
            near > faces[vertex as usize] + 1
        }
        // A quad with two corners that belong to no other quad sticks out as a tooth.
        fn is_tooth(quad: &[u32; 4], faces: &[usize]) -> bool {
            quad.iter().filter(|&&vertex| faces[vertex as usize] == 1).count() > 1
        }
        let before = skin.quads.len();
        skin.quads.retain(|quad| {
            !is_tooth(quad, &faces)
                && !quad.iter().any(|&vertex| is_pinched(vertex, &neighbors, &faces))
        });
        if skin.quads.len() == before {
            break;
        }
    }
    compact(skin, supported);
    smooth_borders(skin);
}

/// Moves each border vertex halfway to the midpoint of its two neighbors on the border, `BORDER_ROUNDS` times.
fn smooth_borders(skin: &mut Skin) {
    let mut sides: Vec<(u32, u32)> = skin
        .quads
        .iter()
        .flat_map(|quad| {
            let quad = *quad;
            (0..4).map(move |k| (quad[k], quad[(k + 1) % 4]))
        })
        .collect();
    sides.sort_unstable();
    let mut beside = vec![[u32::MAX; 2]; skin.positions.len()];
    for (a, b) in sides.iter().copied().filter(|&(a, b)| sides.binary_search(&(b, a)).is_err()) {
        beside[a as usize][1] = b;
        beside[b as usize][0] = a;
    }
    for _ in 0..BORDER_ROUNDS {
        let positions = &skin.positions;
        skin.positions = beside
            .iter()
            .enumerate()
            .map(|(vertex, &[a, b])| {
                if a == u32::MAX || b == u32::MAX {
                    return positions[vertex];
                }
                let middle = nalgebra::center(&positions[a as usize], &positions[b as usize]);
                nalgebra::center(&positions[vertex], &middle)
            })
            .collect();
    }
}

/// Number of rounds of smoothing borders. The steps of the grid vanish after about four rounds, small bays in the border after more.
const BORDER_ROUNDS: usize = 6;
