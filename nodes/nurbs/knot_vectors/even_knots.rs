//! Uniform knots.

use maquette_value::KnotVector;

/// Returns true if the knots are uniform, of the kind [`KnotsKind::Uniform`](crate::KnotsKind::Uniform), on any domain.
pub(crate) fn is_even(knots: &KnotVector) -> bool {
    let Ok(even) = KnotVector::uniform(knots.n_control(), knots.degree() + 1) else { return false };
    let ((start, end), (even_start, even_end)) = (knots.domain(), even.domain());
    let scale = (even_end - even_start) / (end - start);
    knots
        .knots()
        .iter()
        .map(|knot| (knot - start) * scale + even_start)
        .zip(even.knots())
        .all(|(a, b)| (a - b).abs() <= 1e-9 * even_end)
}
