"""Pillow."""

import pathlib

import numpy as np
import record
from PIL import Image


def read(path: pathlib.Path) -> record.Record:
    return {"picture": np.asarray(Image.open(path))}


record.main(read)
