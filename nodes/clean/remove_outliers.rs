//! Takes away points that lie apart.

use maquette_base::tree::Tree;
use maquette_node::{Cancelled, Carry, Context, Error, Fate, In, Node, Progress};
use maquette_scan::Scan;
use maquette_value::parallel::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Takes away what flies around a scan: points that have no others near them.
///
/// Of a mesh vertices are judged, and a face goes if one of its corners does; of a range image the cells with points. What stays keeps its
/// attributes. Whole pieces that fly around are taken away by `Pieces`, what hangs at silhouettes by `FlyingPixels`.
///
/// In other programs: statistical outlier removal.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct RemoveOutliers {
    /// What is cleaned: a mesh, points or a range image.
    pub mesh: In<Scan>,
    /// How it is told what lies apart.
    #[serde(default)]
    pub by: Outliers,
}

/// How it is told what lies apart.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Outliers {
    /// By how far the nearest points are away, beside how far that is everywhere: no length must be known.
    Spread {
        /// To how many of the nearest points the distance is measured.
        #[schemars(range(min = 1, max = 1000))]
        #[serde(default = "twenty")]
        neighbors: u32,
        /// A point goes if its mean distance is above the mean of all by more than so many standard deviations.
        #[schemars(range(min = 0.0))]
        #[serde(default = "two")]
        ratio: f64,
    },
    /// By how many others are near.
    Radius {
        /// How near.
        #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
        radius: f64,
        /// A point goes if fewer others are so near.
        #[schemars(range(min = 1, max = 1000))]
        #[serde(default = "five")]
        neighbors: u32,
    },
}

fn twenty() -> u32 {
    20
}

fn two() -> f64 {
    2.0
}

fn five() -> u32 {
    5
}

impl Default for Outliers {
    fn default() -> Self {
        Self::Spread { neighbors: twenty(), ratio: two() }
    }
}

/// Why it cannot be told what lies apart.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum OutliersError {
    /// No neighbors, or too many.
    #[error("`neighbors` is {0}, but must be from 1 to 1000")]
    Neighbors(u32),
    /// A ratio that is none.
    #[error("`ratio` is {0}, but must be a number from 0 on")]
    Ratio(f64),
    /// A radius that is none.
    #[error("`radius` is {0} mm, but must be a number above 0")]
    Radius(f64),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl Node for RemoveOutliers {
    type Outputs = (Scan,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const CARRIES: &'static [Carry] =
        &[Carry::all("mesh", "mesh", Fate::Kept).and_cells(Fate::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let scan = cx.get(&self.mesh);
        let apart = outliers(&scan, self.by, cx.progress())?;
        let kept = scan.only(&apart.iter().map(|apart| !apart).collect::<Vec<_>>());
        if kept.count() == 0 && scan.count() > 0 {
            cx.warn(format!("nothing is left of {} {}", scan.places().len(), scan.elements()));
        }
        Ok((kept,))
    }
}

/// Which places of a scan lie apart. A cell without a point does not.
///
/// `Spread` is the statistical removal of Rusu, Marton, Blodow, Dolha and Beetz, "Towards 3D point cloud based object maps for household environments"
/// (2008), section 4.1. Cost grows with n log n.
///
/// # Errors
/// If a parameter is out of range, or the evaluation is told to stop.
pub fn outliers(
    scan: &Scan,
    by: Outliers,
    progress: &Progress<'_>,
) -> Result<Vec<bool>, OutliersError> {
    let (Outliers::Spread { neighbors, .. } | Outliers::Radius { neighbors, .. }) = by;
    if !(1..=1000).contains(&neighbors) {
        return Err(OutliersError::Neighbors(neighbors));
    }
    match by {
        Outliers::Spread { ratio, .. } if ratio.is_nan() || ratio < 0.0 => {
            return Err(OutliersError::Ratio(ratio));
        }
        Outliers::Radius { radius, .. } if radius.is_nan() || radius <= 0.0 => {
            return Err(OutliersError::Radius(radius));
        }
        _ => {}
    }
    let places = scan.places();
    let there: Vec<_> = (0..places.len()).filter(|&place| !places[place].x.is_nan()).collect();
    let points: Vec<_> = there.iter().map(|&place| places[place]).collect();
    let tree = Tree::new(&points);
    progress.tick(0.2)?;
    // Each point is the first of those near to itself.
    let count = neighbors as usize + 1;
    let mut apart = vec![false; places.len()];
    match by {
        Outliers::Spread { ratio, .. } => {
            let means = of_each(&tree, count, progress, |squares| {
                squares.iter().map(|square| square.sqrt()).sum::<f64>()
                    / (squares.len() - 1).max(1) as f64
            })?;
            let number = means.len().max(1) as f64;
            let mean = means.par_iter().copied().sum::<f64>() / number;
            let squares: f64 = means
                .par_iter()
                .map(|mean_of_one| (mean_of_one - mean) * (mean_of_one - mean))
                .sum();
            let most = mean + ratio * (squares / (number - 1.0).max(1.0)).sqrt();
            there.iter().zip(means).for_each(|(&place, mean)| apart[place] = most < mean);
        }
        Outliers::Radius { radius, .. } => {
            let is_lonely = of_each(&tree, count, progress, |squares| {
                squares.get(count - 1).is_none_or(|square| radius * radius < *square)
            })?;
            there.iter().zip(is_lonely).for_each(|(&place, is_lonely)| apart[place] = is_lonely);
        }
    }
    Ok(apart)
}

/// How many points are looked at before somebody may stop it.
const BATCH: usize = 1 << 15;

/// What `see` makes of the squared distances of each point to the `count` nearest, itself among them.
fn of_each<T: Copy + Default + Send>(
    tree: &Tree,
    count: usize,
    progress: &Progress<'_>,
    see: impl Fn(&[f64]) -> T + Sync,
) -> Result<Vec<T>, Cancelled> {
    let (mut seen, see) = (vec![T::default(); tree.points().len()], &see);
    for (batch, points) in tree.points().chunks(BATCH).enumerate() {
        progress.tick(0.2 + 0.8 * (batch * BATCH) as f64 / seen.len() as f64)?;
        let found: Vec<(u32, T)> = points
            .par_iter()
            .map_init(Vec::new, |squares: &mut Vec<f64>, (at, number)| {
                tree.nearest_squares(at, count, squares);
                (*number, see(squares))
            })
            .collect();
        found.into_iter().for_each(|(number, it)| seen[number as usize] = it);
    }
    Ok(seen)
}

#[cfg(test)]
mod tests {
    use maquette_value::random::Random;
    use maquette_value::{Attribute, Faces, Mesh, Points, RangeImage};
    use nalgebra::Point3;

    use super::*;

    /// A sheet of points 1 mm apart, and three that fly around.
    fn cloud() -> Vec<Point3<f64>> {
        let sheet = (0..400).map(|k| Point3::new(f64::from(k % 20), f64::from(k / 20), 0.0));
        let mut cloud = Vec::from_iter(sheet);
        cloud.insert(100, Point3::new(10.0, 10.0, 8.0));
        cloud.extend([Point3::new(-9.0, 3.0, 1.0), Point3::new(30.0, 3.0, 1.0)]);
        cloud
    }

    const FLYING: [usize; 3] = [100, 401, 402];

    fn apart(scan: &Scan, by: Outliers) -> Vec<usize> {
        let apart = outliers(scan, by, &Progress::none()).unwrap();
        (0..apart.len()).filter(|&place| apart[place]).collect()
    }

    #[test]
    fn what_flies_around_goes_and_the_rest_keeps_its_attributes() {
        let numbers = Attribute::Index((0..403).collect());
        let points = Points::new(cloud()).and_then(|it| it.with_attribute("number", numbers));
        let scan = Scan::Points(points.unwrap());
        for by in [Outliers::default(), Outliers::Radius { radius: 1.5, neighbors: 2 }] {
            assert_eq!(apart(&scan, by), FLYING, "{by:?}");
        }
        let kept = outliers(&scan, Outliers::default(), &Progress::none()).unwrap();
        let kept = scan.only(&kept.iter().map(|apart| !apart).collect::<Vec<_>>());
        let Scan::Points(points) = kept else { panic!("points") };
        let Some(Attribute::Index(numbers)) = points.attributes().get("number") else { panic!() };
        assert_eq!((numbers.len(), numbers[100]), (400, 101));
    }

    #[test]
    fn the_spread_is_the_mean_and_the_deviation_of_the_formula() {
        // On a line, with the two nearest: means of 1.5, 1, 1, 1, 1.5 and 8.5.
        let line = [0.0, 1.0, 2.0, 3.0, 4.0, 12.0].map(|x| Point3::new(x, 0.0, 0.0));
        let scan = Scan::Points(Points::new(line.to_vec()).unwrap());
        // Their mean is 2.4167 and their deviation 2.9903, so that 8.5 is 2.0343 deviations above.
        fn by(ratio: f64) -> Outliers {
            Outliers::Spread { neighbors: 2, ratio }
        }
        assert_eq!(apart(&scan, by(2.034)), [5]);
        assert!(apart(&scan, by(2.035)).is_empty());
    }

    #[test]
    fn cells_and_vertices_go_as_points_do() {
        let mut points = cloud();
        points.push(Point3::new(f64::NAN, 0.0, 0.0));
        let range = RangeImage::new(101, 4, points).unwrap();
        assert_eq!(apart(&Scan::RangeImage(range), Outliers::default()), FLYING);
        let faces = vec![[0, 1, 21], [100, 3, 4], [401, 402, 7]];
        let mesh = Scan::Mesh(Mesh::new(cloud(), Faces::triangles(faces)).unwrap());
        assert_eq!(apart(&mesh, Outliers::default()), FLYING);
        let kept = outliers(&mesh, Outliers::default(), &Progress::none()).unwrap();
        assert_eq!(mesh.only(&kept.iter().map(|apart| !apart).collect::<Vec<_>>()).count(), 1);
    }

    #[test]
    fn little_and_equal_points_stay_and_wrong_numbers_are_told() {
        fn of(points: Vec<Point3<f64>>) -> Scan {
            Scan::Points(Points::new(points).unwrap())
        }
        for count in [0, 1, 2, 50] {
            assert!(apart(&of(vec![Point3::origin(); count]), Outliers::default()).is_empty());
        }
        fn run(by: Outliers) -> OutliersError {
            outliers(&of(cloud()), by, &Progress::none()).unwrap_err()
        }
        assert_eq!(run(Outliers::Spread { neighbors: 0, ratio: 1.0 }), OutliersError::Neighbors(0));
        assert_eq!(run(Outliers::Spread { neighbors: 2, ratio: -1.0 }), OutliersError::Ratio(-1.0));
        fn radius(radius: f64) -> Outliers {
            Outliers::Radius { radius, neighbors: 2 }
        }
        assert_eq!(run(radius(0.0)), OutliersError::Radius(0.0));
        assert!(matches!(run(radius(f64::NAN)), OutliersError::Radius(_)));
    }

    #[test]
    fn the_same_go_for_any_number_of_threads() {
        let mut random = Random(4);
        let points = (0..70_000).map(|_| Point3::from([0; 3].map(|_| random.even())));
        let scan = Scan::Points(Points::new(Vec::from_iter(points)).unwrap());
        fn run(threads: usize, scan: &Scan) -> Vec<usize> {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| apart(scan, Outliers::default()))
        }
        let one = run(1, &scan);
        assert!(one.len() > 500 && [2, 3].iter().all(|&threads| run(threads, &scan) == one));
    }
}
