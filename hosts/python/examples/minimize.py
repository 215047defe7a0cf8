"""Minimizes a user-defined loss over a graph's parameters with SciPy: how long must the nose be to stick out by 20 mm?

    python examples/minimize.py GRAPH.ron
"""

import sys

from scipy.optimize import minimize_scalar

import maquette

WANTED = 20.0
"""The wanted length of the nose, in mm."""


def main(path: str) -> float:
    graph = maquette.load(path)

    def nearest(growth: float) -> float:
        skin = graph.run([], nodes="skin", growth=growth, levels=0)["skin"]
        assert isinstance(skin, maquette.Mesh)
        return float(skin.vertices[:, 2].min())

    flat = nearest(0.0)

    def loss(growth: float) -> float:
        return (flat - nearest(growth) - WANTED) ** 2

    growth = graph.params["growth"]
    found = minimize_scalar(loss, bounds=(growth.min, growth.max), method="bounded", options={"xatol": 1e-3})
    print(f"growth {found.x:.3f} {growth.unit}, off by {found.fun ** 0.5:.4f} mm after {found.nfev} runs")
    return float(found.x)


if __name__ == "__main__":
    main(*sys.argv[1:])
