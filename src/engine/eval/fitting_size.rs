//! The largest size of a node's inputs for which the memory suffices.

use maquette_node::{AnyNode, Sizes, ValueSize};

use super::panics::catch_panic;

/// Returns the size with which a node needs at most `limit` bytes, such as `give it at most 1 200 000 faces`. `memory` returns the memory
/// in bytes for inputs of a fraction of their size, and `size` is the size of the largest input. `None` if no size is small enough.
pub(super) fn fitting_size(
    memory: impl Fn(f64) -> Option<f64>,
    size: ValueSize,
    limit: f64,
) -> Option<String> {
    let (count, word) =
        if size.faces > 0.0 { (size.faces, "faces") } else { (size.points, "points") };
    let (mut fits, mut exceeds) = (0.0, 1.0);
    for _ in 0..50 {
        let middle = f64::midpoint(fits, exceeds);
        if memory(middle)? <= limit { fits = middle } else { exceeds = middle }
    }
    let count = two_digits_below(count * fits);
    (count >= 1.0).then(|| format!("give it at most {} {word}", grouped(count)))
}

/// Returns the size of the inputs with which a node needs at most `limit` bytes; see [`fitting_size`]. All inputs are made smaller by the
/// same factor. `None` if the node has no law.
pub(super) fn fitting_input(
    node: &dyn AnyNode,
    inputs: &[Option<ValueSize>],
    limit: f64,
) -> Option<String> {
    let memory = |factor: f64| {
        let inputs = |slot: usize| Some((*inputs.get(slot)?)?.scale(factor));
        forecast(node, &Sizes { inputs: &inputs, files: &|_, _| None })?.memory.map(|it| it.bytes)
    };
    fitting_size(memory, largest(inputs)?, limit)
}

/// Returns the forecast of a node. `None` if it has no law. A panic of its code is reported when the node runs.
pub(super) fn forecast(node: &dyn AnyNode, sizes: &Sizes<'_>) -> Option<maquette_node::Forecast> {
    catch_panic(|| Ok(node.forecast(sizes))).ok().flatten()
}

/// Returns the size that takes the most memory.
pub(super) fn largest(sizes: &[Option<ValueSize>]) -> Option<ValueSize> {
    sizes.iter().flatten().copied().max_by(|a, b| a.bytes.total_cmp(&b.bytes))
}

/// Rounds down to two significant digits.
fn two_digits_below(count: f64) -> f64 {
    let mut unit = 1.0;
    while count / unit >= 100.0 {
        unit *= 10.0;
    }
    (count / unit).floor() * unit
}

/// Formats a whole number with spaces between groups of three digits.
fn grouped(count: f64) -> String {
    let digits = format!("{count:.0}");
    let groups = digits.as_bytes().rchunks(3).rev().map(|group| String::from_utf8_lossy(group));
    groups.collect::<Vec<_>>().join(" ")
}
