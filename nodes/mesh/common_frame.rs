//! The common frame of several captures.

use maquette_value::CaptureFrame;

/// Returns the capture frame of a mesh that is merged from meshes with these frames: their common frame, or, if the frames differ, the
/// first one without camera and pose. Returns `None` if a mesh has no frame.
pub(super) fn common_frame(frames: &[Option<CaptureFrame>]) -> Option<CaptureFrame> {
    let first = (*frames.first()?)?;
    if frames.iter().all(|frame| *frame == Some(first)) {
        return Some(first);
    }
    let all = frames.iter().all(Option::is_some);
    all.then_some(CaptureFrame { camera: None, world_from_camera: None, ..first })
}
