//! Scans that have moved into the axes of another one.

use maquette_mesh::{Motion, Movable, TransformError, transform};
use maquette_scan::Scan;
use maquette_value::{CaptureFrame, Mesh};
use nalgebra::Matrix4;

/// What is moved now lies in the axes of a capture with this frame; without one they are those of no capture.
pub(super) fn moved(
    what: &Movable,
    motion: &Matrix4<f64>,
    frame: Option<&CaptureFrame>,
) -> Result<Movable, TransformError> {
    let linear = motion.fixed_view::<3, 3>(0, 0).into();
    let shift = motion.fixed_view::<3, 1>(0, 3).into();
    let pose = frame.and_then(|frame| frame.world_from_camera);
    Ok(match transform(what, &Motion { linear, shift })? {
        Movable::Mesh(mesh) => Movable::Mesh(framed(mesh, frame)),
        Movable::RangeImage(range) => Movable::RangeImage(range.with_world_from_camera(pose)),
        other => other,
    })
}

/// The mesh in the axes of a frame, with its own picture.
fn framed(mesh: Mesh, frame: Option<&CaptureFrame>) -> Mesh {
    let own = mesh.frame().copied();
    let frame = frame.map(|frame| CaptureFrame {
        camera: own.and_then(|own| own.camera),
        picture: own.map_or(frame.picture, |own| own.picture),
        ..*frame
    });
    mesh.with_frame(frame)
}

/// The same for a scan.
pub(super) fn moved_scan(
    scan: &Scan,
    motion: &Matrix4<f64>,
    frame: Option<&CaptureFrame>,
) -> Result<Scan, TransformError> {
    let what = match scan {
        Scan::RangeImage(range) => Movable::RangeImage(range.clone()),
        Scan::Points(points) => Movable::Points(points.clone()),
        Scan::Mesh(mesh) => Movable::Mesh(mesh.clone()),
    };
    Ok(match moved(&what, motion, frame)? {
        Movable::RangeImage(range) => Scan::RangeImage(range),
        Movable::Points(points) => Scan::Points(points),
        Movable::Mesh(mesh) => Scan::Mesh(mesh),
        other => unreachable!("a scan became {other:?}"),
    })
}

/// The frame of a scan that a capture gave.
pub(super) fn frame_of(scan: &Scan) -> Option<CaptureFrame> {
    match scan {
        Scan::RangeImage(range) => range.capture_frame().ok(),
        Scan::Points(_) => None,
        Scan::Mesh(mesh) => mesh.frame().copied(),
    }
}
