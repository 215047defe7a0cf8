"""Computes the doll with noses of several lengths: a progress bar, a plot, and some pictures.

    python examples/sweep.py GRAPH.ron OUT.png
"""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import maquette


def main(path: str, out: str) -> None:
    graph = maquette.load(path)
    growth = graph.params["growth"]
    lengths = np.linspace(growth.min or 0.0, growth.max or 40.0, 9)
    farthest, times, pictures = [], [], []
    for length in lengths:
        run = graph.run("model.ply", growth=length, progress=True)
        model = run["model.ply"]
        assert isinstance(model, maquette.Mesh)
        # The sensor is at the origin and looks along z, so the smallest z is the tip of the nose.
        farthest.append(-model.vertices[:, 2].min())
        times.append(sum(node.seconds for node in run.trace) * 1000)
        pictures.append(model.render(yaw=35, size=(320, 360)).pixels)
    figure = plt.figure(figsize=(11, 6), layout="constrained")
    plot, *frames = figure.subplot_mosaic([["plot"] * 3, ["0", "4", "8"]]).values()
    plot.plot(lengths, np.array(farthest) - farthest[0], "o-")
    plot.set(xlabel=f"growth [{growth.unit}]", ylabel="nose out by [mm]", title=graph.doc)
    for frame, k in zip(frames, (0, 4, 8)):
        frame.imshow(pictures[k])
        frame.set(title=f"{lengths[k]:.0f} {growth.unit}, {times[k]:.0f} ms")
        frame.axis("off")
    figure.savefig(out, dpi=100)


if __name__ == "__main__":
    main(*sys.argv[1:])
