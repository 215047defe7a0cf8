//! Edges on the feature curves of a surface.

/// The index of a curve that is not known yet.
pub(super) const NO_CURVE: u32 = u32::MAX;

/// An edge on a feature curve: a border, a crease or a sharp edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct Feature {
    /// The sharpness of the crease; 0 for other features.
    pub sharpness: f64,
    /// The index of the curve that contains the edge.
    pub curve: u32,
    /// The positions of the half-edge's start and end, in mm along the curve. On a closed curve any multiple of its length may be added.
    pub span: [f64; 2],
}

impl Feature {
    /// Returns an edge whose curve is not known yet.
    pub(super) fn new(sharpness: f64) -> Self {
        Self { sharpness, curve: NO_CURVE, span: [0.0; 2] }
    }

    /// Returns the same edge for the opposite half-edge.
    pub(super) fn reversed(self) -> Self {
        let [start, end] = self.span;
        Self { span: [end, start], ..self }
    }

    /// Returns the two halves of the edge.
    pub(super) fn halves(self) -> [Self; 2] {
        let [start, end] = self.span;
        let middle = (start + end) / 2.0;
        [[start, middle], [middle, end]].map(|span| Self { span, ..self })
    }
}
