#!/usr/bin/env python3
"""Compares the speed of maquette and other programs on the same inputs:  python3 benches/peers/peers.py [WORD ...]

    WORD ...      only rows whose name contains one of these words; by default all
    holes         instead, the table of all methods to fill holes; further words select its rows: see benches/fill.rs
    PEERS         the folder of scripts and versions of the peers (default: ../shared/peers next to the project)
    PEERS_WORK    the folder for packages, inputs and results, about 2 GB (default: peers in the system's temporary folder)
    PEERS_RUNS    the number of runs of each program in a row (default 11)

A run calls the public function on values, with a newly allocated result and two threads. Runs of ours and of the peers alternate, so that
the load of the machine affects all. Our program is restarted after every fourth run, since the placement of threads and large pages differs
between processes; the first run of each process does not count. A row whose peer is not available is measured without it, with a message.
`pipeline` measures our whole process, but of the peer only the time after its imports.

To add a row: write a function that opens a peer and returns a `Peer`, a line in ROWS, and an arm in `ours.rs`.
"""
import importlib
import io
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any, Callable

PROJECT = Path(__file__).resolve().parents[2]
PEERS = Path(os.environ.get("PEERS", PROJECT.parent / "shared/peers"))
NO_PEERS = f"cannot find the peers' scripts in {PEERS}; set PEERS to their folder"
WORK = Path(os.environ.get("PEERS_WORK", Path(tempfile.gettempdir()) / "peers"))
RUNS = int(os.environ.get("PEERS_RUNS", 11))
DATA = WORK / "data"
OUT = WORK / "out"
THREADS = 2
# Installed from PyPI, in the version of the peers' requirements.txt if that has one.
PACKAGES = ["numpy", "numba", "opencv-python-headless", "scipy", "scikit-image", "splinepy", "geomdl", "trimesh", "pymeshlab", "meshio", "open3d", "meshlib", "manifold3d", "xatlas", "fast-simplification"]
RUNS_OF_A_PROCESS = 4


@dataclass
class Peer:
    name: str
    run: Callable[[], Any]
    # A number of the result that must equal ours; None if the programs compute different things.
    check: Callable[[Any], float] | None = None


@dataclass
class Row:
    name: str
    # The name of the work in `ours.rs`, with the name of its input if it has several, or a command.
    ours: str | list[str]
    # The maximum of our time, in milliseconds.
    bar: float | None = None
    # Functions that open a peer; an ImportError or a missing compiler means that it is not available.
    peers: list[Callable[[], Peer]] = field(default_factory=list)


@dataclass
class RowResult:
    """The milliseconds of each run, of ours and of each peer by name."""

    row: Row
    ours: list[float] = field(default_factory=list)
    peers: dict[str, list[float]] = field(default_factory=dict)
    # The peak memory of our program, in megabytes.
    peak: float = 0.0
    # Remarks on results and their differences; peers that are not available.
    notes: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)


# ---------------------------------------------------------------- peers
def load(name):
    import numpy

    return numpy.load(DATA / f"{name}.npy")


def script(name):
    """Imports a script of the peers; the argument prevents it from measuring."""
    sys.argv[1:] = ["nothing"]
    return importlib.import_module(name)


def opencv_segment():
    import cv2
    from make_inputs import REF, TOL

    cv2.setNumThreads(THREADS)
    image = load("seg_rgb")
    low, high = tuple(c - TOL for c in REF), tuple(c + TOL for c in REF)
    run = lambda: cv2.connectedComponentsWithStats(cv2.inRange(image, low, high), connectivity=8, ltype=cv2.CV_32S)
    return Peer(f"OpenCV {cv2.__version__}", run, lambda result: result[0] - 1)


def opencv_edges():
    import cv2

    cv2.setNumThreads(THREADS)
    image = load("seg_grey")
    return Peer(f"OpenCV {cv2.__version__} Canny", lambda: cv2.Canny(image, 100, 200, apertureSize=3, L2gradient=True))


def scipy_nurbs(degree, normals):
    def open_peer():
        import scipy

        grid = script("b3_nurbs").scipy_way
        return Peer(f"SciPy {scipy.__version__}", lambda: grid(degree, normals), lambda result: float((result[1] if normals else result).sum()))

    return open_peer


def splinepy_nurbs(degree):
    def open_peer():
        import numpy
        import splinepy

        knots, points, weights = script("b3_nurbs").knots, load("nurbs_pts"), load("nurbs_w")
        surface = splinepy.NURBS(
            degrees=[degree, degree],
            knot_vectors=[knots(count, degree) for count in weights.shape],
            control_points=numpy.ascontiguousarray(points.transpose(1, 0, 2)).reshape(-1, 3),
            weights=numpy.ascontiguousarray(weights.T).reshape(-1, 1),
        )
        run = lambda: surface.sample([2000, 2000], nthreads=THREADS)
        return Peer("splinepy", run, lambda result: float(result.sum()))

    return open_peer


def scipy_interpolation(name):
    """Plain iteration with the limit masks as a sparse matrix, up to a millionth of the diagonal."""

    def open_peer():
        import numpy
        import scipy.sparse

        points, faces = load(f"{name}_v"), load(f"{name}_f")
        tolerance = 1e-6 * numpy.linalg.norm(numpy.ptp(points, axis=0))
        count, sides = len(points), faces.shape[1]

        def ahead(steps):
            ends = numpy.roll(faces, -steps, axis=1)
            return scipy.sparse.csr_matrix((numpy.ones(faces.size), (faces.ravel(), ends.ravel())), shape=(count, count))

        def masks():
            beside = ahead(1)
            n = numpy.asarray(beside.sum(1)).ravel()
            if sides == 4:
                return scipy.sparse.diags(1 / (n * (n + 5))) @ (scipy.sparse.diags(n * n) + 4 * beside + ahead(2))
            own = 0.375 * n / (0.625 - (0.375 + 0.25 * numpy.cos(2 * numpy.pi / n)) ** 2)
            return scipy.sparse.diags(1 / (own + n)) @ (scipy.sparse.diags(own) + beside)

        def run():
            matrix, control = masks(), points.copy()
            while numpy.abs(missed := points - matrix @ control).max() > tolerance:
                control += missed
            return control

        return Peer(f"SciPy {scipy.__version__}, iterated", run)

    return open_peer


def ffd_system(count, narrower, drag):
    """Handles, factors of the exponents, weights, basis functions, and the solver for coefficients, which a peer calls in each run."""
    import numpy

    handles, moves, sigma, weights = (load(f"ffd_{k}{count}") for k in "hdsw")
    if drag:
        moves[21] += (0.01, 0.02, 0.03)
    factors = -0.5 / (sigma * narrower) ** 2

    def basis(points):
        squares = (points * points).sum(1)[:, None] + (handles * handles).sum(1) - 2 * (points @ handles.T)
        powers = numpy.exp(squares * factors) * weights
        return powers / powers.sum(1, keepdims=True)

    return handles, factors, weights, basis, lambda: numpy.linalg.solve(basis(handles), moves)


def numpy_ffd(count, narrower=1.0, drag=False):
    def open_peer():
        import numpy

        points, (_, _, _, basis, solve) = load("ffd_pts"), ffd_system(count, narrower, drag)

        def run(chunk=8192):
            coefficients, moved = solve(), numpy.empty_like(points)
            for start in range(0, len(points), chunk):
                part = points[start : start + chunk]
                moved[start : start + chunk] = part + basis(part) @ coefficients
            return moved

        return Peer(f"NumPy {numpy.__version__}, chunks of 8192", run, lambda result: float(result.sum()))

    return open_peer


def numba_ffd(count, narrower=1.0, drag=False):
    def open_peer():
        import numba
        import numpy

        points, (handles, factors, weights, _, solve) = load("ffd_pts"), ffd_system(count, narrower, drag)
        numba.set_num_threads(THREADS)

        @numba.njit(parallel=True, fastmath=True)
        def move(points, handles, factors, weights, coefficients):
            moved = numpy.empty_like(points)
            for i in numba.prange(len(points)):
                x = y = z = total = 0.0
                for j in range(len(handles)):
                    a, b, c = points[i, 0] - handles[j, 0], points[i, 1] - handles[j, 1], points[i, 2] - handles[j, 2]
                    power = weights[j] * numpy.exp(factors[j] * (a * a + b * b + c * c))
                    total += power
                    x += power * coefficients[j, 0]
                    y += power * coefficients[j, 1]
                    z += power * coefficients[j, 2]
                moved[i, 0], moved[i, 1], moved[i, 2] = points[i, 0] + x / total, points[i, 1] + y / total, points[i, 2] + z / total
            return moved

        run = lambda: move(points, handles, factors, weights, solve())
        return Peer(f"Numba {numba.__version__}, fastmath", run, lambda result: float(result.sum()))

    return open_peer


def plain_c_ffd(count):
    """The same sums in plain C, with random handles and without a solve: a reference for the speed of the loop."""

    def open_peer():
        source, program = PEERS / "cpp/ffd_floor.c", WORK / "ffd_floor"
        if not program.exists():
            flags = ["-O3", "-march=native", "-ffast-math", "-fopenmp"]
            subprocess.run(["gcc", *flags, source, "-o", program, "-lm"], check=True)
        run = lambda: subprocess.run([program], check=True, capture_output=True, text=True).stdout
        peer = Peer("plain C, -ffast-math", run)
        wanted = f"{count} handles, {THREADS} threads: f64 "
        peer.milliseconds = lambda text: float(text.split(wanted)[1].split()[0])
        return peer

    return open_peer


def open3d_align():
    """Feature histograms and RANSAC, then ICP with all points, as in Open3D's tutorial on global registration, with voxels of 4 mm."""
    import numpy
    import open3d

    def scan(name):
        cloud = open3d.io.read_point_cloud(str(DATA / name))
        return cloud.scale(1000, center=(0, 0, 0))

    front, side, edge = scan("bun000.ply"), scan("bun045.ply"), 4.0
    registration, search = open3d.pipelines.registration, open3d.geometry.KDTreeSearchParamHybrid

    def describe(cloud):
        sampled = cloud.voxel_down_sample(edge)
        sampled.estimate_normals(search(radius=2 * edge, max_nn=30))
        sampled.orient_normals_towards_camera_location(numpy.array([0, 0, 1000.0]))
        return sampled, registration.compute_fpfh_feature(sampled, search(radius=5 * edge, max_nn=100))

    def run():
        clouds = [open3d.geometry.PointCloud(cloud) for cloud in (side, front)]
        (a, a_features), (b, b_features) = map(describe, clouds)
        checks = [registration.CorrespondenceCheckerBasedOnEdgeLength(0.9), registration.CorrespondenceCheckerBasedOnDistance(1.5 * edge)]
        coarse = registration.registration_ransac_based_on_feature_matching(
            a, b, a_features, b_features, True, 1.5 * edge, registration.TransformationEstimationPointToPoint(False), 3, checks,
            registration.RANSACConvergenceCriteria(100_000, 0.999),
        )
        for cloud in clouds:
            cloud.estimate_normals(search(radius=2.0, max_nn=30))
        return registration.registration_icp(*clouds, 0.4 * edge, coarse.transformation, registration.TransformationEstimationPointToPlane())

    def error(result):
        """The root mean square distance of the second scan from its pose in Stanford's bun.conf, in mm."""
        turn = open3d.geometry.get_rotation_matrix_from_quaternion([0.955586, -0.00548449, 0.294635, 0.0038555])
        points, motion = numpy.asarray(side.points), result.transformation
        truth = points @ turn.T + [-52.0211, -0.383981, -10.9223]
        return float(numpy.sqrt(((points @ motion[:3, :3].T + motion[:3, 3] - truth) ** 2).sum(1).mean()))

    return Peer(f"Open3D {open3d.__version__}", run, error)


def manifold_union(names, own_form):
    """The union of two meshes. With `own_form`, the time does not include the conversion of the inputs to Manifold's own form."""

    def open_peer():
        import manifold3d

        meshes = [(load(f"{name}_v"), load(f"{name}_f").astype("u8")) for name in names]
        convert = lambda: [manifold3d.Manifold(manifold3d.Mesh64(*mesh)) for mesh in meshes]
        converted = convert() if own_form else None
        run = lambda: manifold3d.Manifold.batch_boolean(converted or convert(), manifold3d.OpType.Add).to_mesh64()
        return Peer("Manifold, in its own form" if own_form else "Manifold, of meshes", run, lambda mesh: len(mesh.tri_verts))

    return open_peer


def meshlab_union():
    import pymeshlab

    balls = [pymeshlab.Mesh(load(f"{name}_v"), load(f"{name}_f")) for name in ("ball", "other")]

    def run():
        meshes = pymeshlab.MeshSet()
        for ball in balls:
            meshes.add_mesh(ball)
        meshes.generate_boolean_union(first_mesh=0, second_mesh=1)
        return meshes

    return Peer("MeshLab generate_boolean_union", run, lambda meshes: meshes.current_mesh().face_number())


def meshlab(work, **options):
    """A filter of MeshLab on the koala. The time includes a copy of the mesh, since ours creates a new mesh, too."""

    def open_peer():
        import pymeshlab

        given = pymeshlab.MeshSet(verbose=False)
        if "texture" in work:
            given.load_new_mesh(str(DATA / "clean.obj"))
        else:
            given.add_mesh(pymeshlab.Mesh(load("clean_v"), load("clean_f")))
        if "targetlen" in options:
            options["targetlen"] = pymeshlab.PureValue(options["targetlen"])

        def run():
            meshes = pymeshlab.MeshSet(verbose=False)
            meshes.add_mesh(given.current_mesh())
            getattr(meshes, work)(**options)
            return meshes

        peer = Peer("MeshLab", run)
        peer.note = lambda meshes: quality(meshes.current_mesh().vertex_matrix(), meshes.current_mesh().face_matrix())
        return peer

    return open_peer


def quality(places, faces):
    """The quality of triangles: the mean and the minimum of their smallest angles, in degrees."""
    import numpy

    corners = places[faces]
    angles = []
    for k in range(3):
        a, b = corners[:, (k + 1) % 3] - corners[:, k], corners[:, (k + 2) % 3] - corners[:, k]
        angles.append(numpy.degrees(numpy.arctan2(numpy.linalg.norm(numpy.cross(a, b), axis=1), (a * b).sum(1))))
    least = numpy.min(angles, axis=0)
    return f"{len(faces)} faces, smallest angles {least.mean():.1f} in the mean, {least.min():.1f} at least"


def fast_simplification(name):
    """Simplification of the torus of `make_large_torus` to a fifteenth of its triangles."""

    def open_peer():
        import fast_simplification
        import numpy

        points, faces = load(f"{name}_v"), load(f"{name}_f").astype("i4")
        run = lambda: fast_simplification.simplify(points, faces, target_count=len(faces) // 15)
        peer = Peer(f"fast_simplification {version('fast_simplification')}, 1 thread", run)
        peer.note = lambda result: f"{off_large_torus(result[0])}, {len(result[1])} triangles"
        return peer

    return open_peer


def meshlab_taubin(name):
    """MeshLab's smoothing with its default of 10 steps, which halves waves of 3.9 edges."""

    def open_peer():
        import pymeshlab

        given = pymeshlab.Mesh(load(f"{name}_v"), load(f"{name}_f"))

        def run():
            meshes = pymeshlab.MeshSet(verbose=False)
            meshes.add_mesh(given)
            meshes.apply_coord_taubin_smoothing()
            return meshes

        peer = Peer(f"MeshLab {version('pymeshlab')} Taubin, 1 thread", run)
        peer.note = lambda meshes: off_large_torus(meshes.current_mesh().vertex_matrix())
        return peer

    return open_peer


def meshlib_hollow():
    """Walls of 1 mm with cells of 0.5 mm inside the ball, as ours."""
    from meshlib import mrmeshnumpy, mrmeshpy

    mesh = mrmeshnumpy.meshFromFacesVerts(load("ball_f"), load("ball_v"))

    def run():
        settings = mrmeshpy.GeneralOffsetParameters()
        settings.voxelSize = 0.5
        return mrmeshpy.thickenMesh(mesh, -1.0, settings)

    peer = Peer(f"MeshLib {version('meshlib')} thickenMesh", run)
    peer.note = lambda mesh: f"{mesh.topology.numValidFaces()} triangles"
    return peer


def off_large_torus(places):
    """The root mean square distance from the torus of `make_large_torus` without noise, in millimeters."""
    import numpy

    x, y, z = numpy.asarray(places).T
    u, out = numpy.arctan2(y, x), numpy.hypot(x, y) - 40
    v = numpy.arctan2(z, out)
    off = numpy.hypot(out, z) - 15 - bumps(u, v)
    return f"off by {numpy.sqrt((off**2).mean()):.5f} mm"


def bumps(u, v):
    import numpy

    return 1.5 * numpy.sin(9 * u) * numpy.cos(7 * v) + 0.2 * numpy.sin(41 * u + 23 * v)


def open3d_outliers():
    import numpy
    import open3d

    points = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(load("scattered")))
    # Open3D counts a point among its own neighbors.
    run = lambda: points.remove_statistical_outlier(nb_neighbors=21, std_ratio=2.0)
    return Peer(f"Open3D {open3d.__version__}", run, lambda result: float(numpy.sum(result[1])))


def open3d_pcd():
    import open3d

    path = str(DATA / "grid.pcd")
    run = lambda: open3d.io.read_point_cloud(path)
    return Peer(f"Open3D {open3d.__version__}", run, lambda cloud: len(cloud.points))


def open3d_ply(write):
    def open_peer():
        import open3d

        path, out = str(DATA / "mesh.ply"), str(OUT / "mesh.ply")
        read = lambda: open3d.io.read_triangle_mesh(path)
        mesh = read()
        run = (lambda: open3d.io.write_triangle_mesh(out, mesh)) if write else read
        return Peer(f"Open3D {open3d.__version__}, file", run, lambda result: len(mesh.triangles))

    return open_peer


def trimesh_ply(write):
    def open_peer():
        import trimesh
        from trimesh.exchange import ply

        data = (DATA / "mesh.ply").read_bytes()
        read = lambda: ply.load_ply(io.BytesIO(data))
        opened = read()
        mesh = trimesh.Trimesh(opened["vertices"], opened["faces"], process=False)
        run = (lambda: ply.export_ply(mesh)) if write else read
        return Peer(f"trimesh {trimesh.__version__}", run, lambda result: len(mesh.faces))

    return open_peer


def meshio_ply(write):
    def open_peer():
        import meshio

        path, out = DATA / "mesh.ply", OUT / "mesh.ply"
        read = lambda: meshio.read(path)
        mesh = read()
        run = (lambda: meshio.write(out, mesh)) if write else read
        return Peer(f"meshio {meshio.__version__}, file", run, lambda result: len(mesh.cells[0].data))

    return open_peer


def open3d_poisson(cloud, normals):
    """Poisson reconstruction of depth 8, about that of ours; missing normals are estimated from 30 neighbors and oriented consistently."""

    def open_peer():
        import open3d

        places = open3d.utility.Vector3dVector(load(cloud))
        given = open3d.utility.Vector3dVector(load("cloud_normals")) if normals else None

        def run():
            points = open3d.geometry.PointCloud(places)
            if given:
                points.normals = given
            else:
                points.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(30))
                points.orient_normals_consistent_tangent_plane(12)
            return open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(points, depth=8, n_threads=THREADS)[0]

        peer = Peer(f"Open3D {open3d.__version__} Poisson", run)
        peer.note = lambda mesh: off_torus(mesh.vertices)
        return peer

    return open_peer


def open3d_large():
    """Poisson reconstruction of depth 10, about that of ours, of the vertices of a large torus with normals estimated from its faces."""
    import open3d

    mesh = open3d.geometry.TriangleMesh(open3d.utility.Vector3dVector(load("torus_1500_v")), open3d.utility.Vector3iVector(load("torus_1500_f").astype("i4")))
    mesh.compute_vertex_normals()
    points = open3d.geometry.PointCloud(mesh.vertices)
    points.normals = mesh.vertex_normals
    run = lambda: open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(points, depth=10, n_threads=THREADS)[0]
    peer = Peer(f"Open3D {open3d.__version__} Poisson", run)
    peer.note = lambda mesh: f"{off_large_torus(mesh.vertices)}, {len(mesh.triangles)} triangles"
    return peer


def meshlab_poisson(cloud, normals):
    def open_peer():
        import pymeshlab

        places, given = load(cloud), load("cloud_normals") if normals else None

        def run():
            meshes = pymeshlab.MeshSet(verbose=False)
            meshes.add_mesh(pymeshlab.Mesh(places, v_normals_matrix=given) if normals else pymeshlab.Mesh(places))
            if not normals:
                meshes.compute_normal_for_point_clouds(k=30)
            meshes.generate_surface_reconstruction_screened_poisson(depth=8, threads=THREADS)
            return meshes

        peer = Peer("MeshLab screened Poisson", run)
        peer.note = lambda meshes: off_torus(meshes.current_mesh().vertex_matrix())
        return peer

    return open_peer


def xatlas_unwrap():
    """Charts and packing with default settings, in a square of 1024 texels with 4 between charts."""
    import numpy
    import xatlas

    places, faces = load("bumpy_v").astype(numpy.float32), load("bumpy_f")
    options = xatlas.PackOptions()
    options.resolution, options.padding = 1024, 4

    def run():
        atlas = xatlas.Atlas()
        atlas.add_mesh(places, faces)
        atlas.generate(xatlas.ChartOptions(), options)
        return atlas

    def coverage(atlas):
        """The number of charts, and the fraction of the square that triangles cover."""
        _, corners, uv = atlas[0]
        a, b, c = (uv[corners[:, k]] * [atlas.width, atlas.height] for k in range(3))
        (p, q), (r, s) = (b - a).T, (c - a).T
        share = numpy.abs(p * s - q * r).sum() / 2 / max(atlas.width, atlas.height) ** 2
        return f"{atlas.chart_count} charts, {100 * share:.0f} % of the square"

    peer = Peer("xatlas", run)
    peer.note = coverage
    return peer


def off_torus(places):
    """The root mean square distance from the torus of `make_clouds`, in multiples of the distance of its points."""
    import numpy

    x, y, z = numpy.asarray(places).T
    off = numpy.hypot(numpy.hypot(x, z) - 40, y) - 15
    return f"off by {numpy.sqrt((off**2).mean()) / numpy.sqrt(4 * numpy.pi**2 * 600 / 100_000):.3f} distances of points"


class PeerProcess:
    """A program that does its work for each line of input and prints the milliseconds, as ours does."""

    def __init__(self, command):
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.check = float(self.process.stdout.readline())

    def run(self):
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        return float(self.process.stdout.readline())


def opensubdiv(scheme, part, large_pages=False):
    def open_peer():
        if not Path("/usr/include/opensubdiv/far/primvarRefiner.h").exists():
            raise ImportError("apt-get install libosd-dev")
        source, program = Path(__file__).with_name("opensubdiv.cpp"), WORK / "opensubdiv"
        if not program.exists() or program.stat().st_mtime < source.stat().st_mtime:
            flags = ["-O3", "-march=native", "-DNDEBUG", "-std=c++17", f"-I{PEERS}/cpp"]
            subprocess.run(["g++", *flags, source, "-o", program, "-losdCPU"], check=True)
        command = [program, str(scheme), str(part), ["sub_quad", "sub_tri"][scheme]]
        tunables = {"GLIBC_TUNABLES": "glibc.malloc.hugetlb=1"} if large_pages else {}
        process = PeerProcess(["env", *(f"{name}={value}" for name, value in tunables.items()), *command])
        peer = Peer("OpenSubdiv" + (", large pages" if large_pages else ""), process.run, lambda _: process.check)
        peer.milliseconds = lambda result: result
        return peer

    return open_peer


def cgal_program():
    if not Path("/usr/include/CGAL/version.h").exists() or not Path("/usr/include/eigen3").exists():
        raise ImportError("apt-get install libcgal-dev libeigen3-dev")
    source, program = Path(__file__).with_name("cgal_fill.cpp"), WORK / "cgal_fill"
    if not program.exists() or program.stat().st_mtime < source.stat().st_mtime:
        flags = ["-O3", "-march=native", "-DNDEBUG", "-DCGAL_EIGEN3_ENABLED", "-std=c++17", "-frounding-math", "-I/usr/include/eigen3"]
        subprocess.run(["g++", *flags, source, "-o", program, "-lgmp", "-lmpfr"], check=True)
    return program


def cgal_fill():
    """Runs CGAL's program, which fills the hole and prints the milliseconds."""
    program, mesh = cgal_program(), DATA / "hole.txt"
    if not mesh.exists():
        points, faces = load("hole_v"), load("hole_f")
        rows = [f"{len(points)} {len(faces)}", *(" ".join(map(repr, map(float, p))) for p in points), *(" ".join(map(str, f)) for f in faces)]
        mesh.write_text("\n".join(rows))
    run = lambda: float(subprocess.run([program, "1", mesh, DATA / "hole_out.txt", "0"], check=True, capture_output=True, text=True).stdout)
    peer = Peer("CGAL triangulate_refine_and_fair_hole", run)
    peer.milliseconds = lambda result: result
    return peer


def meshlib_fill():
    from meshlib import mrmeshnumpy, mrmeshpy

    mesh = mrmeshnumpy.meshFromFacesVerts(load("hole_f"), load("hole_v"))

    def run():
        copy = mrmeshpy.Mesh(mesh)
        settings = mrmeshpy.FillHoleNicelySettings()
        settings.triangulateParams.metric = mrmeshpy.getUniversalMetric(copy)
        settings.subdivideSettings.maxEdgeLen = 0.04
        settings.subdivideSettings.maxEdgeSplits = 20000
        settings.smoothCurvature = True
        mrmeshpy.fillHoleNicely(copy, copy.topology.findHoleRepresentiveEdges()[0], settings)
        return copy

    return Peer("MeshLib fillHoleNicely", run)


def python_pipeline(nurbs, mesh):
    def open_peer():
        import json

        for module in ("cv2", nurbs, mesh):
            importlib.import_module(module)
        command = [sys.executable, PEERS / "b9_pipeline.py", "--once", "--nurbs", nurbs, "--mesh", mesh]
        run = lambda: json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()[-1])
        peer = Peer(f"OpenCV + {nurbs} + {mesh}", run, lambda result: result["faces"])
        peer.milliseconds = lambda result: 1e3 * result["pipeline_s"]
        return peer

    return open_peer


# ---------------------------------------------------------------- rows
PIPELINE = [PROJECT / "target/release/maquette", "run", DATA / "pipeline.ron", "--threads", str(THREADS), "--no-cache", "--json", "--out", OUT]

TENTH = {"targetperc": 0.1}
BALLS = ("ball", "other")
LARGE_BALLS = ("large_ball", "large_other")
ROWS = [
    Row("threshold, labels, statistics, 4096 x 4096", "segment", 45, [opencv_segment]),
    Row("edges by Sobel, 4096 x 4096", "edges", 25, [opencv_edges]),
    Row("edges above the 90th percentile", "edges-percentile", 25, [opencv_edges]),
    Row("NURBS degree 2, 2000 x 2000 points", "points-2", 20, [scipy_nurbs(2, False), splinepy_nurbs(2)]),
    Row("NURBS degree 3, 2000 x 2000 points", "points-3", 20, [scipy_nurbs(3, False), splinepy_nurbs(3)]),
    Row("NURBS degree 2, points and normals", "normals-2", 40, [scipy_nurbs(2, True)]),
    Row("NURBS degree 3, points and normals", "normals-3", 40, [scipy_nurbs(3, True)]),
    Row("Catmull-Clark, 4 steps to 1.5 M quads", "catmull-clark", 70, [opensubdiv(0, 0), opensubdiv(0, 0, True)]),
    Row("Catmull-Clark, positions alone", "catmull-clark-places", 20, [opensubdiv(0, 1), opensubdiv(0, 1, True)]),
    Row("Loop, 4 steps to 1.5 M triangles", "loop", 45, [opensubdiv(1, 0), opensubdiv(1, 0, True)]),
    Row("Loop, positions alone", "loop-places", 10, [opensubdiv(1, 1), opensubdiv(1, 1, True)]),
    Row("Doo-Sabin, 4 steps to 1.5 M faces", "doo-sabin", 80, []),
    Row("interpolating Loop, 20 252 vertices", "interpolate-loop", 5, [scipy_interpolation("int_tri")]),
    Row("interpolating Catmull-Clark, 19 442", "interpolate-catmull-clark", 8, [scipy_interpolation("int_quad")]),
    Row("ffd, 1 M points, 64 handles", "ffd-64", 40, [numpy_ffd(64), numba_ffd(64), plain_c_ffd(64)]),
    Row("ffd, 1 M points, 256 handles", "ffd-256", 150, [numpy_ffd(256), numba_ffd(256), plain_c_ffd(256)]),
    Row("ffd near, 64 handles, within 1e-7", "ffd-near", 15, [numpy_ffd(64, 1 / 3), numba_ffd(64, 1 / 3), plain_c_ffd(64)]),
    Row("ffd drag of one of 64 handles", "ffd-drag", 10, [numpy_ffd(64, 1.0, True), numba_ffd(64, 1.0, True)]),
    Row("pipeline, 1.27 M faces, OBJ and PNG", PIPELINE, 250, [python_pipeline("splinepy", "pymeshlab")]),
    Row("fill a hole of 948 vertices, thin plate", "fill", 10, [cgal_fill, meshlib_fill]),
    Row("union of two balls of 81 920 triangles", "union", None, [manifold_union(BALLS, True), manifold_union(BALLS, False), meshlab_union]),
    Row("align two scans of 40 000 points, no hint", "align", 500, [open3d_align]),
    Row("charts of 100 000 triangles", "unwrap", 5000, [xatlas_unwrap]),
    Row("skin of 100 000 points, noise of 1 %", "reconstruct", 2000, [open3d_poisson("cloud", False), meshlab_poisson("cloud", False)]),
    Row("skin of 100 000 points and normals, 1 %", "reconstruct-normals", 2000, [open3d_poisson("cloud", True), meshlab_poisson("cloud", True)]),
    Row("skin of 100 000 points without noise", "reconstruct-clean", 2000, [open3d_poisson("cloud_clean", False), meshlab_poisson("cloud_clean", False)]),
    Row("remesh 100 000 triangles to one length", "remesh", None, [meshlab("meshing_isotropic_explicit_remeshing", targetlen=0.06, featuredeg=40.0, iterations=10)]),
    Row("simplify 100 000 triangles to a tenth", "simplify", None, [meshlab("meshing_decimation_quadric_edge_collapse", **TENTH)]),
    Row("the same with a texture", "simplify-texture", None, [meshlab("meshing_decimation_quadric_edge_collapse_with_texture", **TENTH)]),
    Row("simplify 1.5 M triangles to 100 000", "simplify torus_1500", None, [fast_simplification("torus_1500")]),
    Row("simplify 6 M triangles to 400 000", "simplify torus_6000", None, [fast_simplification("torus_6000")]),
    Row("smooth 1.5 M triangles, both by default", "smooth torus_1500", None, [meshlab_taubin("torus_1500")]),
    Row("smooth 1.5 M triangles, waves of 3.9 edges", "smooth-equal torus_1500", None, [meshlab_taubin("torus_1500")]),
    Row("skin of 750 000 points and normals", "reconstruct-large torus_1500", None, [open3d_large]),
    Row("union of two balls of 1.3 M triangles", "union-large", None, [manifold_union(LARGE_BALLS, True), manifold_union(LARGE_BALLS, False)]),
    Row("hollow ball of 81 920 triangles", "hollow", None, [meshlib_hollow]),
    Row("outliers of 200 000 points", "outliers", None, [open3d_outliers]),
    Row("read PCD, 640 x 480, binary", "read-pcd", 4, [open3d_pcd]),
    Row("read PLY, 1 M triangles, binary", "read-ply", 8, [trimesh_ply(False), meshio_ply(False), open3d_ply(False)]),
    Row("write PLY, 1 M triangles, with normals", "write-ply", 10, [trimesh_ply(True), meshio_ply(True), open3d_ply(True)]),
]


# ---------------------------------------------------------------- inputs
def make_inputs():
    """Creates the inputs of the peers' scripts, and further files."""
    if not (DATA / "pipe_range.npy").exists():
        subprocess.run([sys.executable, PEERS / "make_inputs.py"], check=True)
    import cv2
    import numpy

    if not (DATA / "cloud.npy").exists():
        make_clouds()
    if not (DATA / "large_other_f.npy").exists():
        make_balls(BALLS, 6)
        make_balls(LARGE_BALLS, 8)
    if not (DATA / "clean_v.npy").exists():
        make_rough()
    if not (DATA / "bumpy_v.npy").exists():
        make_bumpy()
    if not (DATA / "torus_6000_f.npy").exists():
        make_large_torus("torus_1500", 1000, 750)
        make_large_torus("torus_6000", 2000, 1500)
    for name in ("bun000.ply", "bun045.ply"):
        (DATA / name).write_bytes((PEERS.parent / "data/real/stanford_bunny" / name).read_bytes())
    (DATA / "pipeline.ron").write_bytes(Path(__file__).with_name("pipeline.ron").read_bytes())
    if (DATA / "mesh.ply").exists():
        return
    cv2.imwrite(str(DATA / "color.png"), load("pipe_rgb")[..., ::-1])
    write_pcd(DATA / "range.pcd", load("pipe_range"))
    write_pcd(DATA / "grid.pcd", wavy(640, 480))
    points = wavy(1001, 501)
    corner = numpy.arange(501 * 1001).reshape(501, 1001)
    a, b, c, d = (corner[rows, columns].ravel() for rows in (slice(-1), slice(1, None)) for columns in (slice(-1), slice(1, None)))
    faces = numpy.empty(2 * len(a), [("count", "u1"), ("corners", "<u4", 3)])
    faces["count"] = 3
    faces["corners"] = numpy.concatenate([numpy.stack([a, c, d], 1), numpy.stack([a, d, b], 1)])
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {corner.size}\nproperty float x\nproperty float y\nproperty float z\n"
    header += f"element face {len(faces)}\nproperty list uchar uint vertex_indices\nend_header\n"
    (DATA / "mesh.ply").write_bytes(header.encode() + points.astype("<f4").tobytes() + faces.tobytes())


def make_clouds():
    """Points distributed evenly over a torus, with normals; the standard deviation of the noise is 1 % of the box's diagonal."""
    import numpy

    random, count = numpy.random.default_rng(1), 100_000
    u, v, keep = random.random((3, 2 * count)) * [[2 * numpy.pi], [2 * numpy.pi], [55]]
    u, v = (angle[keep < 40 + 15 * numpy.cos(v)][:count] for angle in (u, v))
    normals = numpy.stack([numpy.cos(v) * numpy.cos(u), numpy.sin(v), numpy.cos(v) * numpy.sin(u)], 1)
    points = 40 * numpy.stack([numpy.cos(u), 0 * u, numpy.sin(u)], 1) + 15 * normals
    diagonal = numpy.linalg.norm(numpy.ptp(points, axis=0))
    numpy.save(DATA / "cloud_clean.npy", points)
    numpy.save(DATA / "cloud_normals.npy", normals)
    numpy.save(DATA / "cloud.npy", points + random.normal(size=points.shape) * 0.01 * diagonal)


def make_balls(names, subdivisions):
    """Two overlapping balls; one is rotated, so that no edges are parallel."""
    import numpy
    import trimesh

    for name, middle, turn in zip(names, ((0, 0, 0), (5, 1, 2)), (0.0, 0.7)):
        ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=10)
        ball.apply_transform(trimesh.transformations.rotation_matrix(turn, (1, 2, 3)))
        numpy.save(DATA / f"{name}_v.npy", ball.vertices + middle)
        numpy.save(DATA / f"{name}_f.npy", ball.faces.astype("u4"))


def make_rough():
    """The koala with a texture that has a seam along a plane, and points of a torus with outliers."""
    import numpy
    import trimesh

    mesh = trimesh.load(PEERS.parent / "data/meshes/koala/koala.ply", process=False)
    places, faces = numpy.asarray(mesh.vertices, float), numpy.asarray(mesh.faces)
    numpy.save(DATA / "clean_v.npy", places)
    numpy.save(DATA / "clean_f.npy", faces.astype("<u4"))
    # Projections from the front and from the back, side by side in the texture.
    low, size = places.min(0), numpy.ptp(places, axis=0).max()
    flat = (places - low)[:, :2] / size / 2
    is_front = places[faces].mean(1)[:, 2] > places[:, 2].mean()
    numpy.save(DATA / "clean_uv.npy", flat[faces.ravel()] + numpy.repeat(is_front, 3)[:, None] * [0.5, 0.0])
    # A peer reads textures only from files, and only if there is a picture.
    import cv2

    cv2.imwrite(str(DATA / "clean.png"), numpy.full((4, 4, 3), 200, numpy.uint8))
    (DATA / "clean.mtl").write_text("newmtl all\nmap_Kd clean.png\n")
    uv, corners = numpy.unique(numpy.load(DATA / "clean_uv.npy"), axis=0, return_inverse=True)
    lines = ["mtllib clean.mtl", "usemtl all"]
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in places.tolist()] + [f"vt {u!r} {v!r}" for u, v in uv.tolist()]
    for face, texture in zip(faces + 1, corners.reshape(-1, 3) + 1):
        lines.append("f " + " ".join(f"{vertex}/{place}" for vertex, place in zip(face, texture)))
    (DATA / "clean.obj").write_text("\n".join(lines))
    random, cloud = numpy.random.default_rng(2), numpy.load(DATA / "cloud.npy")
    near = numpy.concatenate([cloud, cloud + random.normal(size=cloud.shape) * 0.1])
    far = random.random((2000, 3)) * 200 - 100
    numpy.save(DATA / "scattered.npy", numpy.concatenate([near, far]))


def make_bumpy():
    """A torus with bumps, of 100 000 triangles."""
    import numpy

    u, v, faces = torus_grid(250, 200)
    height = 2 * numpy.sin(9 * u) * numpy.cos(7 * v)
    save_torus("bumpy", u, v, height, faces)


def make_large_torus(name, rows, columns):
    """A torus with bumps and noise, whose standard deviation is a tenth of the mean edge."""
    import numpy

    u, v, faces = torus_grid(rows, columns)
    noise = numpy.random.default_rng(3).normal(size=len(u)) * 0.1 * 2 * numpy.pi * 28 / numpy.hypot(rows, columns)
    save_torus(name, u, v, bumps(u, v) + noise, faces)


def torus_grid(rows, columns):
    """The angles of the vertices of a grid that is closed in both directions, and its triangles."""
    import numpy

    i, j = (k.ravel() for k in numpy.mgrid[:rows, :columns])
    at = lambda a, b: a % rows * columns + b % columns
    a, b, c, d = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
    return 2 * numpy.pi * i / rows, 2 * numpy.pi * j / columns, numpy.concatenate([numpy.stack([a, b, c], 1), numpy.stack([a, c, d], 1)])


def save_torus(name, u, v, height, faces):
    import numpy

    tube = 15 + height
    out = 40 + tube * numpy.cos(v)
    numpy.save(DATA / f"{name}_v.npy", numpy.stack([out * numpy.cos(u), out * numpy.sin(u), tube * numpy.sin(v)], 1))
    numpy.save(DATA / f"{name}_f.npy", faces.astype("<u4"))


def wavy(width, height):
    import numpy

    y, x = numpy.mgrid[0:height, 0:width].astype(float)
    return numpy.stack([x, y, 700 + 5 * numpy.sin(0.1 * x) * numpy.cos(0.07 * y)], -1)


def write_pcd(path, points):
    height, width, _ = points.shape
    header = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
    header += f"WIDTH {width}\nHEIGHT {height}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {width * height}\nDATA binary\n"
    path.write_bytes(header.encode() + points.astype("<f4").tobytes())


# ---------------------------------------------------------------- measuring
# Runs a command, and prints its milliseconds and its peak memory in megabytes. Linux counts the memory of the parent at the time of the
# start, so the parent must be this small program and not the one that holds the data of peers.
COMMAND = """
import os, subprocess, sys, time
start = time.perf_counter()
done = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL)
_, status, usage = os.wait4(done.pid, 0)
print(1e3 * (time.perf_counter() - start), usage.ru_maxrss / 1024)
sys.exit(status != 0)
"""


class Ours:
    """Our program, which is restarted after some runs."""

    def __init__(self, work):
        self.work, self.process, self.peak, self.check, self.note = work, None, None, None, None

    def run(self, k):
        if isinstance(self.work, list):
            done = subprocess.run([sys.executable, "-ISc", COMMAND, *self.work], capture_output=True, text=True)
            if done.returncode != 0:
                sys.exit(f"{self.work} failed")
            milliseconds, self.peak = map(float, done.stdout.split())
            return milliseconds
        if k % RUNS_OF_A_PROCESS == 0:
            self.start()
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        return float(self.process.stdout.readline())

    def start(self):
        self.stop()
        command = [PROJECT / "target/release/examples/peers", DATA, *self.work.split()]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        check, *note = self.process.stdout.readline().split(maxsplit=1)
        self.check, self.note = float(check), "".join(note).strip()

    def stop(self):
        if self.process:
            self.peak = peak_of(self.process.pid)
            self.process.stdin.close()
            self.process.wait()
            self.process = None


def peak_of(pid):
    """The peak memory of a process, in MB."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return int(line.split()[1]) / 1024


def time_peer(peer):
    start = time.perf_counter()
    result = peer.run()
    milliseconds = 1e3 * (time.perf_counter() - start)
    if hasattr(peer, "milliseconds"):
        milliseconds = peer.milliseconds(result)
    return milliseconds, result


def measure(row, peer_word="", between=lambda: None, max_seconds=float("inf")):
    """Runs ours and each peer in turn, only peers with `peer_word` in their names, and calls `between` before each turn. A peer that has
    taken more than `max_seconds` is not run again after three runs."""
    peers, measured = [], RowResult(row)
    for open_peer in row.peers:
        try:
            peers.append(open_peer())
        except (ImportError, OSError) as error:
            measured.missing.append(f"no peer, {error}")
    peers = [peer for peer in peers if peer_word in peer.name]
    ours, measured.peers = Ours(row.ours), {peer.name: [] for peer in peers}
    seconds = dict.fromkeys(measured.peers, 0.0)
    for k in range(RUNS):
        between()
        measured.ours.append(ours.run(k))
        for peer in peers:
            if k == 0:
                _, result = time_peer(peer)
                measured.notes += notes(ours, peer, result)
                del result
            if k < 3 or seconds[peer.name] < max_seconds:
                start = time.perf_counter()
                milliseconds, result = time_peer(peer)
                seconds[peer.name] += time.perf_counter() - start
                measured.peers[peer.name].append(milliseconds)
                del result
    ours.stop()
    measured.peak = ours.peak
    return measured


def notes(ours, peer, result):
    if ours.note:
        yield f"ours is {ours.note}"
    if peer.check and ours.check is not None:
        theirs = peer.check(result)
        if abs(theirs - ours.check) > 1e-9 * max(abs(theirs), 1):
            yield f"ours gives {ours.check}, {peer.name} {theirs}"
    if hasattr(peer, "note"):
        yield f"{peer.name} is {peer.note(result)}"


LINE = "{:44} {:>7} {:>7} {:>5} {:>7}  {:32} {:>7} {:>7} {:>6}"


def show(measured):
    row = measured.row
    for note in measured.notes:
        print(f"  {row.name}: {note}")
    number = lambda x: f"{x:.1f}"
    middle, least = statistics.median(measured.ours), min(measured.ours)
    left = [row.name, number(middle), number(least), row.bar or "", f"{measured.peak:.0f}"]
    if not measured.peers:
        print(LINE.format(*left, "-", "", "", ""))
    for name, times in measured.peers.items():
        theirs = statistics.median(times)
        print(LINE.format(*left, name, number(theirs), number(min(times)), number(theirs / middle)))
        left = [""] * 5
    for peer in measured.missing:
        print(f"  {row.name}: {peer}")
    sys.stdout.flush()


# ---------------------------------------------------------------- packages
def enter_environment():
    """Restarts this program in the virtual environment of the peers, which is created if it does not exist."""
    python = WORK / "venv/bin/python"
    if Path(sys.prefix) == WORK / "venv":
        return
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", WORK / "venv"], check=True)
        known = PEERS / "requirements.txt"
        versions = {line.split("==")[0]: line for line in (known.read_text().split() if known.exists() else [])}
        for package in PACKAGES:
            wanted = versions.get(package, package)
            command = [python, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--only-binary=:all:", wanted]
            if subprocess.run(command).returncode != 0:
                print(f"cannot install {wanted}: its rows are measured without it")
    os.execv(python, [python, *sys.argv])


def holes():
    """Prints the table of all methods to fill holes, with CGAL and MeshLib if they are available. Needs no scripts of the peers."""
    environment = dict(os.environ, RAYON_NUM_THREADS=str(THREADS), OMP_NUM_THREADS=str(THREADS))
    try:
        environment["CGAL_FILL"] = str(cgal_program())
    except (ImportError, OSError, subprocess.CalledProcessError) as error:
        print(f"no CGAL: {error}")
    try:
        importlib.import_module("meshlib.mrmeshpy")
        environment["MESHLIB_PYTHON"] = sys.executable
    except ImportError as error:
        print(f"no MeshLib: {error}")
    sys.stdout.flush()
    words = [word for word in sys.argv[1:] if word != "holes"]
    subprocess.run(["cargo", "bench", "-q", "--bench", "fill", "--", *words], cwd=PROJECT, env=environment, check=True)


def build():
    """Builds our programs, and creates the folder of their outputs."""
    OUT.mkdir(parents=True, exist_ok=True)
    # Together, and without `--package`, so that the engine is compiled once, also for benchmarks.
    subprocess.run(["cargo", "build", "--release", "-q", "--bin", "maquette", "--example", "peers", "--features", "maquette-tests/oracles"], cwd=PROJECT, check=True)


def prepare():
    """Prepares packages and inputs for the rows."""
    enter_environment()
    os.environ.update(PEERS_DATA=str(DATA), RAYON_NUM_THREADS=str(THREADS), OMP_NUM_THREADS=str(THREADS), PYTHONDONTWRITEBYTECODE="1")
    sys.dont_write_bytecode = True
    sys.path.insert(0, str(PEERS))
    make_inputs()


def main():
    words = sys.argv[1:]
    if "holes" in words:
        WORK.mkdir(parents=True, exist_ok=True)
        enter_environment()
        return holes()
    if not PEERS.is_dir():
        sys.exit(f"skipped: {NO_PEERS}")
    prepare()
    build()
    print(LINE.format("work (milliseconds)", "ours", "min", "bar", "MB", "peer", "peer", "min", "ratio"))
    for row in ROWS:
        if not words or any(word in row.name for word in words):
            show(measure(row))


if __name__ == "__main__":
    main()
