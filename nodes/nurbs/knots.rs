//! Places the knots of one direction of a surface.

use maquette::value::{self, Along, KnotVector, KnotVectorError};
use maquette::{Context, Error, In, Node};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Places the knots of one direction of a surface.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Knots {
    /// The net that the surface will have.
    pub net: In<value::ControlNet>,
    /// The direction.
    pub along: Along,
    /// Order of the pieces, one more than their degree: 2 is straight, 3 quadratic, 4 cubic.
    #[schemars(range(min = 2, max = 10))]
    #[serde(default = "three")]
    pub order: usize,
    /// How the knots are placed.
    #[serde(default)]
    pub kind: KnotsKind,
}

fn three() -> usize {
    3
}

/// How knots are placed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum KnotsKind {
    /// Evenly; the surface ends at the net's border.
    #[default]
    Uniform,
    /// At the means of evenly spaced parameters, one for each control point; the surface ends at the net's border.
    Averaging,
    /// As `Averaging`, with parameters that follow the distances between the control points.
    Chord,
    /// As `Averaging`, with parameters that follow the square roots of the distances, which keeps sharp turns calm.
    Centripetal,
    /// Evenly, without ends: a net whose last `order - 1` rows or columns repeat the first ones closes smoothly.
    Periodic,
    /// Those of an exact circle: for 9 control points and order 3.
    Cylinder,
    /// These knots: as many as control points and order together, never decreasing.
    Values(Vec<f64>),
}

/// Why knots cannot be placed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum KnotsError {
    /// Too few control points.
    #[error(
        "order {order} along {along:?} needs at least {order} control points, the net has {points}"
    )]
    TooFew {
        /// The order.
        order: usize,
        /// The direction.
        along: Along,
        /// Control points of the net in this direction.
        points: usize,
    },
    /// A circle's knots for something else.
    #[error(
        "`Cylinder` is for 9 control points and order 3, here are {points} along {along:?} and order {order}"
    )]
    NotCylinder {
        /// The order.
        order: usize,
        /// The direction.
        along: Along,
        /// Control points of the net in this direction.
        points: usize,
    },
    /// A list of another length.
    #[error("{points} control points of order {order} need {} knots, {count} are given", points + order)]
    Count {
        /// The order.
        order: usize,
        /// Control points of the net in this direction.
        points: usize,
        /// Knots given.
        count: usize,
    },
    /// Numbers that are no knots.
    #[error(transparent)]
    Knots(#[from] KnotVectorError),
}

impl Node for Knots {
    type Outputs = (KnotVector,);
    const OUTPUTS: [&'static str; 1] = ["knots"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((knots(cx.get(&self.net), self.along, self.order, &self.kind)?,))
    }
}

/// The knots of a surface with this net, along one direction. The domain of the averaged kinds is 0 to 1.
///
/// # Errors
/// If the order is not from 2 to 10, the net has too few control points for it, or the kind does not fit them.
pub fn knots(
    net: &value::ControlNet,
    along: Along,
    order: usize,
    kind: &KnotsKind,
) -> Result<KnotVector, KnotsError> {
    let points = match along {
        Along::U => net.rows(),
        Along::V => net.columns(),
    };
    if (2..=10).contains(&order) && points < order {
        return Err(KnotsError::TooFew { order, along, points });
    }
    let degree = order.saturating_sub(1);
    let averaged = |parameters: Vec<f64>| KnotVector::averaged(&parameters, degree);
    Ok(match kind {
        KnotsKind::Uniform => KnotVector::uniform(points, order)?,
        KnotsKind::Averaging => averaged(even(points))?,
        KnotsKind::Chord => averaged(parameters(net, along, |distance| distance))?,
        KnotsKind::Centripetal => averaged(parameters(net, along, f64::sqrt))?,
        KnotsKind::Periodic => KnotVector::periodic(points, order)?,
        KnotsKind::Cylinder if (points, order) == (9, 3) => KnotVector::cylinder(),
        KnotsKind::Cylinder => return Err(KnotsError::NotCylinder { order, along, points }),
        KnotsKind::Values(values) if points.checked_add(order) != Some(values.len()) => {
            return Err(KnotsError::Count { order, points, count: values.len() });
        }
        KnotsKind::Values(values) => KnotVector::new(degree, values.clone())?,
    })
}

pub(super) fn even(points: usize) -> Vec<f64> {
    (0..points).map(|k| k as f64 / (points - 1).max(1) as f64).collect()
}

/// A parameter from 0 to 1 per control point: the mean, over all lines of the net, of the share of the line's length up to the
/// point, where a step between neighbors counts as `measure` of their distance. Lines without length are left out; if all are,
/// the parameters are spaced evenly.
///
/// Piegl and Tiller, *The NURBS Book*, 2nd ed. (1997), algorithm A9.3.
pub(crate) fn parameters(
    net: &value::ControlNet,
    along: Along,
    measure: fn(f64) -> f64,
) -> Vec<f64> {
    let columns = net.columns();
    let (count, lines) = match along {
        Along::U => (net.rows(), columns),
        Along::V => (columns, net.rows()),
    };
    let at = |line: usize, k: usize| match along {
        Along::U => net.points()[k * columns + line],
        Along::V => net.points()[line * columns + k],
    };
    let mut sums = vec![0.0; count];
    let mut counted = 0.0;
    for line in 0..lines {
        let mut lengths = vec![0.0; count];
        for k in 1..count {
            lengths[k] = lengths[k - 1] + measure((at(line, k) - at(line, k - 1)).norm());
        }
        let whole = lengths[count - 1];
        if whole > 0.0 {
            counted += 1.0;
            sums.iter_mut().zip(lengths).for_each(|(sum, length)| *sum += length / whole);
        }
    }
    if counted == 0.0 {
        return even(count);
    }
    sums.iter().map(|sum| sum / counted).collect()
}

/// Whether knots are those of the kind [`KnotsKind::Uniform`], on whatever domain.
pub(super) fn is_even(knots: &KnotVector) -> bool {
    let Ok(even) = KnotVector::uniform(knots.n_control(), knots.degree() + 1) else { return false };
    let ((start, end), (even_start, even_end)) = (knots.domain(), even.domain());
    let scale = (even_end - even_start) / (end - start);
    let place = |knot: &f64| (knot - start) * scale + even_start;
    knots.knots().iter().map(place).zip(even.knots()).all(|(a, b)| (a - b).abs() <= 1e-9 * even_end)
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    /// A net of two rows whose columns lie at these places.
    fn net(columns: &[f64]) -> value::ControlNet {
        let row = |y| columns.iter().map(move |&x| Point3::new(x, y, 0.0));
        let points = row(0.0).chain(row(1.0)).collect::<Vec<_>>();
        value::ControlNet::new(2, columns.len(), points).unwrap()
    }

    fn placed(kind: KnotsKind, columns: &[f64]) -> Vec<f64> {
        knots(&net(columns), Along::V, 3, &kind).unwrap().knots().to_vec()
    }

    #[test]
    fn knots_follow_the_distances_between_control_points() {
        let columns = [0.0, 1.0, 5.0, 21.0];
        assert_eq!(placed(KnotsKind::Uniform, &columns), [0., 0., 0., 1., 2., 2., 2.]);
        assert_eq!(placed(KnotsKind::Averaging, &columns)[3], 0.5);
        assert_eq!(placed(KnotsKind::Chord, &columns)[3], 3.0 / 21.0);
        assert_eq!(placed(KnotsKind::Centripetal, &columns)[3], 2.0 / 7.0);
        assert_eq!(placed(KnotsKind::Chord, &[2.0; 4]), placed(KnotsKind::Averaging, &[2.0; 4]));
    }

    #[test]
    fn knots_along_u_are_for_the_rows() {
        let knots = knots(&net(&[0.0; 5]), Along::U, 2, &KnotsKind::Chord).unwrap();
        assert_eq!(knots.knots(), [0.0, 0.0, 1.0, 1.0]);
    }

    #[test]
    fn a_net_too_small_for_its_order_is_told_what_is_needed() {
        let error = knots(&net(&[0.0; 5]), Along::U, 3, &KnotsKind::Uniform).unwrap_err();
        let expected = "order 3 along U needs at least 3 control points, the net has 2";
        assert_eq!(error.to_string(), expected);
    }

    #[test]
    fn a_cylinder_needs_nine_columns() {
        let cylinder =
            |count, order| knots(&net(&vec![0.0; count]), Along::V, order, &KnotsKind::Cylinder);
        assert_eq!(cylinder(9, 3), Ok(KnotVector::cylinder()));
        assert!(matches!(cylinder(8, 3), Err(KnotsError::NotCylinder { .. })));
        assert!(matches!(cylinder(9, 4), Err(KnotsError::NotCylinder { .. })));
    }

    #[test]
    fn given_knots_are_counted_and_checked() {
        let given = |values: &[f64]| {
            knots(&net(&[0.0; 3]), Along::V, 2, &KnotsKind::Values(values.to_vec()))
        };
        assert_eq!(given(&[0., 0., 3., 4., 4.]).unwrap().knots(), [0., 0., 3., 4., 4.]);
        assert_eq!(given(&[0., 1.]), Err(KnotsError::Count { order: 2, points: 3, count: 2 }));
        assert!(matches!(given(&[0., 0., 3., 2., 4.]), Err(KnotsError::Knots(_))));
        let high = knots(&net(&[0.0; 3]), Along::V, usize::MAX, &KnotsKind::Uniform);
        assert!(matches!(high, Err(KnotsError::Knots(KnotVectorError::Degree { .. }))));
    }
}
