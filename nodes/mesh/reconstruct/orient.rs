//! Turns normals to the outside.
//!
//! Sides are carried along the edges of a minimum spanning tree from neighbor to neighbor: Hoppe, DeRose, Duchamp, McDonald and
//! Stuetzle, "Surface reconstruction from unorganized points" (1992), section 3.3. An edge costs little if the normal that a circle
//! through both places would have is near to the normal that is there, rather than if both are parallel, so that a side finds its
//! way around bends; a circle's normal at one place is that at the other, mirrored at the plane half-way.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use maquette_base::topology::lists::Lists;
use maquette_node::{Cancelled, Progress};
use maquette_value::parallel::*;
use nalgebra::Vector3;

use super::surfels::{Pyramid, Surfel, place};

/// Turns the normals of all surfels outwards: from those whose side is known; of other parts, so that they are outside where the
/// part reaches farthest.
pub(super) fn orient(
    pyramid: &Pyramid,
    surfels: &mut [Surfel],
    progress: &Progress<'_>,
) -> Result<(), Cancelled> {
    if surfels.iter().all(|surfel| surfel.is_sided || surfel.normal == Vector3::zeros()) {
        return Ok(());
    }
    let neighbors = neighbors(pyramid, surfels);
    let mut done: Vec<bool> = surfels.iter().map(|surfel| surfel.is_sided).collect();
    let mut queue = BinaryHeap::new();
    for from in 0..surfels.len() {
        if surfels[from].is_sided {
            push(surfels, &neighbors, &done, from, &mut queue);
        }
    }
    grow(surfels, &neighbors, &mut done, &mut queue, progress)?;
    for from in 0..surfels.len() {
        if !done[from] && surfels[from].normal != Vector3::zeros() {
            done[from] = true;
            push(surfels, &neighbors, &done, from, &mut queue);
            let mut part = grow(surfels, &neighbors, &mut done, &mut queue, progress)?;
            part.push(from as u32);
            face_out(surfels, &part);
        }
    }
    Ok(())
}

/// Costs, as bits of floats that are not negative, from where, and to where.
type Queue = BinaryHeap<Reverse<(u32, u32, u32)>>;

fn push(surfels: &[Surfel], neighbors: &Lists, done: &[bool], from: usize, queue: &mut Queue) {
    for &to in neighbors.of(from) {
        if !done[to as usize] {
            let (cost, _) = bend(&surfels[from], &surfels[to as usize]);
            queue.push(Reverse(((cost as f32).to_bits(), from as u32, to)));
        }
    }
}

/// Takes over what the cheapest edges reach, and gives it.
fn grow(
    surfels: &mut [Surfel],
    neighbors: &Lists,
    done: &mut [bool],
    queue: &mut Queue,
    progress: &Progress<'_>,
) -> Result<Vec<u32>, Cancelled> {
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
        push(surfels, neighbors, done, to as usize, queue);
    }
    Ok(reached)
}

/// What carrying a side from one surfel to another costs, 0 to 2, and whether both normals are on the same side now.
fn bend(from: &Surfel, to: &Surfel) -> (f64, bool) {
    let way = to.on_plane - from.on_plane;
    // Within a part of the neighborhoods that both normals were seen in, the way is chance.
    let blur = BLUR * from.reach.max(to.reach);
    let square = (way.norm_squared() + blur * blur).max(f64::MIN_POSITIVE);
    let along = from.normal.dot(&way);
    let expected = from.normal - way * (2.0 * along / square);
    let agreement = expected.dot(&to.normal);
    // A way across the surface leads to another sheet.
    let across = along.abs().max(to.normal.dot(&way).abs());
    ((1.0 - agreement.abs()).max(0.0) + across * across / square, agreement >= 0.0)
}

/// The part of a neighborhood's size below which ways are not trusted.
const BLUR: f64 = 0.1;

/// Both ways, without doubles.
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
            let cells = layer.cells.near(place(cube, &surfel.at, surfel.depth));
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

/// Turns a part round if its normals point inwards where it reaches farthest.
fn face_out(surfels: &mut [Surfel], part: &[u32]) {
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
