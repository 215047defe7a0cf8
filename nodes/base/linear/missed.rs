//! The residuals of points: the distances by which a curve or surface misses them.

/// The largest and the summed squared distances by which some points are missed.
#[derive(Clone, Copy, Debug)]
pub struct Missed {
    /// The largest squared distance.
    pub max_sq: f64,
    /// The sum of the squared distances.
    pub sum_sq: f64,
    /// How many points there are.
    pub count: usize,
}

impl Missed {
    /// No points.
    pub fn none() -> Self {
        Self { max_sq: 0.0, sum_sq: 0.0, count: 0 }
    }

    /// These points and one more, by the square of its distance.
    pub fn and_by(self, distance_sq: f64) -> Self {
        self.and(Self { max_sq: distance_sq, sum_sq: distance_sq, count: 1 })
    }

    /// These points and others.
    pub fn and(self, other: Self) -> Self {
        Self {
            max_sq: self.max_sq.max(other.max_sq),
            sum_sq: self.sum_sq + other.sum_sq,
            count: self.count + other.count,
        }
    }

    /// The largest distance and the root of the mean of the squares.
    pub fn distances(self) -> [f64; 2] {
        [self.max_sq.sqrt(), (self.sum_sq / self.count.max(1) as f64).sqrt()]
    }
}
