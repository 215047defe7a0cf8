//! The feature curves of a surface, along which vertices move.

use nalgebra::Point3;

use super::feature::{Feature, NO_CURVE};
use super::net::{Kind, Net};

/// The feature curves of a surface. Each ends at corners, or is closed.
#[derive(Debug)]
pub(super) struct Curves(Vec<Curve>);

#[derive(Debug)]
struct Curve {
    points: Vec<Point3<f64>>,
    /// For each point, the length of the curve before it, in mm.
    positions: Vec<f64>,
    /// For each segment, a triangle beside it.
    triangles: Vec<u32>,
    is_closed: bool,
}

impl Curves {
    /// Finds the curves that the features of `net` form, and assigns each feature edge to its curve.
    pub(super) fn trace(net: &mut Net) -> Self {
        let mut curves = Vec::new();
        let features: Vec<_> = net.edges().filter(|&h| net.is_feature(h)).collect();
        for &h in &features {
            for start in [net.from(h), net.end(h)] {
                if net.kind(start) != Kind::Curve {
                    curves.extend(Curve::trace(net, start, h, curves.len() as u32));
                }
            }
        }
        // All curves with corners are traced. What is left is closed.
        for &h in &features {
            let closed = Curve::trace(net, net.from(h), h, curves.len() as u32);
            curves.extend(closed.map(|curve| Curve { is_closed: true, ..curve }));
        }
        Self(curves)
    }

    /// Returns the point at a position on a curve, and a triangle beside it.
    pub(super) fn point(&self, curve: u32, position: f64) -> (Point3<f64>, u32) {
        let curve = &self.0[curve as usize];
        let length = curve.positions.last().copied().unwrap_or_default();
        let position = match curve.is_closed && length > 0.0 {
            true => position.rem_euclid(length),
            false => position.clamp(0.0, length),
        };
        let segments = curve.triangles.len();
        let after = curve.positions.partition_point(|&start| start <= position);
        let segment = after.clamp(1, segments) - 1;
        let [start, end] = [curve.positions[segment], curve.positions[segment + 1]];
        let fraction = if start < end { (position - start) / (end - start) } else { 0.0 };
        let [a, b] = [curve.points[segment], curve.points[segment + 1]];
        (a + (b - a) * fraction, curve.triangles[segment])
    }
}

impl Curve {
    /// Follows a curve from a vertex and an edge until it ends at a corner or comes back. Returns `None` if the edge has a curve already.
    fn trace(net: &mut Net, start: u32, first: u32, index: u32) -> Option<Self> {
        if net.features[first as usize]?.curve != NO_CURVE {
            return None;
        }
        let mut curve = Self {
            points: vec![net.place(start)],
            positions: vec![0.0],
            triangles: Vec::new(),
            is_closed: false,
        };
        let (mut vertex, mut next, mut position) = (start, Some(first), 0.0);
        while let Some(h) = next {
            let end = position + net.square(h).sqrt();
            let is_forward = net.from(h) == vertex;
            let span = if is_forward { [position, end] } else { [end, position] };
            net.set_span(h, index, span);
            vertex = if is_forward { net.end(h) } else { net.from(h) };
            position = end;
            curve.points.push(net.place(vertex));
            curve.positions.push(position);
            curve.triangles.push(h / 3);
            next = match net.kind(vertex) {
                Kind::Curve => net.untraced(vertex),
                Kind::Smooth | Kind::Corner => None,
            };
        }
        Some(curve)
    }
}

impl Net {
    /// Assigns a feature edge to a curve.
    fn set_span(&mut self, h: u32, curve: u32, span: [f64; 2]) {
        if let Some(feature) = self.features[h as usize] {
            self.mark_both(h, Some(Feature { curve, span, ..feature }));
        }
    }

    /// Returns a feature edge at a vertex that has no curve yet.
    fn untraced(&self, vertex: u32) -> Option<u32> {
        let mut found = None;
        self.visit_neighbors(vertex, |_, h| {
            if self.features[h as usize].is_some_and(|feature| feature.curve == NO_CURVE) {
                found = Some(h);
            }
        });
        found
    }

    /// Returns the curve of a vertex, its position, and the distances along the curve to its two neighbors, one of them negative. `None` if
    /// the vertex does not have exactly two neighbors on a curve.
    pub(super) fn on_curve(&self, vertex: u32) -> Option<(u32, f64, [f64; 2])> {
        let (mut ends, mut count) = ([(0, 0.0, 0.0); 2], 0);
        self.visit_neighbors(vertex, |_, h| {
            if let Some(Feature { curve, span: [start, end], .. }) = self.features[h as usize] {
                if let Some(place) = ends.get_mut(count) {
                    let is_forward = self.from(h) == vertex;
                    let [own, other] = if is_forward { [start, end] } else { [end, start] };
                    *place = (curve, own, other - own);
                }
                count += 1;
            }
        });
        let [(curve, own, to_first), (_, _, to_second)] = ends;
        (count == 2).then_some((curve, own, [to_first, to_second]))
    }

    /// Changes the position of a vertex along its curves by `shift` mm.
    pub(super) fn slide(&mut self, vertex: u32, shift: f64) {
        let mut fan = Vec::with_capacity(8);
        self.visit(vertex, |h| fan.push(h));
        for h in fan {
            let arriving = super::net::previous(h);
            if let Some(feature) = &mut self.features[h as usize] {
                feature.span[0] += shift;
            }
            if let Some(feature) = &mut self.features[arriving as usize] {
                feature.span[1] += shift;
            }
        }
    }
}
