//! Removes isolated points.

use maquette_base::tree::Tree;
use maquette_node::{CancelledError, Carry, Context, Error, In, Node, Progress, Transfer, bail};
use maquette_scan::Scan;
use maquette_value::parallel::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Removes stray points of a scan: points that have no other points near them.
///
/// For a mesh, the vertices are tested, and a face is removed if one of its corners is removed; for a range image, the cells with points
/// are tested. All other data keeps its attributes. `Pieces` removes whole stray pieces, `FlyingPixels` removes points at silhouettes.
///
/// In other programs: statistical outlier removal.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct RemoveOutliers {
    /// The scan: a mesh, points or a range image.
    pub mesh: In<Scan>,
    /// Rule for isolated points.
    #[serde(default)]
    pub by: Outliers,
}

/// A rule by which isolated points are found.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Outliers {
    /// By the mean distance to the nearest points, compared with that of all points. Requires no length.
    Spread {
        /// Number of nearest points to which the distance is measured.
        #[schemars(range(min = 1, max = 1000))]
        #[serde(default = "default_spread_neighbors")]
        neighbors: u32,
        /// A point is removed if its mean distance exceeds the mean of all by more than this number of standard deviations.
        #[schemars(range(min = 0.0))]
        #[serde(default = "default_ratio")]
        ratio: f64,
    },
    /// By the number of neighbors within a radius.
    Radius {
        /// The radius in mm.
        #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
        radius: f64,
        /// A point with fewer neighbors within the radius is removed.
        #[schemars(range(min = 1, max = 1000))]
        #[serde(default = "default_radius_neighbors")]
        neighbors: u32,
    },
}

fn default_spread_neighbors() -> u32 {
    20
}

fn default_ratio() -> f64 {
    2.0
}

fn default_radius_neighbors() -> u32 {
    5
}

impl Default for Outliers {
    fn default() -> Self {
        Self::Spread { neighbors: default_spread_neighbors(), ratio: default_ratio() }
    }
}

impl Node for RemoveOutliers {
    type Outputs = (Scan,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const CARRIES: &'static [Carry] =
        &[Carry::uniform("mesh", "mesh", Transfer::Kept).and_cells(Transfer::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let scan = cx.get(&self.mesh);
        let apart = outliers(&scan, self.by, cx.progress())?;
        let kept = scan.select(&apart.iter().map(|apart| !apart).collect::<Vec<_>>());
        if kept.count() == 0 && scan.count() > 0 {
            let help = match self.by {
                Outliers::Spread { .. } => "choose a larger `ratio`",
                Outliers::Radius { .. } => "choose a larger `radius` or fewer `neighbors`",
            };
            let (count, elements) = (scan.positions().len(), scan.elements());
            cx.warn(format!("all {count} {elements} were removed; {help}"));
        }
        Ok((kept,))
    }
}

/// Returns, for each point of a scan, true if it is isolated. A cell without a point is not isolated.
///
/// `Spread` is the statistical removal of Rusu, Marton, Blodow, Dolha and Beetz, "Towards 3D point cloud based object maps for household
/// environments" (2008), section 4.1. The cost is O(n log n).
///
/// # Errors
/// Returns an error if a parameter is out of range, or the evaluation is cancelled.
pub fn outliers(scan: &Scan, by: Outliers, progress: &Progress<'_>) -> Result<Vec<bool>, Error> {
    let (Outliers::Spread { neighbors, .. } | Outliers::Radius { neighbors, .. }) = by;
    if !(1..=1000).contains(&neighbors) {
        bail!("`neighbors` is {neighbors}, but must be from 1 to 1000");
    }
    match by {
        Outliers::Spread { ratio, .. } if ratio.is_nan() || ratio < 0.0 => {
            bail!("`ratio` is {ratio}, but must be a number from 0 on");
        }
        Outliers::Radius { radius, .. } if radius.is_nan() || radius <= 0.0 => {
            bail!("`radius` is {radius} mm, but must be a number above 0");
        }
        _ => {}
    }
    let places = scan.positions();
    let there: Vec<_> = (0..places.len()).filter(|&place| !places[place].x.is_nan()).collect();
    let points: Vec<_> = there.iter().map(|&place| places[place]).collect();
    let tree = Tree::new(&points);
    progress.tick(0.2)?;
    // Search one more point than requested, because each point is its own nearest neighbor.
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

/// Number of points that are processed between two checks for cancellation.
const BATCH: usize = 1 << 15;

/// Returns the result of `see` for each point. `see` gets the squared distances to the point's `count` nearest points; the nearest one is
/// the point itself.
fn of_each<T: Copy + Default + Send>(
    tree: &Tree,
    count: usize,
    progress: &Progress<'_>,
    see: impl Fn(&[f64]) -> T + Sync,
) -> Result<Vec<T>, CancelledError> {
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
    use maquette_value::rng::Random;
    use maquette_value::{Attribute, Faces, Mesh, Points, RangeImage};
    use nalgebra::Point3;

    use super::*;

    /// Returns a sheet of points 1 mm apart, and three stray points.
    fn cloud() -> Vec<Point3<f64>> {
        let sheet = (0..400).map(|k| Point3::new(f64::from(k % 20), f64::from(k / 20), 0.0));
        let mut cloud = Vec::from_iter(sheet);
        cloud.insert(100, Point3::new(10.0, 10.0, 8.0));
        cloud.extend([Point3::new(-9.0, 3.0, 1.0), Point3::new(30.0, 3.0, 1.0)]);
        cloud
    }

    const FLYING: [usize; 3] = [100, 401, 402];

    fn stray_points(scan: &Scan, by: Outliers) -> Vec<usize> {
        let apart = outliers(scan, by, &Progress::silent()).unwrap();
        (0..apart.len()).filter(|&place| apart[place]).collect()
    }

    #[test]
    fn stray_points_are_removed_and_the_rest_keeps_its_attributes() {
        let numbers = Attribute::Index((0..403).collect());
        let points = Points::new(cloud()).and_then(|it| it.with_attribute("number", numbers));
        let scan = Scan::Points(points.unwrap());
        for by in [Outliers::default(), Outliers::Radius { radius: 1.5, neighbors: 2 }] {
            assert_eq!(stray_points(&scan, by), FLYING, "{by:?}");
        }
        let kept = outliers(&scan, Outliers::default(), &Progress::silent()).unwrap();
        let kept = scan.select(&kept.iter().map(|apart| !apart).collect::<Vec<_>>());
        let Scan::Points(points) = kept else { panic!("points") };
        let Some(Attribute::Index(numbers)) = points.attributes().get("number") else { panic!() };
        assert_eq!((numbers.len(), numbers[100]), (400, 101));
    }

    #[test]
    fn the_spread_is_the_mean_and_the_deviation_of_the_formula() {
        // The points are on a line. With two neighbors, the mean distances are 1.5, 1, 1, 1, 1.5 and 8.5.
        let line = [0.0, 1.0, 2.0, 3.0, 4.0, 12.0].map(|x| Point3::new(x, 0.0, 0.0));
        let scan = Scan::Points(Points::new(line.to_vec()).unwrap());
        // The mean of these distances is 2.4167 and their standard deviation 2.9903; so 8.5 is 2.0343 deviations above the mean.
        fn spread(ratio: f64) -> Outliers {
            Outliers::Spread { neighbors: 2, ratio }
        }
        assert_eq!(stray_points(&scan, spread(2.034)), [5]);
        assert!(stray_points(&scan, spread(2.035)).is_empty());
    }

    #[test]
    fn cells_and_vertices_go_as_points_do() {
        let mut points = cloud();
        points.push(Point3::new(f64::NAN, 0.0, 0.0));
        let range = RangeImage::new(101, 4, points).unwrap();
        assert_eq!(stray_points(&Scan::RangeImage(range), Outliers::default()), FLYING);
        let faces = vec![[0, 1, 21], [100, 3, 4], [401, 402, 7]];
        let mesh = Scan::Mesh(Mesh::new(cloud(), Faces::triangles(faces)).unwrap());
        assert_eq!(stray_points(&mesh, Outliers::default()), FLYING);
        let kept = outliers(&mesh, Outliers::default(), &Progress::silent()).unwrap();
        assert_eq!(mesh.select(&kept.iter().map(|apart| !apart).collect::<Vec<_>>()).count(), 1);
    }

    #[test]
    fn few_and_equal_points_stay_and_invalid_numbers_are_errors() {
        fn scan(points: Vec<Point3<f64>>) -> Scan {
            Scan::Points(Points::new(points).unwrap())
        }
        for count in [0, 1, 2, 50] {
            assert!(
                stray_points(&scan(vec![Point3::origin(); count]), Outliers::default()).is_empty()
            );
        }
        fn run(by: Outliers) -> String {
            outliers(&scan(cloud()), by, &Progress::silent()).unwrap_err().to_string()
        }
        assert_eq!(
            run(Outliers::Spread { neighbors: 0, ratio: 1.0 }),
            "`neighbors` is 0, but must be from 1 to 1000"
        );
        assert_eq!(
            run(Outliers::Spread { neighbors: 2, ratio: -1.0 }),
            "`ratio` is -1, but must be a number from 0 on"
        );
        fn radius(radius: f64) -> Outliers {
            Outliers::Radius { radius, neighbors: 2 }
        }
        assert_eq!(run(radius(0.0)), "`radius` is 0 mm, but must be a number above 0");
        assert_eq!(run(radius(f64::NAN)), "`radius` is NaN mm, but must be a number above 0");
    }

    #[test]
    fn the_same_go_for_any_number_of_threads() {
        let mut random = Random(4);
        let points = (0..70_000).map(|_| Point3::from([0; 3].map(|_| random.even())));
        let scan = Scan::Points(Points::new(Vec::from_iter(points)).unwrap());
        fn run(threads: usize, scan: &Scan) -> Vec<usize> {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| stray_points(scan, Outliers::default()))
        }
        let one = run(1, &scan);
        assert!(one.len() > 500 && [2, 3].iter().all(|&threads| run(threads, &scan) == one));
    }
}
