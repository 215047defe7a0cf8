//! Law 11 for range images: what becomes of the attributes of their cells. Each cell's color tells its number, from which its flags follow.

use maquette_node::{Fate, Progress};
use maquette_value::{AnyValue, Attribute, Mesh, RangeImage, Rgb, value_type};

use super::extremes::Case;
use super::{inputs, made};

/// Checks what the node of an example declares of cells. Ports that take several types get range images for it.
pub(super) fn check(case: &Case<'_>, broken: &mut Vec<String>) {
    let (entry, node) = (case.entry, &case.graph.nodes()[case.index]);
    let Some(good) = inputs(node, case.values) else { return };
    // What is shown to nodes that take meshes as well must have enough points to be moved, or to be a surface.
    let mut others = case.hostile.values(value_type::<RangeImage>().name);
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
                let marked = value.get::<RangeImage>().and_then(|range| marked(range, &mut count));
                given[slot] = marked.unwrap_or_else(|| value.clone());
            }
            let Ok(Some(made)) = made(node, &given, Progress::none()) else { continue };
            for why in wrong(count, fate, carry.own, &made[at]) {
                let (name, port, output, fate) =
                    (&entry.name, carry.port, carry.output, fate.word());
                broken.push(format!("{name}: attributes of each cell from `{port}` to `{output}` are not {fate}: {why}"));
            }
            break;
        }
    }
}

/// A range image with marks at each cell, which are numbered on from those that were marked before.
fn marked(range: &RangeImage, count: &mut u32) -> Option<AnyValue> {
    let cells = u32::try_from(range.points().len()).ok()?;
    let numbers = *count + 1..=*count + cells;
    *count += cells;
    let range = range.clone().with_colors(numbers.clone().map(color).collect()).ok()?;
    let range = range.with_filled(numbers.clone().map(filled).collect()).ok()?;
    Some(AnyValue::new(range.with_joined(numbers.map(joined).collect()).ok()?))
}

/// The number in a color's bytes.
fn color(number: u32) -> Rgb {
    let [a, b, c, _] = number.to_le_bytes();
    [a, b, c]
}

fn filled(number: u32) -> u8 {
    (number / 2 % 2) as u8
}

/// One of the two triangles of one division, or none.
fn joined(number: u32) -> u8 {
    (number / 4 % 3) as u8
}

/// What speaks against a fate of so many marked cells; `own` are attributes that the node makes itself.
fn wrong(count: u32, fate: Fate, own: &[&str], made: &AnyValue) -> Vec<String> {
    let (range, mesh) = (made.get::<RangeImage>(), made.get::<Mesh>());
    let at_vertices = mesh.and_then(|mesh| mesh.vertex().colors("color"));
    let colors = range.and_then(RangeImage::colors).or(at_vertices.map(|colors| &colors[..]));
    let Some(colors) = colors else {
        return match fate {
            Fate::Dropped => Vec::new(),
            _ => vec!["`color` is gone".into()],
        };
    };
    match fate {
        // The color of a mesh may be another one's.
        Fate::Dropped => range.map(|_| "`color` is there".into()).into_iter().collect(),
        Fate::Interpolated => {
            let is_new = !(0..3).all(|part: usize| {
                let given = || (1..=count).map(|number| color(number)[part]);
                let (low, high) = (given().min().unwrap_or(0), given().max().unwrap_or(0));
                colors.iter().all(|color| low <= color[part] && color[part] <= high)
            });
            is_new.then(|| "`color` is outside".into()).into_iter().collect()
        }
        Fate::Kept => {
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
            let joins = range
                .and_then(|range| follows("joined", &|at| range.joined(at), joined, &numbers, own));
            follows("filled", &is_filled, filled, &numbers, own).into_iter().chain(joins).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    /// What the law says of two by three cells that are given marks and then changed.
    fn said(fate: Fate, change: impl FnOnce(RangeImage) -> RangeImage) -> Vec<String> {
        let range = RangeImage::new(2, 3, vec![Point3::new(0.0, 0.0, 9.0); 6]).unwrap();
        let mut count = 0;
        let marked = marked(&range, &mut count).unwrap();
        let changed = change(marked.get::<RangeImage>().unwrap().clone());
        wrong(count, fate, &[], &AnyValue::new(changed))
    }

    #[test]
    fn what_is_as_it_was_is_kept_and_not_dropped() {
        assert_eq!(said(Fate::Kept, |range| range), [""; 0]);
        assert_eq!(said(Fate::Interpolated, |range| range), [""; 0]);
        assert_eq!(said(Fate::Dropped, |range| range), ["`color` is there"]);
    }

    #[test]
    fn one_attribute_that_goes_another_way_is_found() {
        fn gone(range: RangeImage) -> RangeImage {
            RangeImage::new(2, 3, range.points().to_vec()).unwrap()
        }
        assert_eq!(said(Fate::Kept, gone), ["`color` is gone"]);
        assert_eq!(said(Fate::Dropped, gone), [""; 0]);
        fn mixed(range: RangeImage) -> RangeImage {
            range.with_colors(vec![[9, 1, 0]; 6]).unwrap()
        }
        assert_eq!(said(Fate::Kept, mixed), ["`color` is mixed"]);
        assert_eq!(said(Fate::Interpolated, mixed), ["`color` is outside"]);
        let unfilled = |range: RangeImage| range.with_filled(vec![0; 6]).unwrap();
        assert_eq!(said(Fate::Kept, unfilled), ["`filled` is of another cell"]);
        let apart = |range: RangeImage| range.with_joined(vec![0; 6]).unwrap();
        assert_eq!(said(Fate::Kept, apart), ["`joined` is of another cell"]);
    }
}
