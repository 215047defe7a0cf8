"""Fills the holes of a mesh with MeshLib:  meshlib_fill.py IN OUT SKIP  (SKIP 1: do not fill the longest border). Prints milliseconds."""
import sys
import time

import numpy
from meshlib import mrmeshnumpy, mrmeshpy

text = open(sys.argv[1]).read().split()
count, sides = int(text[0]), int(text[1])
points = numpy.array(text[2 : 2 + 3 * count], float).reshape(-1, 3)
faces = numpy.array(text[2 + 3 * count :], numpy.int32).reshape(sides, 3)
base = mrmeshnumpy.meshFromFacesVerts(faces, points)
ends = numpy.concatenate([faces, numpy.roll(faces, -1, axis=1)], axis=1).reshape(-1, 2, 3).transpose(0, 2, 1).reshape(-1, 2)
edge = numpy.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1).mean()


def fill():
    mesh = mrmeshpy.Mesh(base)
    holes = list(mesh.topology.findHoleRepresentiveEdges())
    if sys.argv[3] == "1":
        holes.remove(max(holes, key=mesh.holePerimeter))
    for hole in holes:
        settings = mrmeshpy.FillHoleNicelySettings()
        settings.triangulateParams.metric = mrmeshpy.getUniversalMetric(mesh)
        settings.subdivideSettings.maxEdgeLen = 1.5 * edge
        settings.subdivideSettings.maxEdgeSplits = 20000
        settings.smoothCurvature = True
        mrmeshpy.fillHoleNicely(mesh, hole, settings)
    return mesh


best = float("inf")
for _ in range(3):
    start = time.perf_counter()
    mesh = fill()
    best = min(best, time.perf_counter() - start)
with open(sys.argv[2], "w") as out:
    out.writelines("v %r %r %r\n" % tuple(map(float, point)) for point in mrmeshnumpy.getNumpyVerts(mesh))
    out.writelines("f %d %d %d\n" % tuple(face + 1) for face in mrmeshnumpy.getNumpyFaces(mesh.topology))
print(1e3 * best)
