//! The common frame of several captures.

use maquette_value::CaptureFrame;

/// Returns the capture frame that merged meshes have in common. If their frames differ, returns the first frame without camera and pose.
/// Returns `None` if a mesh has no frame.
pub(super) fn common_frame(frames: &[Option<CaptureFrame>]) -> Option<CaptureFrame> {
    let first = (*frames.first()?)?;
    if frames.iter().all(|frame| *frame == Some(first)) {
        return Some(first);
    }
    let all = frames.iter().all(Option::is_some);
    all.then_some(CaptureFrame { camera: None, world_from_camera: None, ..first })
}
