//! Registration of scans whose true motions are known.

use std::cell::RefCell;

use maquette_mesh::{Motion, Movable, Poses, transform};
use maquette_node::{Error, Progress};
use maquette_scan::Scan;
use maquette_value::{Faces, Mesh, Points, RangeImage};
use nalgebra::{Isometry3, Matrix4, Point3, Translation3, UnitQuaternion, Vector3};

use super::*;

mod real;
mod shapes;

use shapes::{blob, move_by, seen_from, sheet, sphere};

/// The result of a registration, and the warnings that it caused.
type AlignOutcome = (Result<Alignment, Error>, Vec<String>);

fn align_pair(scan: &Scan, to: &Scan, by: &AlignMethod) -> AlignOutcome {
    let warnings = RefCell::new(Vec::new());
    let alignment =
        align(scan, to, by, &|warning| warnings.borrow_mut().push(warning), &Progress::silent());
    (alignment, warnings.into_inner())
}

fn align_list(scans: &[Scan], by: &Search) -> AlignOutcome {
    let warnings = RefCell::new(Vec::new());
    let scans: Vec<_> = scans.iter().collect();
    let warn = |warning| warnings.borrow_mut().push(warning);
    let alignment = align_all(&scans, by, &warn, &Progress::silent());
    (alignment, warnings.into_inner())
}

/// Creates an arbitrary rigid motion; different seeds give different motions.
fn arbitrary_motion(seed: f64) -> Isometry3<f64> {
    let turn =
        UnitQuaternion::from_scaled_axis(Vector3::new(1.0 + seed, -0.7 * seed, 2.0 - 0.3 * seed));
    Isometry3::from_parts(Translation3::new(300.0 * seed, -150.0, 40.0 + seed), turn)
}

/// The root mean square distance between the positions of a scan after `motion` and after the true motion, in mm.
fn rms_error(scan: &Scan, motion: &Matrix4<f64>, truth: &Isometry3<f64>) -> f64 {
    let squares: Vec<f64> = scan
        .positions()
        .iter()
        .filter(|point| !point.x.is_nan())
        .map(|point| (motion.transform_point(point) - truth * point).norm_squared())
        .collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// Converts a scan to points without normals.
fn bare(scan: &Scan) -> Scan {
    Scan::Points(Points::new(scan.positions().to_vec()).unwrap())
}

const NEAREST: AlignMethod = AlignMethod::Nearest { reach: 0.0, poses: Poses::Auto };

#[test]
fn scans_from_two_sides_are_aligned_without_a_hint() {
    let (front, side) =
        (seen_from(&blob(0.0), Vector3::z()), seen_from(&blob(0.4), Vector3::new(0.8, 0.3, 0.6)));
    for seed in [0.0, 1.0, 2.0] {
        let truth = arbitrary_motion(seed);
        let scan = move_by(&side, &truth.inverse());
        for (scan, to) in
            [(scan.clone(), front.clone()), (bare(&scan), front.clone()), (scan, bare(&front))]
        {
            let (alignment, warnings) = align_pair(&scan, &to, &AlignMethod::Features);
            let alignment = alignment.unwrap();
            let motion = alignment.motion(2).unwrap();
            assert!(
                rms_error(&scan, &motion, &truth) < 0.05,
                "{} {alignment:?}",
                rms_error(&scan, &motion, &truth)
            );
            assert!(warnings.is_empty(), "{warnings:?}");
            let fit = alignment.pairs()[0];
            assert!(fit.overlap[0] > 40.0 && fit.plane < 0.05 && fit.matches > 500, "{fit:?}");
        }
    }
}

#[test]
fn scans_near_their_true_positions_are_aligned() {
    let (front, side) =
        (seen_from(&blob(0.0), Vector3::z()), seen_from(&blob(0.4), Vector3::new(0.6, 0.0, 0.8)));
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.02, 0.05, -0.03));
    let truth = Isometry3::from_parts(Translation3::new(1.5, -1.0, 0.7), turn);
    let scan = move_by(&side, &truth.inverse());
    let (alignment, warnings) = align_pair(&scan, &front, &NEAREST);
    let motion = alignment.unwrap().motion(2).unwrap();
    assert!(rms_error(&scan, &motion, &truth) < 0.05, "{}", rms_error(&scan, &motion, &truth));
    assert!(warnings.is_empty(), "{warnings:?}");
}

#[test]
fn a_loop_of_scans_closes() {
    let views = (0..6).map(|k| {
        let (s, c) = libm::sincos(f64::from(k) * std::f64::consts::TAU / 6.0);
        seen_from(&blob(0.3 * f64::from(k)), Vector3::new(s, 0.2, c))
    });
    let truths: Vec<_> = (0..6)
        .map(|k| if k == 0 { Isometry3::identity() } else { arbitrary_motion(f64::from(k)) })
        .collect();
    let scans = views
        .zip(&truths)
        .map(|(scan, truth)| move_by(&scan, &truth.inverse()))
        .collect::<Vec<_>>();
    for by in [Search::Features, Search::Neighbors] {
        let (alignment, warnings) = align_list(&scans, &by);
        let alignment = alignment.unwrap();
        for (k, (scan, truth)) in scans.iter().zip(&truths).enumerate() {
            let motion = alignment.motion(k as u32 + 1).unwrap();
            assert!(
                rms_error(scan, &motion, truth) < 0.05,
                "scan {k}: {}",
                rms_error(scan, &motion, truth)
            );
        }
        assert!(warnings.is_empty(), "{warnings:?}");
    }
}

#[test]
fn scans_of_a_turntable_are_aligned() {
    let step = 40.0_f64.to_radians();
    let axis = Isometry3::from_parts(
        Translation3::new(5.0, 0.0, 300.0),
        UnitQuaternion::from_scaled_axis(Vector3::new(0.3, 0.0, 0.0)),
    );
    // Scans of an object on a turntable that rotates backwards by `step` between scans.
    let truth =
        |k: usize| axis * Isometry3::rotation(Vector3::y() * (step * k as f64)) * axis.inverse();
    let scans: Vec<_> = (0..4)
        .map(|k: usize| {
            let (s, c) = libm::sincos(step * k as f64);
            let scan = seen_from(
                &blob(0.3 * k as f64),
                axis.rotation.inverse() * Vector3::new(0.0, 0.0, 0.0) + Vector3::new(s, 0.0, c),
            );
            move_by(&scan, &(truth(k).inverse() * axis))
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
        let (alignment, _) = align_list(&scans, &Search::Turntable(table));
        let alignment = alignment.unwrap();
        for (k, scan) in scans.iter().enumerate() {
            let motion = alignment.motion(k as u32 + 1).unwrap();
            assert!(
                rms_error(scan, &motion, &truth(k)) < 0.05,
                "scan {k}: {}",
                rms_error(scan, &motion, &truth(k))
            );
        }
    }
}

#[test]
fn picked_pairs_determine_a_motion() {
    let truth = arbitrary_motion(1.0);
    let scan = seen_from(&blob(0.0), Vector3::z());
    fn pick(at: [f64; 3], truth: &Isometry3<f64>) -> [[f64; 3]; 2] {
        [at, (*truth * Point3::from(at)).into()]
    }
    fn pairs_at(at: &[[f64; 3]], truth: &Isometry3<f64>) -> AlignMethod {
        AlignMethod::Pairs { pairs: at.iter().map(|&at| pick(at, truth)).collect() }
    }
    let enough = pairs_at(&[[0.0, 0.0, 40.0], [30.0, 0.0, 10.0], [0.0, 30.0, 10.0]], &truth);
    let alignment = align_pair(&scan, &move_by(&scan, &truth), &enough).0.unwrap();
    assert!(rms_error(&scan, &alignment.motion(2).unwrap(), &truth) < 1e-9);
    let fit = alignment.pairs()[0];
    assert!(fit.matches == 3 && fit.point < 1e-9 && fit.overlap[0] > 80.0, "{fit:?}");
    fn error(at: &[[f64; 3]], scan: &Scan, truth: &Isometry3<f64>) -> String {
        align_pair(scan, scan, &pairs_at(at, truth)).0.unwrap_err().to_string()
    }
    assert_eq!(
        error(&[[0.0; 3], [1.0; 3]], &scan, &truth),
        "expected at least 3 pairs of points, found 2"
    );
    let line = error(&[[0.0; 3], [10.0; 3], [20.0; 3]], &scan, &truth);
    assert!(line.starts_with("the points of the pairs are on a line"), "{line}");
    // The second scan is a mirror image of the first, or has another unit of length.
    let picked = [[0.0, 0.0, 40.0], [30.0, 0.0, 10.0], [0.0, 30.0, 10.0], [-20.0, -10.0, 5.0]];
    for scale in [[-1.0, 1.0, 1.0], [0.001; 3]] {
        let by = AlignMethod::Pairs {
            pairs: picked
                .map(|at: [f64; 3]| [at, std::array::from_fn(|axis| at[axis] * scale[axis])])
                .to_vec(),
        };
        let message = align_pair(&scan, &scan, &by).0.unwrap_err().to_string();
        assert!(message.starts_with("the pairs contradict each other: "), "{message}");
    }
}

#[test]
fn undetermined_degrees_of_freedom_do_not_change() {
    let up = Isometry3::translation(0.0, 0.0, 0.4);
    let slid = Isometry3::translation(3.0, 2.0, 0.4);
    let (alignment, warnings) = align_pair(&move_by(&sheet(), &slid), &sheet(), &NEAREST);
    let motion = alignment.unwrap().motion(2).unwrap();
    assert!((motion - up.inverse().to_homogeneous()).amax() < 1e-6, "{motion}");
    assert!(warnings[0].starts_with("3 of 6 degrees of freedom are undetermined"), "{warnings:?}");

    let turned = Isometry3::rotation(Vector3::new(0.1, 0.05, 0.0));
    let moved = Isometry3::translation(0.5, -0.3, 0.2) * turned;
    let (alignment, warnings) = align_pair(&move_by(&sphere(), &moved), &sphere(), &NEAREST);
    let motion = alignment.unwrap().motion(2).unwrap();
    let middle = motion.transform_point(&(moved * Point3::origin()));
    assert!(middle.coords.norm() < 0.02, "{middle}");
    assert!(warnings[0].starts_with("3 of 6 degrees of freedom are undetermined"), "{warnings:?}");
}

#[test]
fn scans_that_do_not_fit_are_errors() {
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
        let wrong = move_by(&wrong, &arbitrary_motion(1.0));
        let error = align_pair(&wrong, &front, &AlignMethod::Features).0.unwrap_err().to_string();
        assert!(error.starts_with("scans 2 and 1 do not fit: "), "{error}");
    }
    let far = move_by(&front, &Isometry3::translation(500.0, 0.0, 0.0));
    let error = align_pair(&far, &front, &NEAREST).0.unwrap_err().to_string();
    assert!(error.starts_with("no part of scan 2 is within "), "{error}");
    let nearest = Search::Nearest { reach: 0.0, poses: Poses::Auto };
    let islands = [front.clone(), front.clone(), far.clone(), far];
    let error = align_list(&islands, &nearest).0.unwrap_err().to_string();
    assert!(error.starts_with("no part of scan 3 is within "), "{error}");
}

#[test]
fn scans_far_from_the_origin_are_aligned_as_near_ones() {
    let (front, side) =
        (seen_from(&blob(0.0), Vector3::z()), seen_from(&blob(0.4), Vector3::new(0.8, 0.3, 0.6)));
    // The coordinates of a national map, in mm.
    let offset = Isometry3::translation(5e8, 5e9, 1e5);
    let truth = Isometry3::rotation(Vector3::new(0.05, -0.03, 0.04));
    let [near, far] = [Isometry3::identity(), offset].map(|at| {
        let to = move_by(&front, &at);
        let scan = move_by(&side, &(at * truth.inverse()));
        let motion = align_pair(&scan, &to, &NEAREST).0.unwrap().motion(2).unwrap();
        rms_error(&scan, &motion, &(at * truth * at.inverse()))
    });
    assert!(near < 0.05 && (far - near).abs() < 1e-3, "{near} {far}");
    let both = [front.clone(), move_by(&front, &offset)];
    let error = align_pair(&both[1], &both[0], &NEAREST).0.unwrap_err().to_string();
    assert!(error.contains("move it nearer (`Transform`)"), "{error}");
    let [near, far] = [Isometry3::identity(), offset].map(|at| {
        let through = at.translation.vector.into();
        let turned = Turntable { angle: 20.0, axis: Some([0.0, 0.0, 1.0]), through, reach: 0.0 };
        let start = at * Isometry3::rotation(Vector3::z() * -20_f64.to_radians());
        let scans = [move_by(&front, &at), move_by(&front, &start)];
        let motion = align_list(&scans, &Search::Turntable(turned)).0.unwrap().motion(2).unwrap();
        rms_error(&scans[1], &motion, &(at * start.inverse()))
    });
    assert!(near < 0.01 && (far - near).abs() < 1e-3, "{near} {far}");
}

#[test]
fn bad_scans_are_errors() {
    let good = seen_from(&blob(0.0), Vector3::z());
    let nothing = Point3::new(f64::NAN, f64::NAN, f64::NAN);
    let empty = Scan::RangeImage(RangeImage::new(4, 4, vec![nothing; 16]).unwrap());
    let one = Scan::Points(Points::new(vec![Point3::new(1.0, 2.0, 3.0); 50]).unwrap());
    for (bad, count) in [(empty, 0), (one, 1)] {
        let error = align_pair(&bad, &good, &AlignMethod::Features).0.unwrap_err().to_string();
        assert_eq!(error, format!("scan 2 has {count} different points, expected at least 6"));
    }
    let error = align_list(std::slice::from_ref(&good), &Search::Features).0.unwrap_err();
    assert_eq!(error.to_string(), "expected at least 2 scans, found 1");
    let by = AlignMethod::Nearest { reach: f64::NAN, poses: Poses::Auto };
    let error = align_pair(&good, &good, &by).0.unwrap_err();
    assert_eq!(error.to_string(), "`reach` is NaN, expected a length of at least 0 mm");
    let by = AlignMethod::Nearest { reach: 0.0, poses: Poses::Apply };
    let error = align_pair(&good, &good, &by).0.unwrap_err().to_string();
    assert!(error.starts_with("scan 1 has no pose: "), "{error}");
}

#[test]
fn a_scan_is_aligned_with_itself() {
    let scan = seen_from(&blob(0.0), Vector3::z());
    for by in [AlignMethod::Features, NEAREST] {
        let (alignment, warnings) = align_pair(&scan, &scan, &by);
        let alignment = alignment.unwrap();
        assert!(rms_error(&scan, &alignment.motion(2).unwrap(), &Isometry3::identity()) < 1e-3);
        assert!(alignment.pairs()[0].overlap[0] > 80.0 && warnings.is_empty(), "{warnings:?}");
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
    let truth = arbitrary_motion(2.0);
    let alignment =
        align_pair(&move_by(&torn, &truth.inverse()), &Scan::Mesh(mesh), &AlignMethod::Features)
            .0
            .unwrap();
    assert!(
        rms_error(&move_by(&torn, &truth.inverse()), &alignment.motion(2).unwrap(), &truth) < 0.05
    );
}

#[test]
fn alignment_does_not_depend_on_the_number_of_threads() {
    let (front, side) = (seen_from(&blob(0.0), Vector3::z()), seen_from(&blob(0.4), Vector3::x()));
    fn align_with_threads(
        threads: usize,
        side: &Scan,
        front: &Scan,
    ) -> (Result<Alignment, String>, Vec<String>) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let (alignment, warnings) = pool.install(|| {
            align_pair(&move_by(side, &arbitrary_motion(1.0)), front, &AlignMethod::Features)
        });
        (alignment.map_err(|error| error.to_string()), warnings)
    }
    assert_eq!(align_with_threads(1, &side, &front), align_with_threads(3, &side, &front));
}
