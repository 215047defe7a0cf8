//! The frame that several captures have in common.

use maquette_value::CaptureFrame;

/// The frame of captures that were taken together: what is equal in all of them. None if one has no frame.
pub(super) fn common_frame(frames: &[Option<CaptureFrame>]) -> Option<CaptureFrame> {
    let first = (*frames.first()?)?;
    if frames.iter().all(|frame| *frame == Some(first)) {
        return Some(first);
    }
    let all = frames.iter().all(Option::is_some);
    all.then_some(CaptureFrame { camera: None, world_from_camera: None, ..first })
}
