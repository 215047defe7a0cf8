//! Selects pixels of a picture by a color, by a box of colors, or by Otsu's method.

use maquette_node::{Context, Error, Forecast, In, Node, Sizes, ValueSize};
use maquette_value::{Color, Image, Mask};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::filter::morphology::{close, open};
use super::segment::mark_pixels::threshold;
use super::segment::select::{Measure, Select, measure};

/// Selects pixels by color or brightness, and returns them as a mask.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Threshold {
    /// Picture to search.
    pub image: In<Image>,
    /// Limits the search to these pixels. If omitted, the whole picture is searched.
    pub within: Option<In<Mask>>,
    /// Selection rule.
    pub select: Select,
    /// Inverts the mask.
    #[serde(default)]
    pub invert: bool,
    /// Radius of the square that removes specks (opening) and then closes gaps (closing); 0 disables both.
    #[schemars(range(max = 10), extend("unit" = "px"))]
    #[serde(default)]
    pub clean: u32,
}

impl Node for Threshold {
    type Outputs = (Mask,);
    const OUTPUTS: [&'static str; 1] = ["mask"];

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        let pixels = sizes.get(&self.image)?;
        Some(Forecast::by_law(ValueSize::items(pixels.points, 1.0).at_most(pixels.certainty)))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let image = cx.get(&self.image);
        let within = self.within.as_ref().map(|mask| cx.get(mask));
        let mask = threshold(image, within, &self.select, self.invert)?;
        if mask.is_empty() {
            cx.warn(explain_empty(image, within, &self.select)?);
        }
        let radius = self.clean as usize;
        Ok((close(&open(&mask, radius), radius),))
    }
}

/// Returns a warning text for an empty selection: the pixel that came closest to being selected, and its distance.
fn explain_empty(image: &Image, within: Option<&Mask>, select: &Select) -> Result<String, Error> {
    let (measure, limit) = measure(image, within, select)?;
    let distances = image.pixels().iter().map(|&pixel| measure.distance(pixel)).enumerate();
    let searched =
        distances.filter(|(index, _)| within.is_none_or(|mask| mask.pixels()[*index] == 1));
    let closest = searched.min_by(|a, b| a.1.total_cmp(&b.1));
    Ok(match (closest, &measure) {
        (None, _) => "nothing is selected: there are no pixels to search".into(),
        (Some(_), Measure::Level { .. }) => {
            "nothing is selected: all pixels have the same level".into()
        }
        (Some((index, distance)), _) => {
            let at = [index % image.width(), index / image.width()];
            format!(
                "nothing is selected: the closest pixel is {} at ({}, {}), at distance {:.1} where {limit:.1} is allowed",
                Color(image.pixel(at)),
                at[0],
                at[1],
                distance
            )
        }
    })
}

#[cfg(test)]
mod tests {
    use expect_test::{Expect, expect};

    use super::*;
    use crate::segment::select::{Channel, Space};

    /// Returns a picture drawn with one letter per pixel: r, g, b, w (white), k (black), p (pink).
    fn picture(rows: &[&str]) -> Image {
        let pixels = rows.iter().flat_map(|row| row.chars()).map(|letter| match letter {
            'r' => [255, 0, 0],
            'g' => [0, 255, 0],
            'b' => [0, 0, 255],
            'w' => [255, 255, 255],
            'p' => [255, 128, 160],
            _ => [0, 0, 0],
        });
        Image::new(rows[0].len(), rows.len(), pixels.collect::<Vec<_>>()).unwrap()
    }

    fn check(select: Select, rows: &[&str], expected: Expect) {
        expected.assert_eq(&threshold(&picture(rows), None, &select, false).unwrap().draw());
    }

    fn red(distance: f64, lightness: f64) -> Select {
        Select::Near { color: Color([255, 0, 0]), distance, lightness }
    }

    #[test]
    fn a_pixel_at_the_limit_is_near() {
        check(red(0.0, 1.0), &["rgr", "ggg"], expect![["#.#\n...\n"]]);
    }

    #[test]
    fn without_lightness_black_matches_white() {
        fn white(lightness: f64) -> Select {
            Select::Near { color: Color([255; 3]), distance: 1.0, lightness }
        }
        check(white(0.0), &["wk", "rk"], expect![["##\n.#\n"]]);
        check(white(1.0), &["wk", "rk"], expect![["#.\n..\n"]]);
    }

    #[test]
    fn a_sampled_pixel_selects_similar_pixels() {
        let select = Select::Sample { at: (1, 0), distance: 5.0, lightness: 1.0 };
        check(select, &["rgb", "gbr"], expect![[".#.\n#..\n"]]);
    }

    #[test]
    fn a_sampled_pixel_outside_is_an_error() {
        let select = Select::Sample { at: (3, 0), distance: 5.0, lightness: 1.0 };
        let error = threshold(&picture(&["rgb"]), None, &select, false).unwrap_err();
        expect!["pixel (3, 0) is outside the picture, which has 3 x 1 pixels"]
            .assert_eq(&error.to_string());
    }

    #[test]
    fn a_box_includes_its_sides() {
        fn select(low: [f64; 3], high: [f64; 3]) -> Select {
            Select::Box { space: Space::Rgb, low, high }
        }
        check(select([255., 0., 0.], [255., 128., 160.]), &["rpw"], expect![["##.\n"]]);
        check(select([255., 0., 0.], [255., 127., 160.]), &["rpw"], expect![["#..\n"]]);
    }

    #[test]
    fn a_box_holds_the_whole_numbers_between_its_sides() {
        let levels = (0..=255u8).map(|level| [level; 3]);
        let image = Image::new(256, 1, levels.collect::<Vec<_>>()).unwrap();
        for (low, high) in [
            (-5.0, 3.5),
            (3.5, 3.9),
            (254.5, 300.0),
            (-9.0, -1.0),
            (256.0, 300.0),
            (7.0, 5.0),
            (9.0, 9.0),
        ] {
            let select = Select::Box { space: Space::Rgb, low: [low; 3], high: [high; 3] };
            let expected =
                (0..256).filter(|level| low <= *level as f64 && *level as f64 <= high).count();
            let mask = threshold(&image, None, &select, false).unwrap();
            assert_eq!(mask.count(), expected, "{low} {high}");
            let others = threshold(&image, None, &select, true).unwrap();
            assert_eq!(others.count(), 256 - expected, "{low} {high}");
        }
    }

    #[test]
    fn a_hue_interval_wraps_around_and_never_holds_gray() {
        fn select(low: f64, high: f64) -> Select {
            Select::Box { space: Space::Hsv, low: [low, 0.0, 0.0], high: [high, 1.0, 1.0] }
        }
        check(select(330.0, 30.0), &["rgbpwk"], expect![["#..#..\n"]]);
        check(select(0.0, 360.0), &["rgbpwk"], expect![["####..\n"]]);
    }

    #[test]
    fn a_lab_box_takes_light_colors() {
        let select = Select::Box {
            space: Space::Lab,
            low: [60.0, -128.0, -128.0],
            high: [101.0, 128.0, 128.0],
        };
        check(select, &["rgbpwk"], expect![[".#.##.\n"]]);
    }

    #[test]
    fn otsu_takes_the_brighter_class() {
        check(Select::Otsu { channel: Channel::Luma }, &["kwkb"], expect![[".#..\n"]]);
    }

    #[test]
    fn inverting_stays_within_the_mask() {
        let within = Mask::from_rows(&["##."]);
        let mask = threshold(&picture(&["rgg"]), Some(&within), &red(0.0, 1.0), true).unwrap();
        assert_eq!(mask.draw(), ".#.\n");
    }

    #[test]
    fn an_empty_selection_names_the_nearest_pixel() {
        let message = explain_empty(&picture(&["gp"]), None, &red(5.0, 1.0)).unwrap();
        expect!["nothing is selected: the closest pixel is #ff80a0 at (1, 0), at distance 69.6 where 5.0 is allowed"]
            .assert_eq(&message);
    }

    #[test]
    fn a_mask_of_another_size_is_an_error() {
        let within = Mask::from_rows(&["##"]);
        let error = threshold(&picture(&["rgb"]), Some(&within), &red(5.0, 1.0), false);
        expect!["the mask `within` has [2, 1] pixels, but the picture has [3, 1]"]
            .assert_eq(&error.unwrap_err().to_string());
    }
}
