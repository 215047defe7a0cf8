//! How scans were moved to lie together, and how well they fit.

use maquette_value::{
    CaptureFrame, Column, DecodeError, Decoder, Encoder, Meaning, On, Part, Parts, PartsError,
    Summary, Value,
};
use nalgebra::{Isometry3, Matrix3, Matrix4};
use thiserror::Error;

/// How well two scans fit that were brought together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairFit {
    /// Which scans, from 1.
    pub scans: [u32; 2],
    /// Which part of each lies on the other, in percent.
    pub overlap: [f64; 2],
    /// Points of either that belong to points of the other.
    pub matches: u32,
    /// How far those are off the other's surface, in mm: root mean square.
    pub plane: f64,
    /// How far they are from the other's points, in mm: root mean square.
    pub point: f64,
}

/// Why numbers make no alignment.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum AlignmentError {
    /// A motion that is no turn and no move, or is not finite.
    #[error("the motion of scan {scan} is not rigid")]
    NotRigid {
        /// The scan, from 1.
        scan: usize,
    },
    /// A pair of scans that are not there.
    #[error("pair {pair} is of scans that are not there")]
    NoScan {
        /// The pair, from 1.
        pair: usize,
    },
}

/// How scans were moved to lie together, in mm, and how well they fit.
///
/// Invariant, checked by [`Alignment::new`]: motions are rigid, and pairs are of scans that are there.
#[derive(Clone, Debug, PartialEq)]
pub struct Alignment {
    motions: Column<[f64; 16]>,
    pairs: Vec<PairFit>,
    /// The axes in which they lie: those of this capture.
    frame: Option<Frame>,
}

/// What of a capture's frame holds for whatever was moved into it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Frame {
    picture: [usize; 2],
    depth: f64,
    pose: Option<[f64; 16]>,
}

impl Alignment {
    /// The motions of all scans, and the fits of those pairs that touch. With a frame everything lies in the axes of that capture.
    ///
    /// # Errors
    /// If a motion is not rigid, or a pair is of scans that are not there.
    pub fn new(
        motions: &[Matrix4<f64>],
        pairs: Vec<PairFit>,
        frame: Option<&CaptureFrame>,
    ) -> Result<Self, AlignmentError> {
        let numbers =
            |motion: &Matrix4<f64>| motion.data.0.as_flattened().try_into().expect("sixteen");
        if let Some(scan) = motions.iter().position(|motion| !is_rigid(motion)) {
            return Err(AlignmentError::NotRigid { scan: scan + 1 });
        }
        if let Some(pair) = pairs.iter().position(|pair| {
            !pair.scans.into_iter().all(|scan: u32| (1..=motions.len()).contains(&(scan as usize)))
        }) {
            return Err(AlignmentError::NoScan { pair: pair + 1 });
        }
        let frame = frame.map(|frame| Frame {
            picture: frame.picture,
            depth: frame.depth,
            pose: frame.world_from_camera.as_ref().map(numbers),
        });
        Ok(Self { motions: motions.iter().map(numbers).collect(), pairs, frame })
    }

    /// How many scans there are.
    pub fn count(&self) -> usize {
        self.motions.len()
    }

    /// How a scan was moved, from 1; none if there are not as many.
    pub fn motion(&self, scan: u32) -> Option<Matrix4<f64>> {
        let place = (scan as usize).checked_sub(1)?;
        self.motions.get(place).map(|numbers| Matrix4::from_column_slice(numbers))
    }

    /// How well those pairs fit that touch.
    pub fn pairs(&self) -> &[PairFit] {
        &self.pairs
    }

    /// The frame of the capture in whose axes everything lies, without its camera.
    pub fn frame(&self) -> Option<CaptureFrame> {
        self.frame.map(|Frame { picture, depth, pose }| CaptureFrame {
            camera: None,
            picture,
            depth,
            world_from_camera: pose.map(|numbers| Matrix4::from_column_slice(&numbers)),
        })
    }
}

/// Whether a matrix moves and turns, and does nothing else.
fn is_rigid(motion: &Matrix4<f64>) -> bool {
    let turn: Matrix3<f64> = motion.fixed_view::<3, 3>(0, 0).into();
    let off = (turn * turn.transpose() - Matrix3::identity()).amax();
    motion.iter().all(|x| x.is_finite())
        && off < 1e-9
        && turn.determinant() > 0.0
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
        let mut pair = || {
            Ok(PairFit {
                scans: from.plain()?,
                overlap: from.plain()?,
                matches: from.plain()?,
                plane: from.plain()?,
                point: from.plain()?,
            })
        };
        let pairs = (0..count).map(|_| pair()).collect::<Result<_, _>>()?;
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
        let summary = Summary::default().with("scans", self.count());
        self.pairs.iter().fold(summary, |summary, pair| {
            let [a, b] = pair.scans;
            let [on_b, on_a] = pair.overlap;
            let told = format!(
                "overlap {on_b:.1} % and {on_a:.1} %, {} matches, {:.4} mm off the surface, {:.4} mm off the points",
                pair.matches, pair.plane, pair.point
            );
            summary.with(&format!("scans {a} and {b}"), told)
        })
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.fact("scans", self.count());
        parts.fact("pairs", self.pairs.len());
        parts.push("motion", On::Entry, Meaning::Number, 16, self.motions.as_flattened());
        fn flat(f: &dyn Fn(&PairFit) -> Vec<f64>, pairs: &[PairFit]) -> Vec<f64> {
            pairs.iter().flat_map(f).collect::<Vec<_>>()
        }
        let scans: Vec<_> = self.pairs.iter().flat_map(|pair| pair.scans).collect();
        parts.push("pair", On::Edge, Meaning::Exact, 2, scans);
        parts.push(
            "overlap",
            On::Edge,
            Meaning::Number,
            2,
            flat(&|it| it.overlap.to_vec(), &self.pairs),
        );
        let matches: Vec<_> = self.pairs.iter().map(|pair| pair.matches).collect();
        parts.push("matches", On::Edge, Meaning::Exact, 1, matches);
        parts.push(
            "off surface",
            On::Edge,
            Meaning::Number,
            1,
            flat(&|it| vec![it.plane], &self.pairs),
        );
        parts.push(
            "off points",
            On::Edge,
            Meaning::Number,
            1,
            flat(&|it| vec![it.point], &self.pairs),
        );
        if let Some(Frame { picture: [width, height], depth, pose }) = self.frame {
            let numbers = vec![width as f64, height as f64, depth];
            parts.push("frame", On::Whole, Meaning::Number, 3, numbers);
            if let Some(pose) = pose {
                parts.push_aside("frame pose", On::Whole, Meaning::Number, 16, pose.to_vec());
            }
        }
        parts
    }

    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        fn matrix(numbers: [f64; 16]) -> Matrix4<f64> {
            Matrix4::from_column_slice(&numbers)
        }
        let motions = parts.need("motion", 16)?.elements::<16>()?.into_iter().map(matrix);
        let scans = parts.need("pair", 2)?;
        let count = scans.count();
        let whole = |part: &Part<'_>| part.with_count(count)?.whole();
        let numbers = |name: &str| {
            let part = parts.need(name, 1)?.with_count(count)?;
            Ok(part.elements::<1>()?.into_iter().flatten().collect::<Vec<f64>>())
        };
        let (scans, matches) = (whole(scans)?, whole(parts.need("matches", 1)?)?);
        let overlap = parts.need("overlap", 2)?.with_count(count)?.elements::<2>()?;
        let (plane, point) = (numbers("off surface")?, numbers("off points")?);
        let pose = parts.on(On::Whole, "frame pose").map(Part::only::<16>).transpose()?;
        let frame = parts.on(On::Whole, "frame").map(|part| {
            let [width, height, depth] = part.only()?;
            let size = |k: usize, x: f64| match (0.0..=f64::from(u32::MAX)).contains(&x)
                && x.fract() == 0.0
            {
                true => Ok(x as usize),
                false => Err(part.wrong(k, x, "a count")),
            };
            let picture = [size(0, width)?, size(1, height)?];
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
        Self::new(&Vec::from_iter(motions), pairs, frame.transpose()?.as_ref())
            .map_err(PartsError::refused)
    }

    /// Of no scan, of one that stays, and of some that go far.
    fn hostile() -> Vec<Self> {
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
