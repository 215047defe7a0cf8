//! Walls that are thinner than the chords of the new triangles are high: their faces are refined until they do not run through each other.

use std::collections::BTreeSet;

use maquette_node::{Error, Progress};
use maquette_value::{Faces, Mesh};

use super::net::{Kind, Net};
use super::original::Original;

/// Maximum number of times that an edge is halved. Each halving brings a triangle four times nearer to the surface.
const MAX_HALVINGS: usize = 12;

/// Splits triangles that run through another wall. Does nothing if the original surface runs through itself, or walls are far enough apart.
/// Returns false, and splits nothing, if more than the fraction `max_crossing` of the triangles run through walls.
///
/// # Errors
/// Returns an error if the evaluation is cancelled.
pub(super) fn refine(
    net: &mut Net,
    original: &Original<'_>,
    max_crossing: f64,
    progress: &Progress<'_>,
) -> Result<bool, Error> {
    let triangles = net.triangles();
    let places: Vec<_> = triangles.iter().map(|(_, corners)| net.middle(*corners)).collect();
    let starts: Vec<_> =
        triangles.iter().map(|(_, corners)| net.near[corners[0] as usize]).collect();
    let landings = original.sheet.land(&places, &starts);
    let has_near_walls = landings.iter().flatten().any(|landing| landing.has_nearer_wall);
    if !has_near_walls {
        return Ok(true);
    }
    for round in 0..MAX_HALVINGS {
        let triangles = net.triangles();
        let faces = triangles.iter().map(|(_, corners)| *corners).collect();
        let mesh = Mesh::new(net.places.clone(), Faces::triangles(faces))?;
        let crossing = mesh.crossings(|| progress.check())?;
        if crossing.is_empty() {
            break;
        }
        // Crossings of the original surface itself remain.
        if round == 0 && !original.mesh.crossings(|| progress.check())?.is_empty() {
            break;
        }
        let crossing: BTreeSet<u32> = crossing.into_iter().flatten().collect();
        if round == 0 && max_crossing * (triangles.len() as f64) < crossing.len() as f64 {
            return Ok(false);
        }
        let sides = crossing.iter().map(|&face| net.longest_side(triangles[face as usize].0));
        // Each edge once: the lower of its half-edges. `NONE`, the twin at a border, is larger than any other.
        let edges: BTreeSet<u32> = sides.map(|h| h.min(net.twin(h))).collect();
        let edges: Vec<_> = edges.into_iter().map(|h| (h, net.square(h))).collect();
        for (h, square) in edges {
            // Skip a half-edge that has become another edge, because an edge of its triangle was split.
            if net.square(h) == square {
                let vertex = net.split(h);
                place_on_surface(net, original, vertex);
            }
        }
    }
    Ok(true)
}

/// Moves a new vertex from the middle of its edge to its wall or its curve.
fn place_on_surface(net: &mut Net, original: &Original<'_>, vertex: u32) {
    let (place, triangle) = match net.kind(vertex) {
        Kind::Curve => {
            let Some((curve, position, _)) = net.on_curve(vertex) else { return };
            original.curves.point(curve, position)
        }
        Kind::Smooth | Kind::Corner => {
            let (point, start) = (net.place(vertex), net.near[vertex as usize]);
            let Some(landing) = original.sheet.land(&[point], &[start]).pop().flatten() else {
                return;
            };
            (landing.place, landing.triangle)
        }
    };
    if net.shift(vertex, place) {
        net.near[vertex as usize] = triangle;
    }
}

impl Net {
    /// Returns the triangles with their indices.
    fn triangles(&self) -> Vec<(u32, [u32; 3])> {
        let indices = 0..self.from.len() as u32 / 3;
        indices.filter_map(|index| Some((index, self.triangle(index)?))).collect()
    }

    /// Returns the half-edge of a triangle's longest side.
    fn longest_side(&self, triangle: u32) -> u32 {
        let sides = [3 * triangle, 3 * triangle + 1, 3 * triangle + 2];
        sides.into_iter().fold(sides[0], |longest, h| {
            if self.square(h) > self.square(longest) { h } else { longest }
        })
    }
}
