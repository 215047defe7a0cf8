//! Real scans, and captures of which the poses are known.

use std::path::{Path, PathBuf};

use maquette_format::camera;
use maquette_range::{Axes, Unit, read_range};
use nalgebra::Quaternion;

use super::*;

#[path = "../../../tests/common/beside.rs"]
mod beside;

use beside::beside;

/// The project's folder.
fn project() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// A capture of the doll, and where its camera was.
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
fn both_captures_of_the_doll_come_together_without_a_hint() {
    let ((front, front_pose), (left, left_pose)) =
        (doll("", "range.pcd"), doll("left", "depth.png"));
    let truth = front_pose.inv_mul(&left_pose);
    let [front, left] = [front, left].map(Scan::RangeImage);
    let (alignment, doubts) = aligned(&left, &front, &By::Features);
    let motion = alignment.unwrap().motion(2).unwrap();
    assert!(off(&left, &motion, &truth) < 0.1, "{}", off(&left, &motion, &truth));
    assert!(doubts.is_empty(), "{doubts:?}");
}

#[test]
fn captures_begin_where_their_poses_bring_them() {
    let ((front, front_pose), (left, left_pose)) =
        (doll("", "range.pcd"), doll("left", "depth.png"));
    let wrong = Isometry3::new(Vector3::new(1.0, -2.0, 1.5), Vector3::new(0.01, 0.02, 0.0));
    let pose = (left_pose * wrong).to_homogeneous();
    let scan = Scan::RangeImage(left.with_world_from_camera(Some(pose)));
    let front = Scan::RangeImage(front);
    let by = By::Nearest { reach: 0.0, poses: Poses::Apply };
    let alignment = aligned(&scan, &front, &by).0.unwrap();
    let (motion, truth) = (alignment.motion(2).unwrap(), front_pose.inv_mul(&left_pose));
    assert!(off(&scan, &motion, &truth) < 0.1, "{}", off(&scan, &motion, &truth));
    // What has moved lies where the other capture's camera saw it, and knows it.
    let moved = moved::moved_scan(&scan, &motion, alignment.frame().as_ref()).unwrap();
    let pose = moved::frame_of(&moved).unwrap().world_from_camera.unwrap();
    assert!((pose - front_pose.to_homogeneous()).amax() < 1e-6);
}

#[test]
fn a_capture_that_was_moved_comes_back() {
    let (left, _) = doll("left", "depth.png");
    let left = Scan::RangeImage(left);
    let truth = somewhere(1.0);
    let lost = moved_by(&left, &truth.inverse());
    let motion = aligned(&lost, &left, &By::Features).0.unwrap().motion(2).unwrap();
    assert!(off(&lost, &motion, &truth) < 0.01, "{}", off(&lost, &motion, &truth));
}

#[test]
fn two_scans_of_the_stanford_bunny_come_together_without_a_hint() {
    let Some([front, side]) = bunny() else { return };
    // Of its file `bun.conf`, whose quaternion turns the other way.
    let turn =
        UnitQuaternion::new_normalize(Quaternion::new(0.955586, 0.00548449, -0.294635, -0.0038555));
    let shift = Translation3::new(-52.0211, -0.383981, -10.9223);
    // Ours have y down and z away from the sensor.
    let over = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let truth = over * Isometry3::from_parts(shift, turn.inverse()) * over;
    let (alignment, doubts) = aligned(&side, &front, &By::Features);
    let motion = alignment.unwrap().motion(2).unwrap();
    assert!(off(&side, &motion, &truth) < 0.5, "{}", off(&side, &motion, &truth));
    assert!(doubts.is_empty(), "{doubts:?}");
}

/// Its scans from the front and from 45 degrees beside, in mm, if they are there.
fn bunny() -> Option<[Scan; 2]> {
    let folder = beside("data/real/stanford_bunny")?;
    Some(["bun000.ply", "bun045.ply"].map(|name| {
        let bytes = std::fs::read(folder.join(name)).unwrap();
        let (range, _) = read_range(&bytes, "ply", None, Unit::M, Axes::YUp).unwrap();
        Scan::RangeImage(range)
    }))
}
