"""Renders the doll, redesigned in Blender, by Cycles: `target/blender/pictures/doll-VERSION.png` for visual inspection."""

from __future__ import annotations

import os
import pathlib

import bpy
import numpy as np
from render import render
from test_live import ROOT, doll, folder, settled, until  # noqa: F401
from test_screen import pixels


def test_12_the_redesigned_doll_is_rendered_by_cycles(doll: bpy.types.Object) -> None:  # noqa: F811
    pictures = ROOT / "target/blender/pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    shown = []
    for name, growth in (("scan", 0.0), ("doll", 24.0)):
        doll["maquette growth"] = growth
        until(lambda: settled(doll) and f'"growth": "{growth}"' in doll.maquette.values)
        path = pathlib.Path(pictures / f"{name}-{os.environ['MAQUETTE_BLENDER']}.png")
        render(doll, path, "CYCLES", size=(480, 480), samples=12)
        shown.append(pixels(path)[..., :3])
    before, after = shown
    # The colors are those of the doll: some red for the nose, much of other colors.
    red = (after[..., 0] > 0.35) & (after[..., 1] < 0.5 * after[..., 0]) & (after[..., 2] < 0.5 * after[..., 0])
    assert 0.001 < red.mean() < 0.4, red.mean()
    # The picture differs from that of the original doll.
    assert (np.abs(before - after).max(axis=-1) > 0.15).mean() > 0.005
