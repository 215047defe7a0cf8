"""OpenCV."""

import pathlib

import cv2
import numpy as np
import record


def read(path: pathlib.Path) -> record.Record:
    # `imread` does not support non-ASCII file names on every system.
    image = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise ValueError("no picture")
    return {"picture": image[:, :, 2::-1] if image.ndim == 3 else image}


record.main(read)
