//! Moves data into the axes of another scan.

use maquette_mesh::{Motion, Movable, transform};
use maquette_node::Error;
use maquette_scan::Scan;
use maquette_value::{CaptureFrame, Mesh};
use nalgebra::Matrix4;

/// Moves a value by a rigid motion. The result is in the axes of the capture with the frame `frame`; if that is `None`, the result belongs
/// to no capture.
pub(super) fn move_item(
    what: &Movable,
    motion: &Matrix4<f64>,
    frame: Option<&CaptureFrame>,
) -> Result<Movable, Error> {
    let linear = motion.fixed_view::<3, 3>(0, 0).into();
    let shift = motion.fixed_view::<3, 1>(0, 3).into();
    let pose = frame.and_then(|frame| frame.world_from_camera);
    Ok(match transform(what, &Motion { linear, shift })? {
        Movable::Mesh(mesh) => Movable::Mesh(with_frame(mesh, frame)),
        Movable::RangeImage(range) => Movable::RangeImage(range.with_world_from_camera(pose)),
        other => other,
    })
}

/// Sets the frame of a mesh. The mesh keeps its own picture and camera, if it has any; the rest is that of `frame`. Without `frame`, the
/// mesh gets no frame.
fn with_frame(mesh: Mesh, frame: Option<&CaptureFrame>) -> Mesh {
    let own = mesh.frame().copied();
    let frame = frame.map(|frame| CaptureFrame {
        camera: own.and_then(|own| own.camera),
        picture: own.map_or(frame.picture, |own| own.picture),
        ..*frame
    });
    mesh.with_frame(frame)
}

/// Moves a scan by a rigid motion; see [`move_item`] for `frame`.
pub(super) fn move_scan(
    scan: &Scan,
    motion: &Matrix4<f64>,
    frame: Option<&CaptureFrame>,
) -> Result<Scan, Error> {
    let what = match scan {
        Scan::RangeImage(range) => Movable::RangeImage(range.clone()),
        Scan::Points(points) => Movable::Points(points.clone()),
        Scan::Mesh(mesh) => Movable::Mesh(mesh.clone()),
    };
    Ok(match move_item(&what, motion, frame)? {
        Movable::RangeImage(range) => Scan::RangeImage(range),
        Movable::Points(points) => Scan::Points(points),
        Movable::Mesh(mesh) => Scan::Mesh(mesh),
        other => unreachable!("a scan became {other:?}"),
    })
}

/// Returns the capture frame of a scan; `None` if the scan has none.
pub(super) fn frame_of(scan: &Scan) -> Option<CaptureFrame> {
    match scan {
        Scan::RangeImage(range) => range.capture_frame().ok(),
        Scan::Points(_) => None,
        Scan::Mesh(mesh) => mesh.frame().copied(),
    }
}
