//! Edge operations (moves) on a control mesh that lower an energy: squared distances plus prices for vertices and creases.

use std::collections::VecDeque;

use maquette_node::{Error, Progress};
use maquette_value::Mesh;
use maquette_value::parallel::*;
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::concave_corners::cut_concave_corners;
use super::feet::Nearest;
use super::fit::{Fit, FittedSubdivision};
use super::local::{Local, Measure};
use super::net::{Change, Move, Net, SHARP};
use super::scan::Scan;
use super::surroundings::Surroundings;
use crate::sharp_edges::crease;

/// Prices of vertices and creases in the energy.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Prices {
    /// Price of a control point: the minimum reduction of the sum of squared distances between points and surface, relative to the squared
    /// diagonal of the mesh's bounding box. A higher price gives fewer vertices.
    #[schemars(range(min = 1e-9, max = 1.0))]
    #[serde(default = "default_vertex_price")]
    pub vertex: f64,
    /// Price of a sharp edge, in the same unit. A higher price gives fewer creases.
    #[schemars(range(min = 1e-9, max = 1.0))]
    #[serde(default = "default_crease_price")]
    pub crease: f64,
    /// Minimum angle between the faces' normals of edges that are sharp at the start.
    #[schemars(range(min = 0.0, max = 180.0), extend("unit" = "deg"))]
    #[serde(default = "default_angle")]
    pub angle: f64,
    /// Maximum number of passes over all edges near changes.
    #[schemars(range(min = 1, max = 100))]
    #[serde(default = "default_passes")]
    pub passes: u32,
}

fn default_vertex_price() -> f64 {
    1e-5
}

fn default_crease_price() -> f64 {
    2e-6
}

fn default_angle() -> f64 {
    30.0
}

fn default_passes() -> u32 {
    4
}

impl Default for Prices {
    fn default() -> Self {
        Self {
            vertex: default_vertex_price(),
            crease: default_crease_price(),
            angle: default_angle(),
            passes: default_passes(),
        }
    }
}

/// The error message for a scan without faces.
pub(super) const NO_SURFACE: &str = "`moves: ByEnergy` also measures distances between the points: expected a mesh with faces as `points`; \
                                     use `Reconstruct` for points and `Triangulate` for range images";

/// Fits a subdivision surface as [`fit_subdivision`](super::fit::fit_subdivision) does. Between iterations, edge operations improve the
/// faces of the control mesh by lowering an energy.
///
/// The third phase of Hoppe, DeRose, Duchamp, Halstead, Jin, McDonald, Schweitzer and Stuetzle, "Piecewise smooth surface reconstruction"
/// (1994), section 4: an edge is collapsed, split, swapped, made sharp or made smooth if that lowers the energy, after local fitting of the
/// control points. The energy is the sum of the squared distances, a price for each vertex and a price for each sharp edge. Distances are
/// measured in two directions: from the scan's vertices to the surface, and from the surface to the scan's faces. Without the second
/// direction the surface would protrude where there are no points, in particular along sharp edges; the publication does not use it,
/// because its points have no faces. At the end, corners that would fold are divided; their folds are too small to affect the energy.
///
/// # Errors
/// The errors of [`fit_subdivision`](super::fit::fit_subdivision), and an error if the scan has no faces.
pub fn fit_by_moves(
    mesh: &Mesh,
    scan: &Mesh,
    smoothing: f64,
    iterations: u32,
    prices: Prices,
    progress: &Progress<'_>,
) -> Result<FittedSubdivision, Error> {
    let scan = Scan::new(scan).ok_or_else(|| Error::new(NO_SURFACE))?;
    let (points, steps) = (scan.points(), Vec::new());
    let mut fit = Fit { points, scan: Some(&scan), smoothing, iterations, steps };
    let start = crease(mesh, prices.angle, SHARP);
    let (mut mesh, mut nearest) = fit.fit_control_points(&start, progress)?;
    let mut moving = EdgeOptimizer::new(&mesh, &scan, prices, smoothing);
    for pass in 0..prices.passes {
        let (moved, made) = moving.pass(&mesh, &nearest, |done| {
            progress.tick((f64::from(pass) + done) / f64::from(prices.passes))
        })?;
        (mesh, nearest) = fit.fit_control_points(&moved, progress)?;
        if made == 0 {
            break;
        }
    }
    let (cut, has_cut) = cut_concave_corners(&mesh)?;
    if has_cut {
        (mesh, nearest) = fit.fit_control_points(&cut, progress)?;
    }
    Ok(fit.end(mesh, &nearest))
}

/// The number of edges whose moves are evaluated in parallel.
const BATCH: usize = 32;

/// A move must lower the energy by at least this fraction of the price of a sharp edge (for changes of sharpness) or of a vertex (for all
/// other moves). This ensures that the search ends.
const MIN_GAIN: f64 = 0.1;

/// A control mesh that is being improved by edge operations.
struct EdgeOptimizer<'a> {
    net: Net,
    scan: &'a Scan<'a>,
    /// For each face the scan's points whose nearest surface point is on the face.
    points_of_face: Vec<Vec<u32>>,
    /// The faces whose edges are evaluated next.
    fresh: Vec<u32>,
    /// The prices of a vertex and of a sharp edge, in mm^2.
    prices: [f64; 2],
    smoothing: f64,
    /// The weight of the smoothness term relative to the squared distance of one point.
    weight: f64,
}

/// A move (an edge operation) that lowers the energy, with its effects.
struct Outcome {
    gain: f64,
    change: Change,
    measured: Vec<u32>,
    positions: Vec<(u32, Point3<f64>)>,
    /// For each point of the scan near the move, its index and the index of the face with its nearest surface point. Faces are counted
    /// after the move: first those that were kept, then those that were added.
    nearest: Vec<(u32, u32)>,
}

impl<'a> EdgeOptimizer<'a> {
    fn new(mesh: &Mesh, scan: &'a Scan<'a>, prices: Prices, smoothing: f64) -> Self {
        let net = Net::new(mesh);
        let diagonal_sq = mesh.bounds().map_or(0.0, |(low, high)| (high - low).norm_squared());
        let prices = [prices.vertex, prices.crease].map(|price| price * diagonal_sq);
        let fresh = (0..net.faces.len() as u32).collect();
        Self { net, scan, points_of_face: Vec::new(), fresh, prices, smoothing, weight: 0.0 }
    }

    /// Evaluates all moves at the edges near the last changes, in a scattered order, and performs the moves that lower the energy. `fitted`
    /// has the current control points, `nearest` the nearest point of the surface for each point of the scan. Returns the new mesh, without
    /// attributes, and the number of moves.
    fn pass(
        &mut self,
        fitted: &Mesh,
        nearest: &[Option<Nearest>],
        tick: impl Fn(f64) -> Result<(), maquette_node::CancelledError>,
    ) -> Result<(Mesh, usize), Error> {
        let (_, vertices, faces) = self.net.mesh()?;
        for (&vertex, position) in vertices.iter().zip(fitted.positions().iter()) {
            self.net.positions[vertex as usize] = *position;
        }
        self.weight = self.smoothing * nearest.len() as f64 / vertices.len() as f64;
        self.points_of_face = vec![Vec::new(); self.net.faces.len()];
        for (point, nearest) in (0..).zip(nearest) {
            if let Some(nearest) = nearest {
                self.points_of_face[faces[nearest.face as usize] as usize].push(point);
            }
        }
        let mut edges = self.net.edges(std::mem::take(&mut self.fresh).into_iter());
        // Sorting by multiples of the golden ratio (modulo 2^64) puts neighboring edges far apart.
        edges.sort_by_key(|&[a, b]| {
            (u64::from(a) << 32 | u64::from(b)).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        });
        let count = edges.len();
        let mut waiting = VecDeque::from(edges);
        let mut made = 0;
        while !waiting.is_empty() {
            tick(1.0 - waiting.len() as f64 / count as f64)?;
            let batch = self.take_independent_moves(&mut waiting);
            let outcomes: Vec<Option<Outcome>> =
                batch.par_iter().map(|(edge, around)| self.best_move(*edge, around)).collect();
            let new = self.net.positions.len() as u32;
            for outcome in outcomes.into_iter().flatten() {
                self.apply(outcome, new);
                made += 1;
            }
        }
        Ok((self.net.mesh()?.0.with_frame(fitted.frame().copied()), made))
    }

    /// Takes the next edges whose moves (edge operations) are independent of each other and can be evaluated in parallel. The order of the
    /// edges does not depend on the number of threads.
    fn take_independent_moves(
        &self,
        waiting: &mut VecDeque<[u32; 2]>,
    ) -> Vec<([u32; 2], Surroundings)> {
        let [mut read, mut written] = [(); 2].map(|()| vec![false; self.net.faces.len()]);
        let mut batch = Vec::new();
        for _ in 0..waiting.len().min(4 * BATCH) {
            let Some(edge) = waiting.pop_front().filter(|_| batch.len() < BATCH) else { break };
            // The edge no longer exists if an earlier move has removed it.
            let Some(around) = self.surroundings(edge) else { continue };
            let all = around.measured.iter().chain(&around.margin);
            let meets = around.measured.iter().any(|&face| read[face as usize])
                || all.clone().any(|&face| written[face as usize]);
            if meets {
                waiting.push_back(edge);
                continue;
            }
            all.for_each(|&face| read[face as usize] = true);
            around.measured.iter().for_each(|&face| written[face as usize] = true);
            batch.push((edge, around));
        }
        batch
    }

    fn surroundings(&self, edge: [u32; 2]) -> Option<Surroundings> {
        let net = &self.net;
        let free = net.corners_of(&net.faces_at_edge(edge));
        if free.is_empty() {
            return None;
        }
        let measured = net.faces_around(&net.corners_of(&net.faces_around(&free)));
        let mut margin = net.faces_around(&net.corners_of(&measured));
        margin.retain(|face| measured.binary_search(face).is_err());
        Some(Surroundings { free, measured, margin })
    }

    /// Finds the move (edge operation) at an edge that lowers the energy most; `None` if no move lowers the energy enough.
    fn best_move(&self, edge: [u32; 2], around: &Surroundings) -> Option<Outcome> {
        let points: Vec<Point3<f64>> =
            self.points_near(around).map(|point| self.scan.points()[point as usize]).collect();
        let before =
            Local::new(&self.net, &Change::default(), around)?.measure(&points, self.scan)?;
        Move::ALL
            .into_iter()
            .filter_map(|kind| self.evaluate(kind, edge, around, &points, &before))
            .max_by(|a, b| a.gain.total_cmp(&b.gain))
    }

    /// Returns the indices of the scan's points whose nearest surface point is on one of the measured faces.
    fn points_near(&self, around: &Surroundings) -> impl Iterator<Item = u32> {
        around.measured.iter().flat_map(|&face| self.points_of_face[face as usize].iter().copied())
    }

    /// Performs a move on a copy of the neighborhood. Returns `None` if the move does not lower the energy enough or causes more folds.
    /// `before` has the distances of `points` before the move.
    fn evaluate(
        &self,
        kind: Move,
        edge: [u32; 2],
        around: &Surroundings,
        points: &[Point3<f64>],
        before: &Measure,
    ) -> Option<Outcome> {
        let change = self.net.change(kind, edge)?;
        let price =
            change.count_changes[0] * self.prices[0] + change.count_changes[1] * self.prices[1];
        let min_gain = price + MIN_GAIN * self.prices[usize::from(kind == Move::Tag)];
        if before.cost <= min_gain {
            return None;
        }
        let mut local = Local::new(&self.net, &change, around)?;
        let after = local.fit(points, self.scan, self.weight)?;
        if before.cost - after.cost <= min_gain || before.folds < after.folds {
            return None;
        }
        let nearest = self.points_near(around).zip(after.nearest);
        let nearest = nearest.map(|(point, nearest)| (point, nearest.face)).collect();
        let gain = before.cost - after.cost - price;
        let (measured, positions) = (around.measured.clone(), local.positions());
        Some(Outcome { gain, change, measured, positions, nearest })
    }

    fn apply(&mut self, outcome: Outcome, new: u32) {
        let Outcome { change, measured, positions, nearest, .. } = outcome;
        let number = self.net.positions.len() as u32;
        let added = self.net.apply(&change, new);
        self.points_of_face.resize(self.net.faces.len(), Vec::new());
        for (vertex, position) in positions {
            let vertex = if vertex == new { number } else { vertex };
            self.net.positions[vertex as usize] = position;
            self.fresh.extend(self.net.faces_around(&[vertex]));
        }
        measured.iter().for_each(|&face| self.points_of_face[face as usize].clear());
        let stay = measured.into_iter().filter(|face| !change.removed.contains(face));
        let faces: Vec<u32> = stay.chain(added).collect();
        for (point, face) in nearest {
            self.points_of_face[faces[face as usize] as usize].push(point);
        }
    }
}
