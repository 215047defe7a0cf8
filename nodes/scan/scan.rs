//! Scans of any kind, and parts of them.
//!
//! `KeepCells`, `Crop`, `Pieces` and `DominantPlane` decide for each cell, point or vertex whether to keep it, and `Scan::select` removes
//! the others. So each of these nodes accepts range images, points and meshes. Faces are not cut: the remaining data are unchanged
//! measurements.

use maquette_value::{Mesh, Points, RangeImage};
use nalgebra::Point3;

maquette_node::union! {
    /// A scan: a range image, points or a mesh.
    pub enum Scan {
        RangeImage(RangeImage),
        Points(Points),
        Mesh(Mesh),
    }
}

impl Scan {
    /// The positions of all cells, points or vertices, in mm. The position of a cell without a point is NaN.
    pub fn positions(&self) -> &[Point3<f64>] {
        match self {
            Self::RangeImage(range) => range.points(),
            Self::Points(points) => points.positions(),
            Self::Mesh(mesh) => mesh.positions(),
        }
    }

    /// The plural noun for the elements that have positions: cells, points or vertices.
    pub fn elements(&self) -> &'static str {
        match self {
            Self::RangeImage(_) => "cells",
            Self::Points(_) => "points",
            Self::Mesh(_) => "vertices",
        }
    }

    /// Returns true if the sensor is at the origin, that is, for data of a capture in the coordinates of its camera.
    pub fn is_seen_from_origin(&self) -> bool {
        match self {
            Self::RangeImage(_) => true,
            Self::Points(_) => false,
            Self::Mesh(mesh) => mesh.frame().is_some(),
        }
    }

    /// Returns the part of the scan that consists of the elements marked in `kept`. Cells that are not marked lose their points. A face of
    /// a mesh is kept if all of its corners are marked.
    #[must_use]
    pub fn select(&self, kept: &[bool]) -> Self {
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
                let indices = (0..).zip(kept).filter(|(_, kept)| **kept).map(|(index, _)| index);
                Self::Points(points.select(&indices.collect::<Vec<_>>()))
            }
            Self::Mesh(mesh) => {
                let faces = (0..).zip(mesh.faces().iter());
                fn is_kept(face: &[u32], kept: &[bool]) -> bool {
                    face.iter().all(|&vertex| kept[vertex as usize])
                }
                let faces = faces.filter(|(_, face)| is_kept(face, kept)).map(|(face, _)| face);
                Self::Mesh(mesh.select(&faces.collect::<Vec<_>>()))
            }
        }
    }

    /// Returns the warning that a node gives if it removes everything from this scan. The warning states the scan's bounding box.
    pub(super) fn empty_result_warning(&self) -> String {
        let ranges = [0, 1, 2]
            .map(|axis: usize| {
                let along = || {
                    self.positions()
                        .iter()
                        .filter(|position| has_point(position))
                        .map(|it| it[axis])
                };
                let min = along().fold(f64::INFINITY, f64::min);
                let max = along().fold(f64::NEG_INFINITY, f64::max);
                format!("{} {min:.0} to {max:.0}", ["x", "y", "z"][axis])
            })
            .join(", ");
        format!("the result is empty: the bounding box of the input is {ranges} mm")
    }

    /// The size of the scan: the number of cells with a point, the number of points, or the number of faces.
    pub fn count(&self) -> usize {
        match self {
            Self::RangeImage(range) => range.n_valid(),
            Self::Points(points) => points.positions().len(),
            Self::Mesh(mesh) => mesh.faces().len(),
        }
    }
}

/// Returns true if the position of a cell is not NaN, which means that the cell has a point.
pub(super) fn has_point(position: &Point3<f64>) -> bool {
    !position.x.is_nan()
}
