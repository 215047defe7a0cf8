//! Residuals: the distances between given points and a curve or surface.

/// The distances of some points from a curve or surface, summarized by their maximum and the sum of their squares.
#[derive(Clone, Copy, Debug)]
pub struct Residuals {
    /// The largest squared distance of a point from the curve or surface.
    pub max_sq: f64,
    /// The sum of the squared distances of all points from the curve or surface.
    pub sum_sq: f64,
    /// The number of points.
    pub count: usize,
}

impl Residuals {
    /// Returns the summary for an empty set of points.
    pub fn empty() -> Self {
        Self { max_sq: 0.0, sum_sq: 0.0, count: 0 }
    }

    /// Adds one point, given its squared distance.
    pub fn with_distance_sq(self, distance_sq: f64) -> Self {
        self.merge(Self { max_sq: distance_sq, sum_sq: distance_sq, count: 1 })
    }

    /// Combines the residuals of two sets of points.
    pub fn merge(self, other: Self) -> Self {
        Self {
            max_sq: self.max_sq.max(other.max_sq),
            sum_sq: self.sum_sq + other.sum_sq,
            count: self.count + other.count,
        }
    }

    /// The maximum distance, and the root mean square of the distances.
    pub fn distances(self) -> [f64; 2] {
        [self.max_sq.sqrt(), (self.sum_sq / self.count.max(1) as f64).sqrt()]
    }
}
