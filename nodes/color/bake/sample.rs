//! Samples of captures at a texel: the colors that the captures show.

/// The color that a capture shows at a texel.
#[derive(Clone, Copy)]
pub(super) struct Sample {
    pub(super) texel: u32,
    pub(super) capture: u32,
    /// The weight of the sample relative to other samples at the texel.
    pub(super) weight: f32,
    /// Confidence that the capture sees the texel: 0 to 1.
    pub(super) sure: f32,
    pub(super) light: [f32; 3],
}

/// The mean of all captures at a texel.
#[derive(Clone, Copy, Default)]
pub(super) struct MeanColor {
    pub(super) light: [f64; 3],
    /// Confidence: 0 if no capture sees the texel, up to 1.
    pub(super) sure: f64,
}

/// Returns the weighted mean of the samples at a texel.
pub(super) fn weighted_mean<'a>(samples: impl Iterator<Item = &'a Sample>) -> MeanColor {
    let (mut sum, mut weight, mut sure) = ([0.0; 3], 0.0, 0.0_f64);
    for sample in samples {
        (0..3).for_each(|k| sum[k] += f64::from(sample.weight) * f64::from(sample.light[k]));
        weight += f64::from(sample.weight);
        sure = sure.max(f64::from(sample.sure));
    }
    match weight > 0.0 {
        true => MeanColor { light: sum.map(|sum| sum / weight), sure: (2.0 * sure).min(1.0) },
        false => MeanColor::default(),
    }
}
