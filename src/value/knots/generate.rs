//! Constructors of knot vectors.

use super::{KnotVector, KnotVectorError};

impl KnotVector {
    /// Evenly spaced knots whose end knots are repeated `order` times. The domain is from 0 to `n_control - order + 1`. If `n_control`
    /// equals `order`, the curve is a single Bezier curve.
    ///
    /// # Errors
    /// If `order` is not from 2 to 10, or there are fewer than `order` control points.
    pub fn uniform(n_control: usize, order: usize) -> Result<Self, KnotVectorError> {
        check(n_control, order)?;
        let pieces = n_control - order + 1;
        Self::new(
            order - 1,
            (0..n_control + order)
                .map(|i: usize| (i + 1).saturating_sub(order).min(pieces) as f64)
                .collect(),
        )
    }

    /// The knots of an exact circle of nine control points on a square: order 3, `0 0 0 1 1 2 2 3 3 4 4 4`. The weights alternate between 1
    /// and `sqrt(1/2)`.
    pub fn cylinder() -> Self {
        let knots = vec![0., 0., 0., 1., 1., 2., 2., 3., 3., 4., 4., 4.];
        Self::new(2, knots).expect("the knots of the circle keep the invariant")
    }

    /// Knots that follow the parameters of data points, with one control point per data point. The end knots are repeated, and each inner
    /// knot is the mean of `degree` successive parameters.
    ///
    /// De Boor's averaging; Piegl and Tiller, *The NURBS Book*, 2nd ed. (1997), eq. 9.8.
    ///
    /// # Errors
    /// If the degree is not from 1 to 9, there are at most `degree` parameters, the parameters decrease, or too many of them are equal.
    pub fn from_parameters(parameters: &[f64], degree: usize) -> Result<Self, KnotVectorError> {
        check(parameters.len(), degree.saturating_add(1))?;
        let last = parameters.len() - 1;
        let mut knots = vec![parameters[0]; degree + 1];
        knots.extend(
            parameters[1..last]
                .windows(degree)
                .map(|window| window.iter().sum::<f64>() / degree as f64),
        );
        knots.extend(vec![parameters[last]; degree + 1]);
        Self::new(degree, knots)
    }

    /// Knots for fewer control points than data points. The number of parameters between two inner knots is about constant.
    ///
    /// Piegl and Tiller, *The NURBS Book*, 2nd ed. (1997), eqs. 9.68 and 9.69. They place a knot at the index `j d - 1` of the parameters,
    /// counted from one end, which is the index `j d` counted from the other end. Here the knot is the mean of both positions, so that
    /// reversed parameters give reversed knots.
    ///
    /// # Errors
    /// If the degree is not from 1 to 9, there are not more than `degree` control points and parameters, the parameters decrease, or too
    /// many of them are equal.
    pub fn approximating(
        parameters: &[f64],
        n_control: usize,
        degree: usize,
    ) -> Result<Self, KnotVectorError> {
        check(n_control.min(parameters.len()), degree.saturating_add(1))?;
        let last = parameters.len() - 1;
        let pieces = n_control - degree;
        let per_piece = parameters.len() as f64 / pieces as f64;
        fn interpolate(index: f64, last: usize, parameters: &[f64]) -> f64 {
            let before = (index.max(0.0) as usize).min(last);
            let next = parameters[(before + 1).min(last)];
            parameters[before] + (next - parameters[before]) * (index.max(0.0) - before as f64)
        }
        let mut knots = vec![parameters[0]; degree + 1];
        knots.extend((1..pieces).map(|j: usize| {
            let index = j as f64 * per_piece;
            (interpolate(index - 1.0, last, parameters) + interpolate(index, last, parameters))
                / 2.0
        }));
        knots.extend(vec![parameters[last]; degree + 1]);
        Self::new(degree, knots)
    }

    /// Evenly spaced knots without repeated end knots. The domain is from 0 to `n_control - order + 1`. With these knots, a net whose last
    /// `order - 1` rows repeat its first rows gives a smoothly closed surface. The surface of any other net does not reach the first and
    /// last points of the net.
    ///
    /// # Errors
    /// If `order` is not from 2 to 10, or there are fewer than `order` control points.
    pub fn periodic(n_control: usize, order: usize) -> Result<Self, KnotVectorError> {
        check(n_control, order)?;
        let degree = order - 1;
        Self::new(degree, (0..n_control + order).map(|i| i as f64 - degree as f64).collect())
    }
}

fn check(n_control: usize, order: usize) -> Result<(), KnotVectorError> {
    if !(2..=10).contains(&order) {
        return Err(KnotVectorError::Degree { degree: order.saturating_sub(1) });
    }
    if n_control < order {
        return Err(KnotVectorError::TooFewPoints { points: n_control, degree: order - 1 });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_knots_are_the_published_ones() {
        fn knots(n_control: usize, order: usize) -> Vec<f64> {
            KnotVector::uniform(n_control, order).unwrap().knots().to_vec()
        }
        assert_eq!(knots(5, 3), [0., 0., 0., 1., 2., 3., 3., 3.]);
        assert_eq!(knots(9, 3), [0., 0., 0., 1., 2., 3., 4., 5., 6., 7., 7., 7.]);
        assert_eq!(knots(4, 4), [0., 0., 0., 0., 1., 1., 1., 1.]);
    }

    #[test]
    fn averaged_knots_are_means_of_parameters() {
        let knots = KnotVector::from_parameters(&[0.0, 1.0, 2.0, 4.0, 8.0], 3).unwrap();
        assert_eq!(knots.knots()[3..6], [0.0, 7.0 / 3.0, 8.0]);
        let line = KnotVector::from_parameters(&[0.0, 1.0, 3.0], 1).unwrap();
        assert_eq!(line.knots(), [0.0, 0.0, 1.0, 3.0, 3.0]);
        let bezier = KnotVector::from_parameters(&[0.0, 1.0, 3.0], 2).unwrap();
        assert_eq!(bezier.knots(), [0.0, 0.0, 0.0, 3.0, 3.0, 3.0]);
    }

    #[test]
    fn reversed_parameters_give_reversed_knots() {
        let parameters = [0.0, 0.25, 0.375, 0.75, 0.875, 1.0];
        let reversed: Vec<f64> = parameters.iter().rev().map(|u| 1.0 - u).collect();
        let there = KnotVector::from_parameters(&parameters, 2).unwrap();
        let back = KnotVector::from_parameters(&reversed, 2).unwrap();
        let mirrored: Vec<f64> = back.knots().iter().rev().map(|u| 1.0 - u).collect();
        assert_eq!(there.knots(), mirrored);
    }

    #[test]
    fn knots_for_fewer_control_points_follow_the_parameters_from_both_ends() {
        let parameters = [0.0, 0.125, 0.25, 0.5, 0.5625, 0.75, 1.0];
        let reversed: Vec<f64> = parameters.iter().rev().map(|u| 1.0 - u).collect();
        for count in 3..7 {
            let there = KnotVector::approximating(&parameters, count, 2).unwrap();
            let back = KnotVector::approximating(&reversed, count, 2).unwrap();
            assert_eq!(there.n_control(), count);
            for (a, b) in there.knots().iter().zip(back.knots().iter().rev()) {
                assert!((a - (1.0 - b)).abs() <= 1e-15);
            }
        }
        let even: Vec<f64> = (0..5).map(|k| f64::from(k) / 4.0).collect();
        assert_eq!(KnotVector::approximating(&even, 4, 2).unwrap().knots()[3], 0.5);
        assert!(KnotVector::approximating(&even, 2, 2).is_err());
        assert!(KnotVector::approximating(&[], 4, 2).is_err());
    }

    #[test]
    fn periodic_knots_have_the_domain_of_uniform_ones() {
        let knots = KnotVector::periodic(7, 4).unwrap();
        assert_eq!((knots.n_control(), knots.domain()), (7, (0.0, 4.0)));
    }

    #[test]
    fn too_few_control_points_are_refused() {
        assert!(matches!(KnotVector::uniform(2, 3), Err(KnotVectorError::TooFewPoints { .. })));
        assert!(matches!(
            KnotVector::from_parameters(&[], 3),
            Err(KnotVectorError::TooFewPoints { .. })
        ));
        assert!(matches!(
            KnotVector::from_parameters(&[0.0], 0),
            Err(KnotVectorError::Degree { .. })
        ));
        assert!(matches!(KnotVector::periodic(20, 11), Err(KnotVectorError::Degree { .. })));
        assert!(KnotVector::from_parameters(&[1.0; 4], 2).is_err());
    }
}
