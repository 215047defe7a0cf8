//! What captures have in common.

use maquette::value::CaptureFrame;

/// What is true of all these frames.
pub(super) fn common_frame(frames: &[Option<CaptureFrame>]) -> Option<CaptureFrame> {
    let first = (*frames.first()?)?;
    if frames.iter().all(|frame| *frame == Some(first)) {
        return Some(first);
    }
    let all = frames.iter().all(Option::is_some);
    all.then_some(CaptureFrame { camera: None, world_from_camera: None, ..first })
}
