//! Makes a rational B-spline surface from a control net.

use maquette_node::{Context, Error, In, Node, bail};
use maquette_value as value;
use maquette_value::{KnotVector, ParameterDirection, Surface};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::knot_vectors::knot_vector::knots;
use super::knots_kind::KnotsKind;

/// Makes a rational B-spline surface (NURBS) from a control net.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Nurbs {
    /// The control net.
    pub net: In<value::ControlNet>,
    /// Knots along u, from row to row; uniform if omitted.
    pub u: Option<In<KnotVector>>,
    /// Knots along v, from column to column; uniform if omitted.
    pub v: Option<In<KnotVector>>,
    /// Orders along u and v, the degrees plus one: 2 is linear, 3 quadratic, 4 cubic. If omitted: that of the linked knots, or 3.
    #[schemars(inner(range(min = 2, max = 10)))]
    #[serde(default)]
    pub order: Option<[usize; 2]>,
}

impl Node for Nurbs {
    type Outputs = (Surface,);
    const OUTPUTS: [&'static str; 1] = ["surface"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let [u, v] = [&self.u, &self.v].map(|knots| knots.as_ref().map(|knots| cx.get(knots)));
        Ok((nurbs(cx.get(&self.net), u, v, self.order)?,))
    }
}

/// Makes the surface of a net with the given knots. If the knots of a direction are `None`, they are uniform: of the given order, or of
/// order 3 if `order` is `None`.
///
/// # Errors
/// Returns an error if the knots and the order differ, the knots are for another number of control points, the net is too small, or the
/// weights of a span are all 0.
pub fn nurbs(
    net: &value::ControlNet,
    u: Option<&KnotVector>,
    v: Option<&KnotVector>,
    order: Option<[usize; 2]>,
) -> Result<Surface, Error> {
    fn choose(
        given: Option<&KnotVector>,
        order: Option<usize>,
        along: ParameterDirection,
        net: &maquette_value::ControlNet,
    ) -> Result<KnotVector, Error> {
        match (given, order) {
            (Some(knots), Some(order)) if knots.degree() + 1 != order => {
                bail!(
                    "`order` is {order} along {along:?}, but the linked knots are of order {}",
                    knots.degree() + 1
                )
            }
            (Some(knots), _) => Ok(knots.clone()),
            (None, order) => Ok(knots(net, along, order.unwrap_or(3), &KnotsKind::Uniform)?),
        }
    }
    let u = choose(u, order.map(|[u, _]| u), ParameterDirection::U, net)?;
    let v = choose(v, order.map(|[_, v]| v), ParameterDirection::V, net)?;
    Ok(Surface::new(net.clone(), u, v)?)
}

#[cfg(test)]
mod tests {
    use maquette_value::SurfaceError;
    use nalgebra::Point3;

    use super::*;

    fn net() -> value::ControlNet {
        value::ControlNet::new(4, 5, vec![Point3::origin(); 20]).unwrap()
    }

    #[test]
    fn a_surface_is_quadratic_by_default() {
        fn orders(order: Option<[usize; 2]>) -> [usize; 2] {
            let surface = nurbs(&net(), None, None, order).unwrap();
            [surface.u().degree() + 1, surface.v().degree() + 1]
        }
        assert_eq!(orders(None), [3, 3]);
        assert_eq!(orders(Some([2, 5])), [2, 5]);
    }

    #[test]
    fn linked_knots_and_another_order_contradict_each_other() {
        let knots = KnotVector::uniform(4, 4).unwrap();
        assert!(nurbs(&net(), Some(&knots), None, None).is_ok());
        assert!(nurbs(&net(), Some(&knots), None, Some([4, 2])).is_ok());
        let error = nurbs(&net(), Some(&knots), None, Some([3, 3])).unwrap_err();
        let expected = "`order` is 3 along U, but the linked knots are of order 4";
        assert_eq!(error.to_string(), expected);
    }

    #[test]
    fn knots_for_another_net_are_refused() {
        let knots = KnotVector::uniform(4, 3).unwrap();
        let error = nurbs(&net(), None, Some(&knots), None).unwrap_err();
        let count = SurfaceError::Count { along: 'v', knots: 4, points: 5 };
        assert_eq!(error.downcast(), Some(&count));
        let small = nurbs(&net(), None, None, Some([5, 3])).unwrap_err();
        let too_few = "order 5 along U needs at least 5 control points, the net has 4";
        assert_eq!(small.to_string(), too_few);
    }
}
