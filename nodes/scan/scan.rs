//! What scans are made of, and parts of it.
//!
//! `KeepCells`, `Crop`, `Pieces` and `DominantPlane` decide for each cell, point or vertex whether it stays, and `Scan::only` does the
//! rest, so that each of them takes range images, points and meshes. No face is cut: what remains is as the sensor measured it.

use maquette_value::{Mesh, Points, RangeImage};
use nalgebra::Point3;

maquette_node::union! {
    /// What was scanned, in any form.
    pub enum Scan {
        RangeImage(RangeImage),
        Points(Points),
        Mesh(Mesh),
    }
}

impl Scan {
    /// Where its cells, points or vertices are, in mm; NaN where a cell has no point.
    pub fn places(&self) -> &[Point3<f64>] {
        match self {
            Self::RangeImage(range) => range.points(),
            Self::Points(points) => points.positions(),
            Self::Mesh(mesh) => mesh.positions(),
        }
    }

    /// What its places are called.
    pub fn elements(&self) -> &'static str {
        match self {
            Self::RangeImage(_) => "cells",
            Self::Points(_) => "points",
            Self::Mesh(_) => "vertices",
        }
    }

    /// Whether a sensor at the origin has seen it: of what a capture gave, in the axes of its camera.
    pub fn is_seen_from_origin(&self) -> bool {
        match self {
            Self::RangeImage(_) => true,
            Self::Points(_) => false,
            Self::Mesh(mesh) => mesh.frame().is_some(),
        }
    }

    /// What is left of it of these places, one flag for each: a cell that goes has no point any more, and of a mesh those faces stay that
    /// have no corner elsewhere.
    #[must_use]
    pub fn only(&self, kept: &[bool]) -> Self {
        match self {
            Self::RangeImage(range) => {
                let points = range
                    .points()
                    .iter()
                    .zip(kept)
                    .map(|(&point, &kept): (&Point3<f64>, &bool)| match kept {
                        true => point,
                        false => Point3::new(f64::NAN, f64::NAN, f64::NAN),
                    })
                    .collect();
                Self::RangeImage(range.with_points(points).expect("as many points as cells"))
            }
            Self::Points(points) => {
                let places = (0..).zip(kept).filter(|(_, kept)| **kept).map(|(place, _)| place);
                Self::Points(points.select(&Vec::from_iter(places)))
            }
            Self::Mesh(mesh) => {
                let faces = (0..).zip(mesh.faces().iter());
                fn is_kept(face: &[u32], kept: &[bool]) -> bool {
                    face.iter().all(|&vertex| kept[vertex as usize])
                }
                let faces = faces.filter(|(_, face)| is_kept(face, kept)).map(|(face, _)| face);
                Self::Mesh(mesh.select(&Vec::from_iter(faces)))
            }
        }
    }

    /// What is said if nothing of it is left: where it was.
    pub(super) fn nothing_left(&self) -> String {
        let ranges = [0, 1, 2]
            .map(|axis: usize| {
                let along =
                    || self.places().iter().filter(|place| is_there(place)).map(|it| it[axis]);
                let least = along().fold(f64::INFINITY, f64::min);
                let most = along().fold(f64::NEG_INFINITY, f64::max);
                format!("{} {least:.0} to {most:.0}", ["x", "y", "z"][axis])
            })
            .join(", ");
        format!("nothing is left: what came in lies at {ranges} mm")
    }

    /// How many cells with a point, points or faces there are.
    pub fn count(&self) -> usize {
        match self {
            Self::RangeImage(range) => range.n_valid(),
            Self::Points(points) => points.positions().len(),
            Self::Mesh(mesh) => mesh.faces().len(),
        }
    }
}

/// Whether a cell has a point.
pub(super) fn is_there(place: &Point3<f64>) -> bool {
    !place.x.is_nan()
}
