//! Curve parameters of the points of a control net.

use maquette_value as value;
use maquette_value::ParameterDirection;

/// Returns evenly spaced parameters from 0 to 1, one for each of `points` points.
pub fn uniform_parameters(points: usize) -> Vec<f64> {
    (0..points).map(|k| k as f64 / (points - 1).max(1) as f64).collect()
}

/// Returns a parameter from 0 to 1 for each control point of a line in the direction `along`. The parameter is the fraction of the line's
/// length that is before the point, averaged over all lines of the net. A segment between two neighboring points contributes
/// `measure(distance)` to the length of its line. Lines without length are skipped; if no line has a length, the parameters are evenly
/// spaced.
///
/// Piegl and Tiller, *The NURBS Book*, 2nd ed. (1997), algorithm A9.3.
pub fn parameters(
    net: &value::ControlNet,
    along: ParameterDirection,
    measure: fn(f64) -> f64,
) -> Vec<f64> {
    let columns = net.columns();
    let (count, lines) = match along {
        ParameterDirection::U => (net.rows(), columns),
        ParameterDirection::V => (columns, net.rows()),
    };
    // The index increments along a line of the net, and from one line to the next.
    let (step, next_line) = match along {
        ParameterDirection::U => (columns, 1),
        ParameterDirection::V => (1, columns),
    };
    let mut sums = vec![0.0; count];
    let mut counted = 0.0;
    for line in 0..lines {
        let mut lengths = vec![0.0; count];
        for k in 1..count {
            let [before, here] = [k - 1, k].map(|k| net.points()[line * next_line + k * step]);
            lengths[k] = lengths[k - 1] + measure((here - before).norm());
        }
        let total = lengths[count - 1];
        if total > 0.0 {
            counted += 1.0;
            sums.iter_mut().zip(lengths).for_each(|(sum, length)| *sum += length / total);
        }
    }
    if counted == 0.0 {
        return uniform_parameters(count);
    }
    sums.iter().map(|sum| sum / counted).collect()
}

/// Returns the index of the first line (row or column) whose points coincide with those of the line before, given the parameters of all
/// lines. `None` if there is none.
pub fn coincident_line(parameters: &[f64]) -> Option<usize> {
    let extent = parameters.last()? - parameters.first()?;
    (1..parameters.len()).find(|&k| parameters[k] - parameters[k - 1] <= 1e-12 * extent)
}
