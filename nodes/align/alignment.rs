//! The result of a registration: the motions of the scans and the quality of the fit.

use maquette_node::{Error, bail};
use maquette_value::{
    CaptureFrame, Column, DecodeError, Decoder, ElementKind, Encoder, Meaning, Part, Parts,
    PartsError, Summary, Value,
};
use nalgebra::{Isometry3, Matrix3, Matrix4};

/// The quality of the fit of two aligned scans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairFit {
    /// The numbers of the two scans, counted from 1.
    pub scans: [u32; 2],
    /// The fraction of each of the two scans that lies on the other scan, in percent.
    pub overlap: [f64; 2],
    /// The number of points of either scan that have a corresponding point on the other scan.
    pub matches: u32,
    /// The root mean square distance of the corresponding points from the other scan's surface, in mm.
    pub plane: f64,
    /// The root mean square distance between corresponding points, in mm.
    pub point: f64,
}

/// The motions of scans, in mm, and the quality of their fit.
///
/// Invariant, checked by [`Alignment::new`]: motions are rigid, and the scans of all pairs exist.
#[derive(Clone, Debug, PartialEq)]
pub struct Alignment {
    motions: Column<[f64; 16]>,
    pairs: Vec<PairFit>,
    /// The frame of the capture whose axes the aligned scans use; `None` if they belong to no capture.
    frame: Option<Frame>,
}

/// The part of a capture's frame that is valid for all data moved into the axes of the capture.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Frame {
    picture: [usize; 2],
    depth: f64,
    pose: Option<[f64; 16]>,
}

impl Alignment {
    /// Creates an alignment from the motions of all scans and the fits of the overlapping pairs. If a frame is given, the aligned scans use
    /// the axes of its capture.
    ///
    /// # Errors
    /// If a motion is not rigid, or a pair has an unknown scan.
    pub fn new(
        motions: &[Matrix4<f64>],
        pairs: Vec<PairFit>,
        frame: Option<&CaptureFrame>,
    ) -> Result<Self, Error> {
        if let Some(scan) = motions.iter().position(|motion| !is_rigid(motion)) {
            bail!("the motion of scan {} is not rigid", scan + 1);
        }
        if let Some(pair) = pairs.iter().position(|pair| {
            !pair.scans.into_iter().all(|scan: u32| (1..=motions.len()).contains(&(scan as usize)))
        }) {
            bail!("pair {} has an unknown scan", pair + 1);
        }
        let frame = frame.map(|frame| Frame {
            picture: frame.picture,
            depth: frame.depth,
            pose: frame.world_from_camera.as_ref().map(matrix_entries),
        });
        Ok(Self { motions: motions.iter().map(matrix_entries).collect(), pairs, frame })
    }

    /// The number of scans.
    pub fn count(&self) -> usize {
        self.motions.len()
    }

    /// Returns the motion of a scan. `scan` counts from 1; the result is `None` if there is no such scan.
    pub fn motion(&self, scan: u32) -> Option<Matrix4<f64>> {
        let index = (scan as usize).checked_sub(1)?;
        self.motions.get(index).map(|numbers| Matrix4::from_column_slice(numbers))
    }

    /// The quality of the fit for each overlapping pair.
    pub fn pairs(&self) -> &[PairFit] {
        &self.pairs
    }

    /// Returns the frame of the capture whose axes the aligned scans use, without its camera; `None` if the scans belong to no capture.
    pub fn frame(&self) -> Option<CaptureFrame> {
        self.frame.map(|Frame { picture, depth, pose }| CaptureFrame {
            camera: None,
            picture,
            depth,
            world_from_camera: pose.map(|numbers| Matrix4::from_column_slice(&numbers)),
        })
    }
}

/// The entries of a matrix, column by column.
fn matrix_entries(matrix: &Matrix4<f64>) -> [f64; 16] {
    matrix.data.0.as_flattened().try_into().expect("sixteen entries")
}

/// Returns true if a matrix is a rigid motion.
fn is_rigid(motion: &Matrix4<f64>) -> bool {
    let rotation: Matrix3<f64> = motion.fixed_view::<3, 3>(0, 0).into();
    let off = (rotation * rotation.transpose() - Matrix3::identity()).amax();
    motion.iter().all(|x| x.is_finite())
        && off < 1e-9
        && rotation.determinant() > 0.0
        && motion.row(3) == Matrix4::identity().row(3)
}

impl Value for Alignment {
    const NAME: &'static str = "Alignment";

    fn encode(&self, to: &mut Encoder) {
        to.column(&self.motions).counts(&[self.pairs.len()]);
        for pair in &self.pairs {
            to.plain(&pair.scans).plain(&pair.overlap).plain(&pair.matches);
            to.plain(&pair.plane).plain(&pair.point);
        }
        to.option(self.frame.as_ref(), |to, frame| {
            to.counts(&frame.picture).plain(&frame.depth);
            to.option(frame.pose.as_ref(), |to, pose| {
                to.plain(pose);
            });
        });
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let motions = from.column()?;
        let [count] = from.counts()?;
        let pairs = (0..count)
            .map(|_| {
                Ok(PairFit {
                    scans: from.plain()?,
                    overlap: from.plain()?,
                    matches: from.plain()?,
                    plane: from.plain()?,
                    point: from.plain()?,
                })
            })
            .collect::<Result<_, DecodeError>>()?;
        let frame = from.option(|from| {
            Ok(Frame {
                picture: from.counts()?,
                depth: from.plain()?,
                pose: from.option(Decoder::plain)?,
            })
        })?;
        Ok(Self { motions, pairs, frame })
    }

    fn size(&self) -> usize {
        self.motions.size() + size_of_val(&self.pairs[..])
    }

    fn describe(&self) -> Summary {
        let summary = Summary::default().with_fact("scans", self.count());
        self.pairs.iter().fold(summary, |summary, pair| {
            let [a, b] = pair.scans;
            let [on_b, on_a] = pair.overlap;
            let fit = format!(
                "overlap {on_b:.1} % and {on_a:.1} %, {} matches, {:.4} mm off the surface, {:.4} mm off the points",
                pair.matches, pair.plane, pair.point
            );
            summary.with_fact(&format!("scans {a} and {b}"), fit)
        })
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.fact("scans", self.count());
        parts.fact("pairs", self.pairs.len());
        parts.push("motion", ElementKind::Entry, Meaning::Number, 16, self.motions.as_flattened());
        fn flat(f: &dyn Fn(&PairFit) -> Vec<f64>, pairs: &[PairFit]) -> Vec<f64> {
            pairs.iter().flat_map(f).collect::<Vec<_>>()
        }
        let scans: Vec<_> = self.pairs.iter().flat_map(|pair| pair.scans).collect();
        parts.push("pair", ElementKind::Edge, Meaning::Exact, 2, scans);
        parts.push(
            "overlap",
            ElementKind::Edge,
            Meaning::Number,
            2,
            flat(&|it| it.overlap.to_vec(), &self.pairs),
        );
        let matches: Vec<_> = self.pairs.iter().map(|pair| pair.matches).collect();
        parts.push("matches", ElementKind::Edge, Meaning::Exact, 1, matches);
        parts.push(
            "off surface",
            ElementKind::Edge,
            Meaning::Number,
            1,
            flat(&|it| vec![it.plane], &self.pairs),
        );
        parts.push(
            "off points",
            ElementKind::Edge,
            Meaning::Number,
            1,
            flat(&|it| vec![it.point], &self.pairs),
        );
        if let Some(Frame { picture: [width, height], depth, pose }) = self.frame {
            let numbers = vec![width as f64, height as f64, depth];
            parts.push("frame", ElementKind::Whole, Meaning::Number, 3, numbers);
            if let Some(pose) = pose {
                parts.push_hidden(
                    "frame pose",
                    ElementKind::Whole,
                    Meaning::Number,
                    16,
                    pose.to_vec(),
                );
            }
        }
        parts
    }

    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        fn matrix(numbers: [f64; 16]) -> Matrix4<f64> {
            Matrix4::from_column_slice(&numbers)
        }
        let motions = parts.require("motion", 16)?.elements::<16>()?.into_iter().map(matrix);
        let scans = parts.require("pair", 2)?;
        let count = scans.count();
        let numbers = |name: &str| {
            let part = parts.require(name, 1)?.with_count(count)?;
            Ok(part.elements::<1>()?.into_iter().flatten().collect::<Vec<f64>>())
        };
        let scans = scans.to_u32()?;
        let matches = parts.require("matches", 1)?.with_count(count)?.to_u32()?;
        let overlap = parts.require("overlap", 2)?.with_count(count)?.elements::<2>()?;
        let (plane, point) = (numbers("off surface")?, numbers("off points")?);
        let pose =
            parts.find(ElementKind::Whole, "frame pose").map(Part::single::<16>).transpose()?;
        let frame = parts.find(ElementKind::Whole, "frame").map(|part| {
            let [width, height, depth] = part.single()?;
            for (k, x) in [width, height].into_iter().enumerate() {
                if !(0.0..=f64::from(u32::MAX)).contains(&x) || x.fract() != 0.0 {
                    return Err(part.number_error(k, x, "a count"));
                }
            }
            let picture = [width, height].map(|x| x as usize);
            Ok(CaptureFrame { camera: None, picture, depth, world_from_camera: pose.map(matrix) })
        });
        let pairs = (0..count)
            .map(|k: usize| PairFit {
                scans: [scans[2 * k], scans[2 * k + 1]],
                overlap: overlap[k],
                matches: matches[k],
                plane: plane[k],
                point: point[k],
            })
            .collect();
        Self::new(&motions.collect::<Vec<_>>(), pairs, frame.transpose()?.as_ref())
            .map_err(|error| PartsError::Invalid(error.to_string()))
    }

    /// Alignments of no scan, of one scan that does not move, and of several scans with large motions.
    fn edge_cases() -> Vec<Self> {
        let turned = Isometry3::rotation(nalgebra::Vector3::new(0.3, -2.0, 1.0)).to_homogeneous();
        let far = Matrix4::new_translation(&nalgebra::Vector3::new(1e300, -1e-300, 0.0));
        let frame = CaptureFrame {
            camera: None,
            picture: [400, 300],
            depth: 700.0,
            world_from_camera: Some(turned),
        };
        let pair =
            PairFit { scans: [1, 2], overlap: [0.0, 100.0], matches: 0, plane: 0.0, point: 1e300 };
        let still = Matrix4::identity();
        let lists = [
            (vec![], vec![], None),
            (vec![still], vec![], Some(&frame)),
            (vec![still, turned], vec![pair], None),
            (vec![far, still, turned], vec![pair; 3], Some(&frame)),
        ];
        let lists =
            lists.into_iter().map(|(motions, pairs, frame)| Self::new(&motions, pairs, frame));
        lists.flatten().collect()
    }
}
