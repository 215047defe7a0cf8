//! Scans whose true places are known.

use std::cell::RefCell;

use maquette_mesh::{Motion, Movable, Poses, transform};
use maquette_node::Progress;
use maquette_scan::Scan;
use maquette_value::{Faces, Mesh, Points, RangeImage};
use nalgebra::{Isometry3, Matrix4, Point3, Translation3, UnitQuaternion, Vector3};

use super::*;

mod real;
mod shapes;

use shapes::{blob, moved_by, seen_from, sheet, sphere};

/// An alignment and what was doubted.
type Told = (Result<Alignment, AlignError>, Vec<String>);

fn aligned(scan: &Scan, to: &Scan, by: &By) -> Told {
    let doubts = RefCell::new(Vec::new());
    let alignment =
        align(scan, to, by, &|doubt| doubts.borrow_mut().push(doubt), &Progress::none());
    (alignment, doubts.into_inner())
}

fn all_aligned(scans: &[Scan], by: &Search) -> Told {
    let doubts = RefCell::new(Vec::new());
    let doubt = |doubt| doubts.borrow_mut().push(doubt);
    let scans = Vec::from_iter(scans);
    (align_all(&scans, by, &doubt, &Progress::none()), doubts.into_inner())
}

/// A motion that nobody would guess.
fn somewhere(seed: f64) -> Isometry3<f64> {
    let turn =
        UnitQuaternion::from_scaled_axis(Vector3::new(1.0 + seed, -0.7 * seed, 2.0 - 0.3 * seed));
    Isometry3::from_parts(Translation3::new(300.0 * seed, -150.0, 40.0 + seed), turn)
}

/// How far a motion brings places of a scan from where they should be, in mm: root mean square.
fn off(scan: &Scan, motion: &Matrix4<f64>, truth: &Isometry3<f64>) -> f64 {
    let places = || scan.places().iter().filter(|place| !place.x.is_nan());
    (places()
        .map(|place| (motion.transform_point(place) - truth * place).norm_squared())
        .sum::<f64>()
        / places().count() as f64)
        .sqrt()
}

/// As points without normals.
fn bare(scan: &Scan) -> Scan {
    Scan::Points(Points::new(scan.places().to_vec()).unwrap())
}

const NEAREST: By = By::Nearest { reach: 0.0, poses: Poses::Auto };

#[test]
fn scans_from_two_sides_come_together_without_a_hint() {
    let (front, side) =
        (seen_from(&blob(0.0), Vector3::z()), seen_from(&blob(0.4), Vector3::new(0.8, 0.3, 0.6)));
    for seed in [0.0, 1.0, 2.0] {
        let truth = somewhere(seed);
        let scan = moved_by(&side, &truth.inverse());
        for (scan, to) in
            [(scan.clone(), front.clone()), (bare(&scan), front.clone()), (scan, bare(&front))]
        {
            let (alignment, doubts) = aligned(&scan, &to, &By::Features);
            let alignment = alignment.unwrap();
            let motion = alignment.motion(2).unwrap();
            assert!(
                off(&scan, &motion, &truth) < 0.05,
                "{} {alignment:?}",
                off(&scan, &motion, &truth)
            );
            assert!(doubts.is_empty(), "{doubts:?}");
            let fit = alignment.pairs()[0];
            assert!(fit.overlap[0] > 40.0 && fit.plane < 0.05 && fit.matches > 500, "{fit:?}");
        }
    }
}

#[test]
fn scans_that_lie_almost_right_come_together() {
    let (front, side) =
        (seen_from(&blob(0.0), Vector3::z()), seen_from(&blob(0.4), Vector3::new(0.6, 0.0, 0.8)));
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.02, 0.05, -0.03));
    let truth = Isometry3::from_parts(Translation3::new(1.5, -1.0, 0.7), turn);
    let scan = moved_by(&side, &truth.inverse());
    let (alignment, doubts) = aligned(&scan, &front, &NEAREST);
    let motion = alignment.unwrap().motion(2).unwrap();
    assert!(off(&scan, &motion, &truth) < 0.05, "{}", off(&scan, &motion, &truth));
    assert!(doubts.is_empty(), "{doubts:?}");
}

#[test]
fn a_round_of_scans_closes() {
    let views = (0..6).map(|k| {
        let (s, c) = libm::sincos(f64::from(k) * std::f64::consts::TAU / 6.0);
        seen_from(&blob(0.3 * f64::from(k)), Vector3::new(s, 0.2, c))
    });
    let truths: Vec<_> = (0..6)
        .map(|k| if k == 0 { Isometry3::identity() } else { somewhere(f64::from(k)) })
        .collect();
    let scans = views
        .zip(&truths)
        .map(|(scan, truth)| moved_by(&scan, &truth.inverse()))
        .collect::<Vec<_>>();
    for by in [Search::Features, Search::Neighbors] {
        let (alignment, doubts) = all_aligned(&scans, &by);
        let alignment = alignment.unwrap();
        for (k, (scan, truth)) in scans.iter().zip(&truths).enumerate() {
            let motion = alignment.motion(k as u32 + 1).unwrap();
            assert!(off(scan, &motion, truth) < 0.05, "scan {k}: {}", off(scan, &motion, truth));
        }
        assert!(doubts.is_empty(), "{doubts:?}");
    }
}

#[test]
fn a_turntable_tells_where_scans_are() {
    let step = 40.0_f64.to_radians();
    let axis = Isometry3::from_parts(
        Translation3::new(5.0, 0.0, 300.0),
        UnitQuaternion::from_scaled_axis(Vector3::new(0.3, 0.0, 0.0)),
    );
    // What the scanner sees when the table is turned back by one step after the other.
    let truth =
        |k: usize| axis * Isometry3::rotation(Vector3::y() * (step * k as f64)) * axis.inverse();
    let scans: Vec<_> = (0..4)
        .map(|k: usize| {
            let (s, c) = libm::sincos(step * k as f64);
            let scan = seen_from(
                &blob(0.3 * k as f64),
                axis.rotation.inverse() * Vector3::new(0.0, 0.0, 0.0) + Vector3::new(s, 0.0, c),
            );
            moved_by(&scan, &(truth(k).inverse() * axis))
        })
        .collect();
    let direction = axis * Vector3::y();
    let known = Turntable {
        angle: 40.0,
        axis: Some((direction + Vector3::new(0.01, 0.0, 0.01)).into()),
        through: [5.5, 0.0, 299.0],
        reach: 0.0,
    };
    for table in [known, Turntable { axis: None, ..known }] {
        let (alignment, _) = all_aligned(&scans, &Search::Turntable(table));
        let alignment = alignment.unwrap();
        for (k, scan) in scans.iter().enumerate() {
            let motion = alignment.motion(k as u32 + 1).unwrap();
            assert!(
                off(scan, &motion, &truth(k)) < 0.05,
                "scan {k}: {}",
                off(scan, &motion, &truth(k))
            );
        }
    }
}

#[test]
fn picked_pairs_fix_a_motion() {
    let truth = somewhere(1.0);
    let scan = seen_from(&blob(0.0), Vector3::z());
    fn pick(at: [f64; 3], truth: &Isometry3<f64>) -> [[f64; 3]; 2] {
        [at, (*truth * Point3::from(at)).into()]
    }
    fn by(at: &[[f64; 3]], truth: &Isometry3<f64>) -> By {
        By::Pairs { pairs: at.iter().map(|&at| pick(at, truth)).collect() }
    }
    let enough = by(&[[0.0, 0.0, 40.0], [30.0, 0.0, 10.0], [0.0, 30.0, 10.0]], &truth);
    let alignment = aligned(&scan, &moved_by(&scan, &truth), &enough).0.unwrap();
    assert!(off(&scan, &alignment.motion(2).unwrap(), &truth) < 1e-9);
    let fit = alignment.pairs()[0];
    assert!(fit.matches == 3 && fit.point < 1e-9 && fit.overlap[0] > 80.0, "{fit:?}");
    fn error(at: &[[f64; 3]], scan: &Scan, truth: &Isometry3<f64>) -> String {
        aligned(scan, scan, &by(at, truth)).0.unwrap_err().to_string()
    }
    assert_eq!(
        error(&[[0.0; 3], [1.0; 3]], &scan, &truth),
        "there are 2 pairs of points, but at least 3 are needed"
    );
    let line = error(&[[0.0; 3], [10.0; 3], [20.0; 3]], &scan, &truth);
    assert!(line.starts_with("the points of the pairs lie on a line"), "{line}");
    // A mirrored scan, and one in another unit.
    let picked = [[0.0, 0.0, 40.0], [30.0, 0.0, 10.0], [0.0, 30.0, 10.0], [-20.0, -10.0, 5.0]];
    for scale in [[-1.0, 1.0, 1.0], [0.001; 3]] {
        let by = By::Pairs {
            pairs: picked
                .map(|at: [f64; 3]| [at, std::array::from_fn(|axis| at[axis] * scale[axis])])
                .to_vec(),
        };
        let told = aligned(&scan, &scan, &by).0.unwrap_err().to_string();
        assert!(told.starts_with("the pairs contradict each other: "), "{told}");
    }
}

#[test]
fn what_slides_stays_where_nothing_holds_it() {
    let up = Isometry3::translation(0.0, 0.0, 0.4);
    let slid = Isometry3::translation(3.0, 2.0, 0.4);
    let (alignment, doubts) = aligned(&moved_by(&sheet(), &slid), &sheet(), &NEAREST);
    let motion = alignment.unwrap().motion(2).unwrap();
    assert!((motion - up.inverse().to_homogeneous()).amax() < 1e-6, "{motion}");
    assert!(doubts[0].starts_with("in 3 of 6 ways nothing holds the scans"), "{doubts:?}");

    let turned = Isometry3::rotation(Vector3::new(0.1, 0.05, 0.0));
    let moved = Isometry3::translation(0.5, -0.3, 0.2) * turned;
    let (alignment, doubts) = aligned(&moved_by(&sphere(), &moved), &sphere(), &NEAREST);
    let motion = alignment.unwrap().motion(2).unwrap();
    let middle = motion.transform_point(&(moved * Point3::origin()));
    assert!(middle.coords.norm() < 0.02, "{middle}");
    assert!(doubts[0].starts_with("in 3 of 6 ways nothing holds the scans"), "{doubts:?}");
}

#[test]
fn scans_that_do_not_fit_are_refused_with_numbers() {
    let (front, back) = (seen_from(&blob(0.0), Vector3::z()), seen_from(&blob(0.4), -Vector3::z()));
    let mirrored = {
        let motion = Motion::new([0.0; 3], [0.0; 3], [-1.0, 1.0, 1.0]).unwrap();
        let Scan::Mesh(mesh) = &front else { panic!("a mesh") };
        match transform(&Movable::Mesh(mesh.clone()), &motion) {
            Ok(Movable::Mesh(mesh)) => Scan::Mesh(mesh),
            other => panic!("a mesh became {other:?}"),
        }
    };
    for wrong in [back, mirrored] {
        let wrong = moved_by(&wrong, &somewhere(1.0));
        let error = aligned(&wrong, &front, &By::Features).0.unwrap_err();
        assert!(matches!(error, AlignError::NoFit { .. }), "{error}");
    }
    let far = moved_by(&front, &Isometry3::translation(500.0, 0.0, 0.0));
    let error = aligned(&far, &front, &NEAREST).0.unwrap_err();
    assert!(matches!(error, AlignError::Apart { scan: 2, .. }), "{error}");
    let nearest = Search::Nearest { reach: 0.0, poses: Poses::Auto };
    let islands = [front.clone(), front.clone(), far.clone(), far];
    let error = all_aligned(&islands, &nearest).0.unwrap_err();
    assert!(matches!(error, AlignError::Apart { scan: 3, .. }), "{error}");
}

#[test]
fn bad_scans_are_errors() {
    let good = seen_from(&blob(0.0), Vector3::z());
    let nothing = Point3::new(f64::NAN, f64::NAN, f64::NAN);
    let empty = Scan::RangeImage(RangeImage::new(4, 4, vec![nothing; 16]).unwrap());
    let one = Scan::Points(Points::new(vec![Point3::new(1.0, 2.0, 3.0); 50]).unwrap());
    for (bad, count) in [(empty, 0), (one, 1)] {
        let error = aligned(&bad, &good, &By::Features).0.unwrap_err();
        assert_eq!(error, AlignError::TooFewPoints { scan: 2, points: count, least: 6 });
    }
    assert_eq!(
        all_aligned(std::slice::from_ref(&good), &Search::Features).0,
        Err(AlignError::TooFewScans { count: 1 })
    );
    let by = By::Nearest { reach: f64::NAN, poses: Poses::Auto };
    assert!(matches!(
        aligned(&good, &good, &by).0,
        Err(AlignError::Parameter { what: "reach", .. })
    ));
    let by = By::Nearest { reach: 0.0, poses: Poses::Apply };
    assert_eq!(aligned(&good, &good, &by).0, Err(AlignError::NoPose { scan: 1 }));
}

#[test]
fn a_scan_lies_on_itself_already() {
    let scan = seen_from(&blob(0.0), Vector3::z());
    for by in [By::Features, NEAREST] {
        let (alignment, doubts) = aligned(&scan, &scan, &by);
        let alignment = alignment.unwrap();
        assert!(off(&scan, &alignment.motion(2).unwrap(), &Isometry3::identity()) < 1e-3);
        assert!(alignment.pairs()[0].overlap[0] > 80.0 && doubts.is_empty(), "{doubts:?}");
    }
}

#[test]
fn a_mesh_that_is_not_manifold_is_aligned_as_well() {
    let Scan::Mesh(mesh) = seen_from(&blob(0.0), Vector3::z()) else { panic!("a mesh") };
    let triangles = mesh.faces().as_triangles().unwrap();
    let twice = triangles.iter().chain(&triangles[100..200]).copied();
    let fins = (0..50).map(|k| [triangles[k][0], triangles[k][1], triangles[k + 300][2]]);
    let faces = Faces::triangles(twice.chain(fins).collect());
    let torn = Scan::Mesh(Mesh::new(mesh.positions().clone(), faces).unwrap());
    let truth = somewhere(2.0);
    let alignment =
        aligned(&moved_by(&torn, &truth.inverse()), &Scan::Mesh(mesh), &By::Features).0.unwrap();
    assert!(off(&moved_by(&torn, &truth.inverse()), &alignment.motion(2).unwrap(), &truth) < 0.05);
}

#[test]
fn any_number_of_threads_gives_the_same() {
    let (front, side) = (seen_from(&blob(0.0), Vector3::z()), seen_from(&blob(0.4), Vector3::x()));
    fn with(
        threads: usize,
        side: &Scan,
        front: &Scan,
    ) -> (Result<Alignment, AlignError>, Vec<String>) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| aligned(&moved_by(side, &somewhere(1.0)), front, &By::Features))
    }
    assert_eq!(with(1, &side, &front), with(3, &side, &front));
}
