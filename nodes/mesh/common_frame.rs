//! The common frame of several captures.

use maquette_value::CaptureFrame;

/// Returns the common frame of captures that were taken together: the data that all frames share. Returns `None` if a capture has no frame.
pub(super) fn common_frame(frames: &[Option<CaptureFrame>]) -> Option<CaptureFrame> {
    let first = (*frames.first()?)?;
    if frames.iter().all(|frame| *frame == Some(first)) {
        return Some(first);
    }
    let all = frames.iter().all(Option::is_some);
    all.then_some(CaptureFrame { camera: None, world_from_camera: None, ..first })
}
