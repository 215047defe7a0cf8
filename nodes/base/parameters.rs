//! Parameters of the points of a net.

use maquette_value as value;
use maquette_value::Along;

/// So many parameters from 0 to 1, at the same distances.
pub fn even(points: usize) -> Vec<f64> {
    (0..points).map(|k| k as f64 / (points - 1).max(1) as f64).collect()
}

/// A parameter from 0 to 1 per control point: the mean, over all lines of the net, of the share of the line's length up to the
/// point, where a step between neighbors counts as `measure` of their distance. Lines without length are left out; if all are,
/// the parameters are spaced evenly.
///
/// Piegl and Tiller, *The NURBS Book*, 2nd ed. (1997), algorithm A9.3.
pub fn parameters(net: &value::ControlNet, along: Along, measure: fn(f64) -> f64) -> Vec<f64> {
    let columns = net.columns();
    let (count, lines) = match along {
        Along::U => (net.rows(), columns),
        Along::V => (columns, net.rows()),
    };
    fn at(
        line: usize,
        k: usize,
        columns: usize,
        along: &Along,
        net: &maquette_value::ControlNet,
    ) -> nalgebra::Point3<f64> {
        match *along {
            Along::U => net.points()[k * columns + line],
            Along::V => net.points()[line * columns + k],
        }
    }
    let mut sums = vec![0.0; count];
    let mut counted = 0.0;
    for line in 0..lines {
        let mut lengths = vec![0.0; count];
        for k in 1..count {
            lengths[k] = lengths[k - 1]
                + measure(
                    (at(line, k, columns, &along, net) - at(line, k - 1, columns, &along, net))
                        .norm(),
                );
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
