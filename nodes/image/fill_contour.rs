//! Fills closed contours.

use maquette_node::{Context, Error, In, Node};
use maquette_value::Mask;
use maquette_value::parallel::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::connectivity::Connectivity;
use super::filter::morphology::close;
use super::segment::components::label;

/// Fills the contours of a mask: adds all enclosed pixels, which are those that cannot be reached from the border of the picture by steps
/// up, down, left and right.
///
/// If nothing is enclosed, gaps are closed first, see `close`. If still nothing is enclosed, the mask is unchanged, with a warning. An open
/// contour beside a closed one stays open.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct FillContour {
    /// Contours. Their pixels may be connected by corners only.
    pub mask: In<Mask>,
    /// Radius of the square that closes gaps if nothing is enclosed; 0 disables it.
    #[schemars(range(max = 50), extend("unit" = "px"))]
    #[serde(default = "default_radius")]
    pub close: u32,
}

fn default_radius() -> u32 {
    1
}

impl Node for FillContour {
    type Outputs = (Mask,);
    const OUTPUTS: [&'static str; 1] = ["mask"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mask = cx.get(&self.mask);
        let filled = fill_contour(mask, self.close as usize);
        if filled == *mask {
            cx.warn(match self.close {
                0 => "nothing is enclosed; use `close` to close gaps".to_owned(),
                radius => format!("nothing is enclosed, not even with gaps closed by {radius} px; use a larger `close`"),
            });
        }
        Ok((filled,))
    }
}

/// Fills `mask`: returns everything except the background that is connected by sides to the border of the picture. If `mask` encloses
/// nothing, its gaps are first closed with a square of the radius `radius`. If the result encloses nothing either, `mask` is returned.
pub fn fill_contour(mask: &Mask, radius: usize) -> Mask {
    fill(mask).or_else(|| fill(&close(mask, radius))).unwrap_or_else(|| mask.clone())
}

/// Returns the filled mask; `None` if `mask` encloses nothing.
fn fill(mask: &Mask) -> Option<Mask> {
    let (width, height) = (mask.width(), mask.height());
    fn make(pixels: Vec<bool>, width: usize, height: usize) -> Mask {
        Mask::from_bools(width, height, pixels).expect("as many pixels as before")
    }
    let outside = mask.pixels().par_iter().with_min_len(4096).map(|&inside| inside == 0);
    let parts = label(&make(outside.collect(), width, height), Connectivity::Four);
    let mut is_filled = vec![true];
    is_filled.extend(parts.statistics().iter().map(|part| !part.touches_border));
    if !is_filled[1..].contains(&true) {
        return None;
    }
    let filled = parts.pixels().par_iter().with_min_len(4096);
    Some(make(filled.map(|&part| is_filled[part as usize]).collect(), width, height))
}

#[cfg(test)]
mod tests {
    use expect_test::{Expect, expect};

    use super::super::outline::outline;
    use super::*;

    fn check(rows: &[&str], radius: usize, expected: Expect) {
        expected.assert_eq(&fill_contour(&Mask::from_rows(rows), radius).draw());
    }

    #[test]
    fn a_contour_connected_by_corners_is_closed() {
        check(
            &["..#..", ".#.#.", "#...#", ".#.#.", "..#.."],
            0,
            expect![[r#"
            ..#..
            .###.
            #####
            .###.
            ..#..
        "#]],
        );
    }

    #[test]
    fn a_gap_is_closed_if_nothing_is_enclosed() {
        let open = [".......", ".##.##.", ".#...#.", ".#...#.", ".#...#.", ".#####."];
        check(
            &open,
            0,
            expect![[r#"
                .......
                .##.##.
                .#...#.
                .#...#.
                .#...#.
                .#####.
            "#]],
        );
        check(
            &open,
            1,
            expect![[r#"
                .......
                .#####.
                .#####.
                .#####.
                .#####.
                .#####.
            "#]],
        );
    }

    #[test]
    fn an_open_line_stays_as_it_is() {
        let line = Mask::from_rows(&["#......", ".##....", "...####"]);
        assert_eq!(fill_contour(&line, 1), line);
    }

    #[test]
    fn the_outline_of_a_disk_fills_to_the_disk() {
        for radius in 1..25 {
            let pixels = (0..56).flat_map(|y: i32| {
                (0..60)
                    .map(move |x: i32| (x - 30) * (x - 30) + (y - 27) * (y - 27) <= radius * radius)
            });
            let disk = Mask::from_bools(60, 56, pixels.collect()).unwrap();
            assert_eq!(fill_contour(&outline(&disk), 0), disk, "{radius}");
        }
    }
}
