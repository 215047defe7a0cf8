//! Orients normals outward.
//!
//! Two normals are compared as in Hoppe, DeRose, Duchamp, McDonald and Stuetzle, "Surface reconstruction from unorganized points" (1992),
//! section 3.3, but an edge between neighbors is cheap if a circle passes through both points and has both normals, so the orientation can
//! pass around bends. The normal of a circle at one point is its normal at the other point, mirrored at the bisecting plane.
//!
//! Cheap edges, the cheapest first, join the surfels (surface elements) to patches. Where two patches are near each other, all pairs of
//! nearest surfels vote on their relative orientation, so that a single wrong edge does not turn over a sheet: Schertler, Savchynskyy and
//! Gumhold, "Towards globally optimal normal orientations for large point clouds" (2017), section 4.

use std::collections::BTreeMap;

use maquette_base::topology::lists::Lists;
use maquette_base::tree::Tree;
use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::surfels::{Pyramid, Surfel, place};

/// Maximum cost of an edge inside of a patch, and its maximum length in sizes of the cells of a surfel's neighborhood. Parallel sheets are
/// joined only by edges that are 5 times as long as the distance of the sheets.
const CHEAP: f64 = 0.1;
const LONGEST: f64 = 1.5;

/// Maximum length of an edge inside of a patch, in distances of opposite sides: from 3.2 on, edges from one side to the other are cheap.
/// Noise makes some of them shorter, so that their length across the surface is limited, too.
const LONGEST_BESIDE: f64 = 3.0;
const LONGEST_ACROSS: f64 = 0.5;

/// Orients the normals of all surfels outward. Surfels with a known orientation keep it, and decide about their patch. Patches that are not
/// connected to a known orientation are oriented such that the outermost normals point outward. `gap` is the distance in mm of the opposite
/// sides of thin parts, or infinite.
pub(super) fn orient(
    pyramid: &Pyramid,
    surfels: &mut [Surfel],
    gap: f64,
    progress: &Progress<'_>,
) -> Result<(), CancelledError> {
    if surfels.iter().all(|surfel| surfel.is_sided || surfel.normal == Vector3::zeros()) {
        return Ok(());
    }
    let mut signs = Signs::new(surfels.len());
    let neighbors = neighbors(pyramid, surfels, gap);
    join_cheap_edges(surfels, &neighbors, gap, &mut signs, progress)?;
    progress.tick(0.4)?;
    let votes = votes(surfels, &mut signs);
    progress.tick(0.8)?;
    join_patches(votes, &mut signs, progress)?;
    let mut parts: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (number, surfel) in (0u32..).zip(surfels.iter_mut()) {
        if surfel.normal == Vector3::zeros() {
            continue;
        }
        let (part, is_flipped) = signs.find(number);
        parts.entry(part).or_default().push(number);
        if is_flipped && !surfel.is_sided {
            surfel.normal.neg_mut();
        }
    }
    let (known, _) = signs.find(surfels.len() as u32);
    for part in parts.iter().filter(|part| *part.0 != known).map(|part| part.1) {
        orient_outward(surfels, part);
    }
    Ok(())
}

/// Returns the fraction of neighbors whose normals are opposite to each other although a smooth surface passes through both.
pub(super) fn opposed_fraction(pyramid: &Pyramid, surfels: &[Surfel]) -> f64 {
    let step = surfels.len().div_ceil(SAMPLES).max(1);
    let (mut all, mut opposed) = (0, 0);
    for surfel in surfels.iter().step_by(step).filter(|surfel| surfel.is_sided) {
        let cells = &pyramid.finest().cells;
        for other in cells.neighbors(place(&pyramid.cube, &surfel.at, pyramid.cube.depth)) {
            let other = &surfels[other];
            if !other.is_sided || surfel.at == other.at {
                continue;
            }
            let (cost, agrees) = bend(surfel, other);
            if cost < CHEAP {
                all += 1;
                opposed += usize::from(!agrees);
            }
        }
    }
    opposed as f64 / f64::from(all.max(1) as u32)
}

/// Number of surfels whose given normals are compared with those of their neighbors.
const SAMPLES: usize = 4096;

/// A union-find structure of surfels that stores, for each surfel, whether its normal must be flipped to agree with the root of its set.
/// One more element stands for the known orientations.
struct Signs {
    parents: Vec<(u32, bool)>,
}

impl Signs {
    fn new(count: usize) -> Self {
        Self { parents: (0..=count as u32).map(|surfel| (surfel, false)).collect() }
    }

    /// Returns the root of the set that contains a surfel, and true if the surfel must be flipped to agree with the root.
    fn find(&mut self, surfel: u32) -> (u32, bool) {
        let (mut root, mut is_flipped) = (surfel, false);
        while self.parents[root as usize].0 != root {
            let (parent, flips) = self.parents[root as usize];
            (root, is_flipped) = (parent, is_flipped != flips);
        }
        let (mut at, mut flips) = (surfel, is_flipped);
        while at != root {
            let (parent, own) = self.parents[at as usize];
            self.parents[at as usize] = (root, flips);
            (at, flips) = (parent, flips != own);
        }
        (root, is_flipped)
    }

    /// Joins the sets of two surfels, whose normals agree or are opposite to each other. Has no effect if they are in one set already.
    fn union(&mut self, a: u32, b: u32, agrees: bool) {
        let ((a, a_flips), (b, b_flips)) = (self.find(a), self.find(b));
        // The smaller number becomes the root, so that the result does not depend on the order of the arguments.
        let flips = (a_flips != b_flips) == agrees;
        self.parents[a.max(b) as usize] = (a.min(b), flips && a != b);
    }
}

/// Joins surfels along cheap edges, the cheapest first.
fn join_cheap_edges(
    surfels: &[Surfel],
    neighbors: &Lists,
    gap: f64,
    signs: &mut Signs,
    progress: &Progress<'_>,
) -> Result<(), CancelledError> {
    let places = 0..surfels.len();
    let mut edges: Vec<(u32, u32, u32, bool)> = places
        .into_par_iter()
        .flat_map_iter(|from: usize| {
            let after = neighbors.list(from).iter().filter(move |&&to| from < to as usize);
            after.filter_map(move |&to| {
                let [from_surfel, to_surfel] = [&surfels[from], &surfels[to as usize]];
                let longest =
                    (LONGEST * from_surfel.reach.max(to_surfel.reach)).min(LONGEST_BESIDE * gap);
                let (cost, agrees) = bend(from_surfel, to_surfel);
                let way = to_surfel.on_plane - from_surfel.on_plane;
                let across = from_surfel.normal.dot(&way).abs();
                let is_cheap =
                    cost < CHEAP && way.norm() < longest && across < LONGEST_ACROSS * gap;
                is_cheap.then_some(((cost as f32).to_bits(), from as u32, to, agrees))
            })
        })
        .collect();
    progress.check()?;
    edges.par_sort_unstable();
    for (_, from, to, agrees) in edges {
        signs.union(from, to, agrees);
    }
    Ok(())
}

/// A vote of two surfels of different patches: above 0 if their normals agree, below 0 if they are opposite to each other.
struct Vote {
    surfels: [u32; 2],
    weight: f64,
}

/// Returns the votes of the pairs of nearest surfels of different patches, and those of the surfels with a known orientation.
fn votes(surfels: &[Surfel], signs: &mut Signs) -> Vec<Vote> {
    let world = surfels.len() as u32;
    let sided = (0..world).filter(|&surfel| surfels[surfel as usize].is_sided);
    let mut votes: Vec<Vote> = sided
        .filter(|&surfel| surfels[surfel as usize].normal != Vector3::zeros())
        .map(|surfel| Vote { surfels: [surfel, world], weight: KNOWN })
        .collect();
    let patches: Vec<u32> = (0..world).map(|surfel| signs.find(surfel).0).collect();
    let used: Vec<u32> =
        (0..world).filter(|&it| surfels[it as usize].normal != Vector3::zeros()).collect();
    if used.iter().all(|&it| patches[it as usize] == patches[used[0] as usize]) {
        return votes;
    }
    let points: Vec<Point3<f64>> = used.iter().map(|&it| surfels[it as usize].at).collect();
    let tree = Tree::new(&points);
    votes.extend(
        used.par_iter()
            .flat_map_iter(|&from| {
                let own = &surfels[from as usize];
                // The nearest surfel of each patch nearby.
                let mut nearest: BTreeMap<u32, (f64, u32)> = BTreeMap::new();
                for place in tree.points_within(&own.at, AROUND * own.reach) {
                    let to = used[place as usize];
                    let square = (surfels[to as usize].at - own.at).norm_squared();
                    let best = nearest.entry(patches[to as usize]).or_insert((square, to));
                    if square < best.0 {
                        *best = (square, to);
                    }
                }
                nearest.remove(&patches[from as usize]);
                nearest.into_values().map(move |(_, to)| {
                    let agreement = agreement(own, &surfels[to as usize]);
                    Vote { surfels: [from, to], weight: agreement * agreement.abs() }
                })
            })
            .collect::<Vec<Vote>>(),
    );
    votes
}

/// The radius in which other patches are looked for, in sizes of the cells of a surfel's neighborhood.
const AROUND: f64 = 3.0;

/// Weight of the vote of a surfel with a known orientation.
const KNOWN: f64 = 10.0;

/// Joins patches in rounds: each patch is joined to the patch to which the sum of votes is clearest (Boruvka's algorithm).
fn join_patches(
    votes: Vec<Vote>,
    signs: &mut Signs,
    progress: &Progress<'_>,
) -> Result<(), CancelledError> {
    loop {
        progress.check()?;
        let mut sums: BTreeMap<[u32; 2], f64> = BTreeMap::new();
        for vote in &votes {
            let [(a, a_flips), (b, b_flips)] = vote.surfels.map(|surfel| signs.find(surfel));
            if a != b {
                let weight = if a_flips == b_flips { vote.weight } else { -vote.weight };
                *sums.entry([a.min(b), a.max(b)]).or_default() += weight;
            }
        }
        let mut clearest: BTreeMap<u32, ([u32; 2], f64)> = BTreeMap::new();
        for (&pair, &sum) in &sums {
            for patch in pair {
                let best = clearest.entry(patch).or_insert((pair, sum));
                if best.1.abs() < sum.abs() {
                    *best = (pair, sum);
                }
            }
        }
        if clearest.is_empty() {
            return Ok(());
        }
        for ([a, b], sum) in clearest.into_values() {
            signs.union(a, b, sum >= 0.0);
        }
    }
}

/// Returns the cost, from 0 to 2, of propagating the orientation from one surfel to another, and true if the two normals are
/// already consistent.
fn bend(from: &Surfel, to: &Surfel) -> (f64, bool) {
    let (way, square) = way(from, to);
    let agreement = agreement(from, to);
    // If the direction leads across the surface, the surfels belong to different sheets, and the edge is expensive.
    let across = from.normal.dot(&way).abs().max(to.normal.dot(&way).abs());
    ((1.0 - agreement.abs()).max(0.0) + across * across / square, agreement >= 0.0)
}

/// Returns the cosine of the angle between the normal of one surfel and the normal that a circle through both surfels has there.
fn agreement(from: &Surfel, to: &Surfel) -> f64 {
    let (way, square) = way(from, to);
    let expected = from.normal - way * (2.0 * from.normal.dot(&way) / square);
    expected.dot(&to.normal)
}

/// Returns the vector from one surfel to another, and the square of its length.
fn way(from: &Surfel, to: &Surfel) -> (Vector3<f64>, f64) {
    let way = to.on_plane - from.on_plane;
    // If the two surfels are closer to each other than this distance, the direction from one to the other is random.
    let blur = BLUR * from.reach.max(to.reach);
    (way, (way.norm_squared() + blur * blur).max(f64::MIN_POSITIVE))
}

/// Distance below which the direction between two surfels is not used, as a fraction of the size of their neighborhoods.
const BLUR: f64 = 0.1;

/// Returns the edges between neighboring surfels, in both directions, without duplicates. `gap` is the distance of opposite sides in mm.
fn neighbors(pyramid: &Pyramid, surfels: &[Surfel], gap: f64) -> Lists {
    let cube = &pyramid.cube;
    let finest = cube.depth;
    // In larger cells, most edges would be too long.
    let least = (0..finest).find(|&depth| cube.edge_at(depth) <= 2.0 * gap).unwrap_or(finest);
    let mut neighbors: Vec<Vec<u32>> = surfels
        .par_iter()
        .enumerate()
        .map(|(from, surfel)| -> Vec<u32> {
            if surfel.normal == Vector3::zeros() {
                return Vec::new();
            }
            let depth = surfel.depth.max(least);
            let layer = &pyramid.layers[depth as usize];
            let cells = layer.cells.neighbors(place(cube, &surfel.at, depth));
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
