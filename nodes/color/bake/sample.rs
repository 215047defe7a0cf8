//! What captures show at a texel.

/// What a capture shows at a texel.
#[derive(Clone, Copy)]
pub(super) struct Sample {
    pub(super) texel: u32,
    pub(super) capture: u32,
    /// How much it counts beside others.
    pub(super) weight: f32,
    /// How sure it is that it is seen at all: 0 to 1.
    pub(super) sure: f32,
    pub(super) light: [f32; 3],
}

/// What all captures together show of a texel.
#[derive(Clone, Copy, Default)]
pub(super) struct Mixed {
    pub(super) light: [f64; 3],
    /// From 0, nobody sees it, to 1.
    pub(super) sure: f64,
}

/// What some captures show of one texel, each as far as it counts.
pub(super) fn mix<'a>(samples: impl Iterator<Item = &'a Sample>) -> Mixed {
    let (mut sum, mut weight, mut sure) = ([0.0; 3], 0.0, 0.0_f64);
    for sample in samples {
        (0..3).for_each(|k| sum[k] += f64::from(sample.weight) * f64::from(sample.light[k]));
        weight += f64::from(sample.weight);
        sure = sure.max(f64::from(sample.sure));
    }
    match weight > 0.0 {
        true => Mixed { light: sum.map(|sum| sum / weight), sure: (2.0 * sure).min(1.0) },
        false => Mixed::default(),
    }
}
