//! Knot vectors of the requested kind.

use maquette_base::parameters::{parameters, uniform_parameters};
use maquette_node::{Error, bail};
use maquette_value as value;
use maquette_value::{KnotVector, ParameterDirection};

use crate::knots_kind::KnotsKind;

/// Returns the knots of a surface with the given net, along one direction. The domain of the kinds `Averaging`, `Chord` and `Centripetal`
/// is 0 to 1.
///
/// # Errors
/// Returns an error if the order is not from 2 to 10, the net has too few control points for it, or the kind is unsuitable for the net.
pub fn knots(
    net: &value::ControlNet,
    along: ParameterDirection,
    order: usize,
    kind: &KnotsKind,
) -> Result<KnotVector, Error> {
    let points = match along {
        ParameterDirection::U => net.rows(),
        ParameterDirection::V => net.columns(),
    };
    if (2..=10).contains(&order) && points < order {
        bail!(
            "order {order} along {along:?} needs at least {order} control points, the net has {points}"
        );
    }
    let degree = order.saturating_sub(1);
    fn average(
        parameters: Vec<f64>,
        degree: usize,
    ) -> Result<KnotVector, maquette_value::KnotVectorError> {
        KnotVector::from_parameters(&parameters, degree)
    }
    Ok(match kind {
        KnotsKind::Uniform => KnotVector::uniform(points, order)?,
        KnotsKind::Averaging => average(uniform_parameters(points), degree)?,
        KnotsKind::Chord => average(parameters(net, along, |distance| distance), degree)?,
        KnotsKind::Centripetal => average(parameters(net, along, f64::sqrt), degree)?,
        KnotsKind::Periodic => KnotVector::periodic(points, order)?,
        KnotsKind::Cylinder if (points, order) == (9, 3) => KnotVector::cylinder(),
        KnotsKind::Cylinder => bail!(
            "`Cylinder` is for 9 control points and order 3, here are {points} along {along:?} and order {order}"
        ),
        KnotsKind::Values(values) if points.checked_add(order) != Some(values.len()) => {
            bail!(
                "{points} control points of order {order} need {} knots, {} are given",
                points + order,
                values.len()
            );
        }
        KnotsKind::Values(values) => KnotVector::new(degree, values.clone())?,
    })
}

#[cfg(test)]
mod tests {
    use maquette_value::KnotVectorError;
    use nalgebra::Point3;

    use super::*;

    /// Returns a net of two rows whose columns are at the given positions.
    fn net(columns: &[f64]) -> value::ControlNet {
        let rows = [0.0, 1.0].into_iter();
        let points: Vec<_> =
            rows.flat_map(|y| columns.iter().map(move |&x| Point3::new(x, y, 0.0))).collect();
        value::ControlNet::new(2, columns.len(), points).unwrap()
    }

    fn knots_of(kind: KnotsKind, columns: &[f64]) -> Vec<f64> {
        knots(&net(columns), ParameterDirection::V, 3, &kind).unwrap().knots().to_vec()
    }

    #[test]
    fn knots_follow_the_distances_between_control_points() {
        let columns = [0.0, 1.0, 5.0, 21.0];
        assert_eq!(knots_of(KnotsKind::Uniform, &columns), [0., 0., 0., 1., 2., 2., 2.]);
        assert_eq!(knots_of(KnotsKind::Averaging, &columns)[3], 0.5);
        assert_eq!(knots_of(KnotsKind::Chord, &columns)[3], 3.0 / 21.0);
        assert_eq!(knots_of(KnotsKind::Centripetal, &columns)[3], 2.0 / 7.0);
        assert_eq!(
            knots_of(KnotsKind::Chord, &[2.0; 4]),
            knots_of(KnotsKind::Averaging, &[2.0; 4])
        );
    }

    #[test]
    fn knots_along_u_are_for_the_rows() {
        let knots = knots(&net(&[0.0; 5]), ParameterDirection::U, 2, &KnotsKind::Chord).unwrap();
        assert_eq!(knots.knots(), [0.0, 0.0, 1.0, 1.0]);
    }

    #[test]
    fn a_net_too_small_for_its_order_is_an_error_with_the_minimum() {
        let error =
            knots(&net(&[0.0; 5]), ParameterDirection::U, 3, &KnotsKind::Uniform).unwrap_err();
        let expected = "order 3 along U needs at least 3 control points, the net has 2";
        assert_eq!(error.to_string(), expected);
    }

    #[test]
    fn a_cylinder_needs_nine_columns() {
        fn cylinder(count: usize, order: usize) -> Result<KnotVector, Error> {
            knots(&net(&vec![0.0; count]), ParameterDirection::V, order, &KnotsKind::Cylinder)
        }
        assert_eq!(cylinder(9, 3).unwrap(), KnotVector::cylinder());
        for (count, order) in [(8, 3), (9, 4)] {
            let error = cylinder(count, order).unwrap_err().to_string();
            let expected = "`Cylinder` is for 9 control points and order 3";
            assert!(error.starts_with(expected), "{error}");
        }
    }

    #[test]
    fn given_knots_are_counted_and_checked() {
        fn given_knots(values: &[f64]) -> Result<KnotVector, Error> {
            knots(&net(&[0.0; 3]), ParameterDirection::V, 2, &KnotsKind::Values(values.to_vec()))
        }
        assert_eq!(given_knots(&[0., 0., 3., 4., 4.]).unwrap().knots(), [0., 0., 3., 4., 4.]);
        let count = given_knots(&[0., 1.]).unwrap_err();
        let expected = "3 control points of order 2 need 5 knots, 2 are given";
        assert_eq!(count.to_string(), expected);
        let falling = given_knots(&[0., 0., 3., 2., 4.]).unwrap_err();
        assert!(falling.downcast::<KnotVectorError>().is_some(), "{falling}");
        let high = knots(&net(&[0.0; 3]), ParameterDirection::V, usize::MAX, &KnotsKind::Uniform);
        let high = high.unwrap_err();
        assert!(matches!(high.downcast(), Some(KnotVectorError::Degree { .. })), "{high}");
    }
}
