//! Orients normals outward.
//!
//! The orientation is propagated from neighbor to neighbor along the edges of a minimum spanning tree: Hoppe, DeRose, Duchamp, McDonald and
//! Stuetzle, "Surface reconstruction from unorganized points" (1992), section 3.3. In that paper, an edge is cheap if both normals are
//! parallel. Here, an edge is cheap if a circle passes through both points and has both normals, so the orientation can pass around bends.
//! The normal of a circle at one point is its normal at the other point, mirrored at the bisecting plane.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use maquette_base::topology::lists::Lists;
use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::*;
use nalgebra::Vector3;

use super::surfels::{Pyramid, Surfel, place};

/// Orients the normals of all surfels (surface elements) outward. Known orientations are propagated. A part without known orientations is
/// oriented such that its outermost normal points outward.
pub(super) fn orient(
    pyramid: &Pyramid,
    surfels: &mut [Surfel],
    progress: &Progress<'_>,
) -> Result<(), CancelledError> {
    if surfels.iter().all(|surfel| surfel.is_sided || surfel.normal == Vector3::zeros()) {
        return Ok(());
    }
    let neighbors = neighbors(pyramid, surfels);
    let mut done: Vec<bool> = surfels.iter().map(|surfel| surfel.is_sided).collect();
    let mut queue = BinaryHeap::new();
    for from in 0..surfels.len() {
        if surfels[from].is_sided {
            push_edges(surfels, &neighbors, &done, from, &mut queue);
        }
    }
    propagate(surfels, &neighbors, &mut done, &mut queue, progress)?;
    for from in 0..surfels.len() {
        if !done[from] && surfels[from].normal != Vector3::zeros() {
            done[from] = true;
            push_edges(surfels, &neighbors, &done, from, &mut queue);
            let mut part = propagate(surfels, &neighbors, &mut done, &mut queue, progress)?;
            part.push(from as u32);
            orient_outward(surfels, &part);
        }
    }
    Ok(())
}

/// A queue of candidate edges: the cost, as bits of a nonnegative float, the start and the end.
type Queue = BinaryHeap<Reverse<(u32, u32, u32)>>;

fn push_edges(
    surfels: &[Surfel],
    neighbors: &Lists,
    done: &[bool],
    from: usize,
    queue: &mut Queue,
) {
    for &to in neighbors.list(from) {
        if !done[to as usize] {
            let (cost, _) = bend(&surfels[from], &surfels[to as usize]);
            queue.push(Reverse(((cost as f32).to_bits(), from as u32, to)));
        }
    }
}

/// Propagates the orientation along the cheapest edges of the queue, and returns the indices of the surfels that are reached.
fn propagate(
    surfels: &mut [Surfel],
    neighbors: &Lists,
    done: &mut [bool],
    queue: &mut Queue,
    progress: &Progress<'_>,
) -> Result<Vec<u32>, CancelledError> {
    let mut reached = Vec::new();
    while let Some(Reverse((_, from, to))) = queue.pop() {
        if done[to as usize] {
            continue;
        }
        let (_, agrees) = bend(&surfels[from as usize], &surfels[to as usize]);
        if !agrees {
            surfels[to as usize].normal.neg_mut();
        }
        done[to as usize] = true;
        reached.push(to);
        if reached.len() % 16384 == 0 {
            progress.check()?;
        }
        push_edges(surfels, neighbors, done, to as usize, queue);
    }
    Ok(reached)
}

/// Returns the cost, from 0 to 2, of propagating the orientation from one surfel to another, and true if the two normals are
/// already consistent.
fn bend(from: &Surfel, to: &Surfel) -> (f64, bool) {
    let way = to.on_plane - from.on_plane;
    // If the two surfels are closer to each other than this distance, the direction from one to the other is random.
    let blur = BLUR * from.reach.max(to.reach);
    let square = (way.norm_squared() + blur * blur).max(f64::MIN_POSITIVE);
    let along = from.normal.dot(&way);
    let expected = from.normal - way * (2.0 * along / square);
    let agreement = expected.dot(&to.normal);
    // If the direction leads across the surface, the surfels belong to different sheets, and the edge is expensive.
    let across = along.abs().max(to.normal.dot(&way).abs());
    ((1.0 - agreement.abs()).max(0.0) + across * across / square, agreement >= 0.0)
}

/// Distance below which the direction between two surfels is not used, as a fraction of the size of their neighborhoods.
const BLUR: f64 = 0.1;

/// Returns the edges between neighboring surfels, in both directions, without duplicates.
fn neighbors(pyramid: &Pyramid, surfels: &[Surfel]) -> Lists {
    let cube = &pyramid.cube;
    let mut neighbors: Vec<Vec<u32>> = surfels
        .par_iter()
        .enumerate()
        .map(|(from, surfel)| -> Vec<u32> {
            if surfel.normal == Vector3::zeros() {
                return Vec::new();
            }
            let layer = &pyramid.layers[surfel.depth as usize];
            let cells = layer.cells.neighbors(place(cube, &surfel.at, surfel.depth));
            let all = cells.map(|cell| layer.finest[cell]);
            all.filter(|&to| to as usize != from && surfels[to as usize].normal != Vector3::zeros())
                .collect()
        })
        .collect();
    let back: Vec<(u32, u32)> = (0..neighbors.len() as u32)
        .flat_map(|from| neighbors[from as usize].iter().map(move |&to| (to, from)))
        .collect();
    for (from, to) in back {
        neighbors[from as usize].push(to);
    }
    neighbors.par_iter_mut().for_each(|near| {
        near.sort_unstable();
        near.dedup();
    });
    Lists::collect(neighbors.iter())
}

/// Flips all normals of a connected part if they point inward where the part extends farthest.
fn orient_outward(surfels: &mut [Surfel], part: &[u32]) {
    let mut vote = 0.0;
    for k in (0..27).filter(|&k| k != 13) {
        let way = Vector3::from([k % 3, k / 3 % 3, k / 9].map(|x| f64::from(x) - 1.0)).normalize();
        fn reach(&surfel: &u32, way: Vector3<f64>, surfels: &[Surfel]) -> f64 {
            surfels[surfel as usize].on_plane.coords.dot(&way)
        }
        let farthest = part.iter().max_by(|a, b| {
            reach(a, way, surfels).total_cmp(&reach(b, way, surfels)).then(b.cmp(a))
        });
        vote += farthest.map_or(0.0, |&surfel| surfels[surfel as usize].normal.dot(&way));
    }
    if vote < 0.0 {
        for &surfel in part {
            surfels[surfel as usize].normal.neg_mut();
        }
    }
}
