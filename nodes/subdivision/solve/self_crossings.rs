//! Fins of interpolating surfaces that cross the surface.

use maquette_node::{CancelledError, Progress};
use maquette_value::Mesh;
use nalgebra::Point3;

/// The distance of a control point from its point, in distances to the nearest neighboring point, below which no fin is expected.
const MIN_MOTION: f64 = 1.0;

/// The places where an interpolating surface crosses itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SelfCrossings {
    /// The number of pairs of faces that cross.
    count: usize,
    /// The place of the first pair.
    at: Point3<f64>,
    /// The index of the nearest of the given points.
    pub(crate) nearest: usize,
    /// The distance of its control point, in mm.
    motion: f64,
    /// The distance of its nearest neighbor, in mm.
    spacing: f64,
}

impl SelfCrossings {
    /// Finds the crossings of the surface through `points` with the control points `control`. `spacings` has the distance of each point
    /// from its nearest neighbor. `draw` returns faces of the surface near the control points with the given indices, which are so far from
    /// their points that the surface may have fins. Returns `None` if nothing crosses.
    ///
    /// # Errors
    /// Returns an error if the evaluation is cancelled.
    pub(crate) fn find(
        points: &[Point3<f64>],
        control: &[Point3<f64>],
        spacings: &[f64],
        draw: impl FnOnce(&[u32]) -> Option<Mesh>,
        progress: &Progress<'_>,
    ) -> Result<Option<Self>, CancelledError> {
        let motions: Vec<f64> =
            points.iter().zip(control).map(|(point, control)| (control - point).norm()).collect();
        let far = (0..).zip(motions.iter().zip(spacings));
        let far = far.filter(|(_, (motion, spacing))| **motion > MIN_MOTION * **spacing);
        let far: Vec<u32> = far.map(|(vertex, _)| vertex).collect();
        if far.is_empty() {
            return Ok(None);
        }
        let Some(drawn) = draw(&far) else { return Ok(None) };
        let crossings = drawn.crossings(|| progress.check())?;
        let Some(first) = crossings.first() else { return Ok(None) };
        let corners = first.iter().flat_map(|&face| drawn.faces().face(face as usize));
        let corners: Vec<_> =
            corners.map(|&vertex| drawn.positions()[vertex as usize].coords).collect();
        let at =
            Point3::from(corners.iter().sum::<nalgebra::Vector3<f64>>() / corners.len() as f64);
        let distances = points.iter().map(|point| (point - at).norm_squared());
        let nearest = distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |it| it.0);
        let (motion, spacing) = (motions[nearest], spacings[nearest]);
        Ok(Some(Self { count: crossings.len(), at, nearest, motion, spacing }))
    }

    /// Returns a warning. `name` names the nearest of the given points, and `help` says what to do.
    pub(crate) fn warning(&self, name: &str, help: &str) -> String {
        let Self { count, at, motion, spacing, .. } = self;
        format!(
            "the surface crosses itself at {count} pairs of faces, first at ({:.3}, {:.3}, {:.3}) mm near {name}: the control point there is \
             {motion:.3} mm away, the nearest neighbor {spacing:.3} mm; {help}",
            at.x, at.y, at.z
        )
    }
}
