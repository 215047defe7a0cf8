//! What points are missed by.

/// What some points are missed by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Missed {
    pub(super) max_sq: f64,
    pub(super) sum_sq: f64,
    pub(super) count: usize,
}

impl Missed {
    /// No points.
    pub(super) fn none() -> Self {
        Self { max_sq: 0.0, sum_sq: 0.0, count: 0 }
    }

    /// These points and one more, by the square of its distance.
    pub(super) fn and_by(self, distance_sq: f64) -> Self {
        self.and(Self { max_sq: distance_sq, sum_sq: distance_sq, count: 1 })
    }

    /// These points and others.
    pub(super) fn and(self, other: Self) -> Self {
        Self {
            max_sq: self.max_sq.max(other.max_sq),
            sum_sq: self.sum_sq + other.sum_sq,
            count: self.count + other.count,
        }
    }

    /// The largest distance and the root of the mean of the squares.
    pub(super) fn distances(self) -> [f64; 2] {
        [self.max_sq.sqrt(), (self.sum_sq / self.count.max(1) as f64).sqrt()]
    }
}
