"""Writes a LAS file of a synthetic city block: streets, and houses with walls and flat roofs.

    python3 make.py 100000000 city.las

The points are in meters, in a national grid, with colors, a class and a noise of 1 cm: 26 bytes each (LAS 1.2, format 2). Equal arguments
give equal bytes. Needs numpy; writes about 5 million points per second.
"""

import struct
import sys

import numpy

CHUNK = 1_000_000
SCALE = 0.001
ORIGIN = (500_000.0, 5_400_000.0, 100.0)
SIDE = 200.0
NOISE = 0.01
RECORD = numpy.dtype(
    [("at", "<i4", 3), ("intensity", "<u2"), ("flags", "u1"), ("class", "u1"), ("angle", "i1"), ("user", "u1"), ("source", "<u2"), ("color", "<u2", 3)]
)


def surfaces():
    """Returns parallelograms (corner, two edges, class, color): the ground, and the walls and the roof of each of 16 houses."""
    found = [((0, 0, 0), (SIDE, 0, 0), (0, SIDE, 0), 2, (90, 95, 100))]
    for k in range(16):
        x, y = 14.0 + 48.0 * (k % 4), 14.0 + 48.0 * (k // 4)
        width, depth, height = 22.0 + (k * 7) % 8, 20.0 + (k * 5) % 10, 9.0 + (k * 11) % 24
        color = (150 + (k * 37) % 90, 120 + (k * 53) % 90, 100 + (k * 71) % 90)
        found.append(((x, y, height), (width, 0, 0), (0, depth, 0), 6, (160, 60, 50)))
        for corner, edge in [
            ((x, y, 0), (width, 0, 0)),
            ((x, y + depth, 0), (width, 0, 0)),
            ((x, y, 0), (0, depth, 0)),
            ((x + width, y, 0), (0, depth, 0)),
        ]:
            found.append((corner, edge, (0, 0, height), 6, color))
    return found


def header(count):
    top = 40.0
    fields = [b"LASF", 0, 0, b"", 1, 2, b"maquette", b"city", 1, 2026, 227, 227, 0, 2, RECORD.itemsize, count, count, 0, 0, 0, 0]
    start = struct.pack("<4sHH16sBB32s32sHHHIIBHIIIIII", *fields)
    bounds = [bound for at, size in zip(ORIGIN, (SIDE, SIDE, top)) for bound in (at + size, at)]
    return start + struct.pack("<12d", *[SCALE] * 3, *ORIGIN, *bounds)


def chunk(index, count):
    random = numpy.random.Generator(numpy.random.PCG64([7, index]))
    parts = surfaces()
    corner, first, second = (numpy.array([part[k] for part in parts], dtype=float) for k in range(3))
    area = numpy.linalg.norm(numpy.cross(first, second), axis=1)
    which = numpy.searchsorted(numpy.cumsum(area) / area.sum(), random.random(count)).clip(0, len(parts) - 1)
    u, v = random.random((2, count, 1))
    at = corner[which] + u * first[which] + v * second[which] + random.normal(0.0, NOISE, (count, 3))
    records = numpy.zeros(count, RECORD)
    records["at"] = numpy.rint(at / SCALE)
    records["intensity"] = random.integers(100, 60_000, count)
    records["flags"] = 0b001001
    records["class"] = numpy.array([part[3] for part in parts])[which]
    records["color"] = numpy.array([part[4] for part in parts])[which] * 257
    return records


def main():
    count, path = int(sys.argv[1]), sys.argv[2]
    with open(path, "wb") as file:
        file.write(header(count))
        for index in range(-(-count // CHUNK)):
            chunk(index, min(CHUNK, count - index * CHUNK)).tofile(file)


main()
