//! Law 11 for range images: the attributes of cells are handled as a node declares. Each cell is numbered. Its color encodes the number,
//! and its flags are computed from the number.

use maquette_node::{Progress, Transfer};
use maquette_value::{AnyValue, Attribute, Mesh, RangeImage, Rgb, value_type};

use super::evaluation::{evaluate_node, inputs};
use super::extremes::Case;

/// Checks that a node handles the attributes of cells as it declares. If a port accepts several types, it gets a range image.
pub(super) fn check(case: &Case<'_>, broken: &mut Vec<String>) {
    let (entry, node) = (case.entry, &case.graph.nodes()[case.index]);
    let Some(good) = inputs(node, case.values) else { return };
    // Use the range image with the most points, because nodes that also accept meshes need enough points for a surface.
    let mut others = case.edge_cases.values(value_type::<RangeImage>().name);
    others.sort_by_key(|value| {
        std::cmp::Reverse(value.get::<RangeImage>().map_or(0, RangeImage::n_valid))
    });
    for carry in entry.carries() {
        let Some(fate) = carry.cells else { continue };
        let Some(at) = node.outputs.iter().position(|name| *name == carry.output) else { continue };
        let slots = node.links.iter().enumerate().filter(|(_, link)| link.port == carry.port);
        let slots: Vec<_> = slots.map(|(slot, _)| slot).collect();
        let is_range = slots.iter().all(|&slot| good[slot].get::<RangeImage>().is_some());
        let ranges = if is_range { vec![None] } else { others.iter().map(Some).collect() };
        for range in ranges {
            let (mut given, mut count) = (good.clone(), 0);
            for &slot in &slots {
                let value = range.unwrap_or(&good[slot]);
                let marked =
                    value.get::<RangeImage>().and_then(|range| mark_cells(range, &mut count));
                given[slot] = marked.unwrap_or_else(|| value.clone());
            }
            let Ok(Some(made)) = evaluate_node(node, &given, Progress::silent()) else { continue };
            for why in violations(count, fate, carry.own, &made[at]) {
                let (name, port, output, fate) =
                    (&entry.name, carry.port, carry.output, fate.word());
                broken.push(format!("{name}: attributes of each cell from `{port}` to `{output}` are not {fate}: {why}"));
            }
            break;
        }
    }
}

/// Returns a copy of a range image whose cells are numbered. The numbers start after `count`, which is increased by the number of cells.
fn mark_cells(range: &RangeImage, count: &mut u32) -> Option<AnyValue> {
    let cells = u32::try_from(range.points().len()).ok()?;
    let numbers = *count + 1..=*count + cells;
    *count += cells;
    let range = range.clone().with_colors(numbers.clone().map(color).collect()).ok()?;
    let range = range.with_filled(numbers.clone().map(filled_flag).collect()).ok()?;
    Some(AnyValue::new(range.with_joined(numbers.map(joined_code).collect()).ok()?))
}

/// Returns the color whose bytes encode a number.
fn color(number: u32) -> Rgb {
    let [a, b, c, _] = number.to_le_bytes();
    [a, b, c]
}

fn filled_flag(number: u32) -> u8 {
    (number / 2 % 2) as u8
}

/// Returns the code for the triangles in a cell (one of the two, or none), computed from the cell's number.
fn joined_code(number: u32) -> u8 {
    (number / 4 % 3) as u8
}

/// Returns the contradictions between the result `made` and the handling `fate` that the node declares for `count` numbered cells. `own`
/// are attributes that the node creates itself.
fn violations(count: u32, fate: Transfer, own: &[&str], made: &AnyValue) -> Vec<String> {
    let (range, mesh) = (made.get::<RangeImage>(), made.get::<Mesh>());
    let at_vertices = mesh.and_then(|mesh| mesh.vertex().colors("color"));
    let colors = range.and_then(RangeImage::colors).or(at_vertices.map(|colors| &colors[..]));
    let Some(colors) = colors else {
        return match fate {
            Transfer::Dropped => Vec::new(),
            _ => vec!["`color` is gone".into()],
        };
    };
    match fate {
        // A range image must not have the color, but a mesh may have one from another input.
        Transfer::Dropped => range.map(|_| "`color` is there".into()).into_iter().collect(),
        Transfer::Interpolated => {
            let is_new = !(0..3).all(|part: usize| {
                let given = (1..=count).map(|number| color(number)[part]);
                let (low, high) = (given.clone().min().unwrap_or(0), given.max().unwrap_or(0));
                colors.iter().all(|color| low <= color[part] && color[part] <= high)
            });
            is_new.then(|| "`color` is outside".into()).into_iter().collect()
        }
        Transfer::Kept => {
            let numbers: Vec<_> =
                colors.iter().map(|&[a, b, c]| u32::from_le_bytes([a, b, c, 0])).collect();
            if !numbers.iter().all(|number| (1..=count).contains(number)) {
                return vec!["`color` is mixed".into()];
            }
            let flags = match mesh.and_then(|mesh| mesh.vertex().get("filled")) {
                Some(Attribute::Flag(flags)) => Some(flags),
                _ => None,
            };
            let is_filled = |at: usize| match range {
                Some(range) => u8::from(range.is_filled(at)),
                None => flags.map_or(0, |flags| flags[at]),
            };
            fn follows(
                name: &str,
                found: &dyn Fn(usize) -> u8,
                mark: fn(u32) -> u8,
                numbers: &[u32],
                own: &[&str],
            ) -> Option<String> {
                let is_wrong = !own.contains(&name)
                    && numbers.iter().enumerate().any(|(at, &number)| found(at) != mark(number));
                is_wrong.then(|| format!("`{name}` is of another cell"))
            }
            let joins = range.and_then(|range| {
                follows("joined", &|at| range.forced_triangles(at), joined_code, &numbers, own)
            });
            follows("filled", &is_filled, filled_flag, &numbers, own)
                .into_iter()
                .chain(joins)
                .collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    /// Numbers two by three cells, changes them, and returns the contradictions to the handling `fate`.
    fn violations_after(
        fate: Transfer,
        change: impl FnOnce(RangeImage) -> RangeImage,
    ) -> Vec<String> {
        let range = RangeImage::new(2, 3, vec![Point3::new(0.0, 0.0, 9.0); 6]).unwrap();
        let mut count = 0;
        let marked = mark_cells(&range, &mut count).unwrap();
        let changed = change(marked.get::<RangeImage>().unwrap().clone());
        violations(count, fate, &[], &AnyValue::new(changed))
    }

    #[test]
    fn unchanged_cells_are_kept() {
        assert_eq!(violations_after(Transfer::Kept, |range| range), [""; 0]);
        assert_eq!(violations_after(Transfer::Interpolated, |range| range), [""; 0]);
        assert_eq!(violations_after(Transfer::Dropped, |range| range), ["`color` is there"]);
    }

    #[test]
    fn a_changed_cell_attribute_is_found() {
        fn drop_attributes(range: RangeImage) -> RangeImage {
            RangeImage::new(2, 3, range.points().to_vec()).unwrap()
        }
        assert_eq!(violations_after(Transfer::Kept, drop_attributes), ["`color` is gone"]);
        assert_eq!(violations_after(Transfer::Dropped, drop_attributes), [""; 0]);
        fn mix_colors(range: RangeImage) -> RangeImage {
            range.with_colors(vec![[9, 1, 0]; 6]).unwrap()
        }
        assert_eq!(violations_after(Transfer::Kept, mix_colors), ["`color` is mixed"]);
        assert_eq!(violations_after(Transfer::Interpolated, mix_colors), ["`color` is outside"]);
        fn clear_filled(range: RangeImage) -> RangeImage {
            range.with_filled(vec![0; 6]).unwrap()
        }
        assert_eq!(violations_after(Transfer::Kept, clear_filled), ["`filled` is of another cell"]);
        fn clear_joined(range: RangeImage) -> RangeImage {
            range.with_joined(vec![0; 6]).unwrap()
        }
        assert_eq!(violations_after(Transfer::Kept, clear_joined), ["`joined` is of another cell"]);
    }
}
