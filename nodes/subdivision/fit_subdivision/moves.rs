//! Moves of a control mesh's edges that lower an energy: nearness, and what vertices and creases cost.

use std::collections::VecDeque;

use maquette_node::Progress;
use maquette_value::Mesh;
use maquette_value::parallel::*;
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::concave_corners::cut_concave_corners;
use super::feet::Nearest;
use super::fit::{Fit, FittedSubdivision};
use super::fit_subdivision_error::FitSubdivisionError;
use super::local::Local;
use super::net::{Change, Move, Net, SHARP};
use super::scan::Scan;
use super::surroundings::Surroundings;
use crate::sharp_edges::crease;

/// What vertices and creases must be worth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Prices {
    /// By how much a control point must lower the sum of the squared distances between points and surface, over the squared diagonal of
    /// the mesh's box. More leaves fewer vertices.
    #[schemars(range(min = 1e-9, max = 1.0))]
    #[serde(default = "hundred_thousandth")]
    pub vertex: f64,
    /// The same for a sharp edge. More leaves fewer creases.
    #[schemars(range(min = 1e-9, max = 1.0))]
    #[serde(default = "fifth_of_it")]
    pub crease: f64,
    /// Edges at which the mesh bends by more than this begin sharp.
    #[schemars(range(min = 0.0, max = 180.0), extend("unit" = "deg"))]
    #[serde(default = "thirty")]
    pub angle: f64,
    /// How often all edges near changes are tried, at most.
    #[schemars(range(min = 1, max = 100))]
    #[serde(default = "four")]
    pub passes: u32,
}

fn hundred_thousandth() -> f64 {
    1e-5
}

fn fifth_of_it() -> f64 {
    2e-6
}

fn thirty() -> f64 {
    30.0
}

fn four() -> u32 {
    4
}

impl Default for Prices {
    fn default() -> Self {
        Self {
            vertex: hundred_thousandth(),
            crease: fifth_of_it(),
            angle: thirty(),
            passes: four(),
        }
    }
}

/// As [`fit_subdivision`](super::fit::fit_subdivision), with better faces: between iterations, moves of edges that lower an energy.
///
/// The third phase of Hoppe, DeRose, Duchamp, Halstead, Jin, McDonald, Schweitzer and Stuetzle, "Piecewise smooth surface reconstruction"
/// (1994), section 4: an edge is collapsed, split, swapped, made sharp or made smooth where that lowers the sum of the squared
/// distances, of a price for each vertex and of one for each sharp edge, with the control points around it in new places.
/// Distances are those of the scan's vertices from the surface, and those of the surface from the scan's faces: without the second ones
/// it would stick out where it ends in no points, along sharp edges above all. `points` of the publication are unorganized and have none.
/// At the end what would fold at corners is cut, which is so small that no energy sees it.
///
/// # Errors
/// Those of [`fit_subdivision`](super::fit::fit_subdivision), and if the scan has no faces.
pub fn fit_by_moves(
    mesh: &Mesh,
    scan: &Mesh,
    smoothing: f64,
    iterations: u32,
    prices: Prices,
    progress: &Progress<'_>,
) -> Result<FittedSubdivision, FitSubdivisionError> {
    let scan = Scan::new(scan).ok_or(FitSubdivisionError::NoSurface)?;
    let (points, steps) = (scan.points(), Vec::new());
    let mut fit = Fit { points, scan: Some(&scan), smoothing, iterations, steps };
    let start = crease(mesh, prices.angle, SHARP);
    let (mut mesh, mut nearest) = fit.settled(&start, progress)?;
    let mut moving = Moving::new(&mesh, &scan, prices, smoothing);
    for pass in 0..prices.passes {
        fn share(share: f64, pass: u32, prices_passes: u32) -> f64 {
            (f64::from(pass) + share) / f64::from(prices_passes)
        }
        let (moved, made) =
            moving.pass(&mesh, &nearest, |done| progress.tick(share(done, pass, prices.passes)))?;
        (mesh, nearest) = fit.settled(&moved, progress)?;
        if made == 0 {
            break;
        }
    }
    let (cut, has_cut) = cut_concave_corners(&mesh)?;
    if has_cut {
        (mesh, nearest) = fit.settled(&cut, progress)?;
    }
    Ok(fit.end(mesh, &nearest))
}

/// Edges that are judged side by side.
const BATCH: usize = 32;

/// A move must gain this share of a price, so that the search ends.
const LEAST_GAIN: f64 = 0.1;

/// A control mesh that is improved.
struct Moving<'a> {
    net: Net,
    scan: &'a Scan<'a>,
    /// The points of each face.
    held: Vec<Vec<u32>>,
    /// The faces whose edges are tried next.
    fresh: Vec<u32>,
    /// The prices of a vertex and of a sharp edge, in mm^2.
    prices: [f64; 2],
    smoothing: f64,
    /// The weight of smoothness beside the nearness of a point.
    weight: f64,
}

/// A move that pays.
struct Outcome {
    gain: f64,
    change: Change,
    measured: Vec<u32>,
    places: Vec<(u32, Point3<f64>)>,
    /// The points on the surface that moved, each with the place of its face among those that stayed and were added.
    nearest: Vec<(u32, u32)>,
}

impl<'a> Moving<'a> {
    fn new(mesh: &Mesh, scan: &'a Scan<'a>, prices: Prices, smoothing: f64) -> Self {
        let net = Net::new(mesh);
        let diagonal_sq = mesh.bounds().map_or(0.0, |(low, high)| (high - low).norm_squared());
        let prices = [prices.vertex, prices.crease].map(|price| price * diagonal_sq);
        let fresh = (0..net.faces.len() as u32).collect();
        Self { net, scan, held: Vec::new(), fresh, prices, smoothing, weight: 0.0 }
    }

    /// Tries all moves at the edges near the last changes, in an order without a direction, and makes those that pay; `fitted` says where
    /// the control points of the last mesh are now, `nearest` what is nearest to each point. Returns the new mesh, without
    /// attributes, and how many moves were made.
    fn pass(
        &mut self,
        fitted: &Mesh,
        nearest: &[Option<Nearest>],
        tick: impl Fn(f64) -> Result<(), maquette_node::Cancelled>,
    ) -> Result<(Mesh, usize), FitSubdivisionError> {
        let (_, vertices, faces) = self.net.mesh()?;
        for (&vertex, place) in vertices.iter().zip(fitted.positions().iter()) {
            self.net.places[vertex as usize] = *place;
        }
        self.weight = self.smoothing * nearest.len() as f64 / vertices.len() as f64;
        self.held = vec![Vec::new(); self.net.faces.len()];
        for (point, nearest) in (0..).zip(nearest) {
            if let Some(nearest) = nearest {
                self.held[faces[nearest.face as usize] as usize].push(point);
            }
        }
        let mut edges = self.net.edges(std::mem::take(&mut self.fresh).into_iter());
        // Multiples of the golden ratio leave no two neighbors together.
        edges.sort_by_key(|&[a, b]| {
            (u64::from(a) << 32 | u64::from(b)).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        });
        let count = edges.len();
        let mut waiting = VecDeque::from(edges);
        let mut made = 0;
        while !waiting.is_empty() {
            tick(1.0 - waiting.len() as f64 / count as f64)?;
            let batch = self.apart(&mut waiting);
            let outcomes: Vec<Option<Outcome>> =
                batch.par_iter().map(|(edge, around)| self.best(*edge, around)).collect();
            let new = self.net.places.len() as u32;
            for outcome in outcomes.into_iter().flatten() {
                self.make(outcome, new);
                made += 1;
            }
        }
        Ok((self.net.mesh()?.0.with_frame(fitted.frame().copied()), made))
    }

    /// Takes the next edges whose moves do not see each other.
    /// They are judged side by side, so that the order is independent of the number of threads.
    fn apart(&self, waiting: &mut VecDeque<[u32; 2]>) -> Vec<([u32; 2], Surroundings)> {
        let [mut read, mut written] = [(); 2].map(|()| vec![false; self.net.faces.len()]);
        let mut batch = Vec::new();
        for _ in 0..waiting.len().min(4 * BATCH) {
            let Some(edge) = waiting.pop_front().filter(|_| batch.len() < BATCH) else { break };
            // Gone with a move before.
            let Some(around) = self.surroundings(edge) else { continue };
            let all = || around.measured.iter().chain(&around.margin);
            let meets = around.measured.iter().any(|&face| read[face as usize])
                || all().any(|&face| written[face as usize]);
            if meets {
                waiting.push_back(edge);
                continue;
            }
            all().for_each(|&face| read[face as usize] = true);
            around.measured.iter().for_each(|&face| written[face as usize] = true);
            batch.push((edge, around));
        }
        batch
    }

    fn surroundings(&self, edge: [u32; 2]) -> Option<Surroundings> {
        let net = &self.net;
        let free = net.corners(&net.sides(edge));
        if free.is_empty() {
            return None;
        }
        let measured = net.star(&net.corners(&net.star(&free)));
        let mut margin = net.star(&net.corners(&measured));
        margin.retain(|face| measured.binary_search(face).is_err());
        Some(Surroundings { free, measured, margin })
    }

    /// The move at an edge that gains most, if one pays.
    fn best(&self, edge: [u32; 2], around: &Surroundings) -> Option<Outcome> {
        let held = || around.measured.iter().flat_map(|&face| &self.held[face as usize]);
        let points: Vec<Point3<f64>> =
            held().map(|&point| self.scan.points()[point as usize]).collect();
        let before =
            Local::new(&self.net, &Change::default(), around)?.measure(&points, self.scan)?;
        let judged = |kind: Move| {
            let change = self.net.change(kind, edge)?;
            let price = change.more[0] * self.prices[0] + change.more[1] * self.prices[1];
            let least = price + LEAST_GAIN * self.prices[usize::from(kind == Move::Tag)];
            if before.cost <= least {
                return None;
            }
            let mut local = Local::new(&self.net, &change, around)?;
            let after = local.fit(&points, self.scan, self.weight)?;
            if before.cost - after.cost <= least || before.folds < after.folds {
                return None;
            }
            let nearest = held().zip(after.nearest).map(|(&point, nearest)| (point, nearest.face));
            let (gain, nearest) = (before.cost - after.cost - price, nearest.collect());
            let (measured, places) = (around.measured.clone(), local.places());
            Some(Outcome { gain, change, measured, places, nearest })
        };
        Move::ALL.into_iter().filter_map(judged).max_by(|a, b| a.gain.total_cmp(&b.gain))
    }

    fn make(&mut self, outcome: Outcome, new: u32) {
        let Outcome { change, measured, places, nearest, .. } = outcome;
        let number = self.net.places.len() as u32;
        let added = self.net.apply(&change, new);
        self.held.resize(self.net.faces.len(), Vec::new());
        for (vertex, place) in places {
            let vertex = if vertex == new { number } else { vertex };
            self.net.places[vertex as usize] = place;
            self.fresh.extend(self.net.star(&[vertex]));
        }
        measured.iter().for_each(|&face| self.held[face as usize].clear());
        let stay = measured.into_iter().filter(|face| !change.removed.contains(face));
        let faces: Vec<u32> = stay.chain(added).collect();
        for (point, face) in nearest {
            self.held[faces[face as usize] as usize].push(point);
        }
    }
}
