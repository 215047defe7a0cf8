//! Registration of real scans and of captures with known poses.

use std::path::{Path, PathBuf};

use maquette_format::camera;
use maquette_range::{Axes, Unit, read_range};
use nalgebra::Quaternion;

use super::*;

#[path = "../../../tests/common/beside.rs"]
mod beside;

use beside::shared_folder;

/// Returns the root folder of the repository.
fn project() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// A capture of the example object `doll`, and the pose of its camera.
fn doll(folder: &str, file: &str) -> (RangeImage, Isometry3<f64>) {
    let folder = project().join("graphs/doll").join(folder);
    fn read(name: &str, folder: &Path) -> Vec<u8> {
        std::fs::read(folder.join(name)).unwrap()
    }
    let camera = camera::read(&read("camera.json", &folder)).unwrap();
    let ending = file.rsplit('.').next().unwrap();
    let (range, _) =
        read_range(&read(file, &folder), ending, Some(&camera), Unit::Mm, Axes::Camera).unwrap();
    let pose = *range.world_from_camera().unwrap();
    let turn = UnitQuaternion::from_matrix(&pose.fixed_view::<3, 3>(0, 0).into());
    let shift = pose.fixed_view::<3, 1>(0, 3).into_owned();
    (range, Isometry3::from_parts(shift.into(), turn))
}

#[test]
fn both_captures_of_the_doll_are_aligned_without_a_hint() {
    let ((front, front_pose), (left, left_pose)) =
        (doll("", "range.pcd"), doll("left", "depth.png"));
    let truth = front_pose.inv_mul(&left_pose);
    let [front, left] = [front, left].map(Scan::RangeImage);
    let (alignment, warnings) = align_pair(&left, &front, &AlignMethod::Features);
    let motion = alignment.unwrap().motion(2).unwrap();
    assert!(rms_error(&left, &motion, &truth) < 0.1, "{}", rms_error(&left, &motion, &truth));
    assert!(warnings.is_empty(), "{warnings:?}");
}

#[test]
fn alignment_starts_at_the_poses_of_captures() {
    let ((front, front_pose), (left, left_pose)) =
        (doll("", "range.pcd"), doll("left", "depth.png"));
    let wrong = Isometry3::new(Vector3::new(1.0, -2.0, 1.5), Vector3::new(0.01, 0.02, 0.0));
    let pose = (left_pose * wrong).to_homogeneous();
    let scan = Scan::RangeImage(left.with_world_from_camera(Some(pose)));
    let front = Scan::RangeImage(front);
    let by = AlignMethod::Nearest { reach: 0.0, poses: Poses::Apply };
    let alignment = align_pair(&scan, &front, &by).0.unwrap();
    let (motion, truth) = (alignment.motion(2).unwrap(), front_pose.inv_mul(&left_pose));
    assert!(rms_error(&scan, &motion, &truth) < 0.1, "{}", rms_error(&scan, &motion, &truth));
    // The moved scan must be in the axes of the other capture's camera and have its pose.
    let moved = motion::move_scan(&scan, &motion, alignment.frame().as_ref()).unwrap();
    let pose = motion::frame_of(&moved).unwrap().world_from_camera.unwrap();
    assert!((pose - front_pose.to_homogeneous()).amax() < 1e-6);
}

#[test]
fn a_moved_capture_is_aligned_with_the_original() {
    let (left, _) = doll("left", "depth.png");
    let left = Scan::RangeImage(left);
    let truth = arbitrary_motion(1.0);
    let lost = move_by(&left, &truth.inverse());
    let motion = align_pair(&lost, &left, &AlignMethod::Features).0.unwrap().motion(2).unwrap();
    assert!(rms_error(&lost, &motion, &truth) < 0.01, "{}", rms_error(&lost, &motion, &truth));
}

#[test]
fn two_scans_of_the_stanford_bunny_are_aligned_without_a_hint() {
    let Some([front, side]) = bunny() else { return };
    // The numbers are from the file `bun.conf` of the data set. Its quaternion is that of the inverse rotation.
    let turn =
        UnitQuaternion::new_normalize(Quaternion::new(0.955586, 0.00548449, -0.294635, -0.0038555));
    let shift = Translation3::new(-52.0211, -0.383981, -10.9223);
    // In the data set y points up and z towards the sensor; range images here have y down and z away from the sensor.
    let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let truth = half_turn * Isometry3::from_parts(shift, turn.inverse()) * half_turn;
    let (alignment, warnings) = align_pair(&side, &front, &AlignMethod::Features);
    let motion = alignment.unwrap().motion(2).unwrap();
    assert!(rms_error(&side, &motion, &truth) < 0.5, "{}", rms_error(&side, &motion, &truth));
    assert!(warnings.is_empty(), "{warnings:?}");
}

/// Returns the bunny's scans from the front and from 45 degrees, in mm; `None` if the files do not exist.
fn bunny() -> Option<[Scan; 2]> {
    let folder = shared_folder("data/real/stanford_bunny")?;
    Some(["bun000.ply", "bun045.ply"].map(|name| {
        let bytes = std::fs::read(folder.join(name)).unwrap();
        let (range, _) = read_range(&bytes, "ply", None, Unit::M, Axes::YUp).unwrap();
        Scan::RangeImage(range)
    }))
}
