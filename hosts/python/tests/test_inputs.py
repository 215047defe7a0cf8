"""Tests of array arguments: arrays of all kinds of numbers and layouts are converted without a change of values, or refused."""

from __future__ import annotations

import warnings
from typing import Any, Callable, Dict, Iterator, List, Tuple

import numpy as np
import pytest
from numpy.typing import NDArray

import maquette

pytestmark = pytest.mark.every_change

Array = NDArray[Any]

V = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]], dtype=float)
F = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
PICTURE = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
GRID = np.dstack([*np.meshgrid(np.arange(5.0), np.arange(4.0)), np.full((4, 5), 700.0)])

NUMBERS = ["i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f2", "f4", "f8", ">f8", ">f4", ">i2", "<u8", np.longdouble]
NO_NUMBERS = ["c8", "c16", "U3", "S3", "O", "M8[s]", "m8[s]", "V4", [("x", "f8")]]


class Subclass(np.ndarray):  # type: ignore[type-arg]
    """A user-defined subclass of arrays."""


def layouts(array: Array) -> Iterator[Array]:
    """The same numbers in other memory layouts."""
    yield array
    yield np.asfortranarray(array)
    yield np.repeat(array, 2, axis=0)[::2]
    yield array[::-1].copy()[::-1]
    yield array[..., ::-1].copy()[..., ::-1]
    yield np.moveaxis(np.moveaxis(array, -1, 0).copy(), 0, -1)
    fields = np.zeros(array.shape, [("other", "i1"), ("it", array.dtype)])
    fields["it"] = array
    yield fields["it"]
    yield array.view(Subclass)
    yield np.ma.masked_array(array)
    aligned = np.zeros(array.nbytes + 1, np.uint8)[1:].view(array.dtype)[: array.size].reshape(array.shape)
    aligned[...] = array
    yield aligned
    array = array.copy()
    array.flags.writeable = False
    yield array


# For each argument: the call that makes a value of an array, a suitable array of small integers, and the function that reads it back.
ARGUMENTS: Dict[str, Tuple[Callable[[Any], Any], Array, Callable[[Any], Array]]] = {
    "vertices": (lambda it: maquette.Mesh(it, F), V, lambda it: it.vertices),
    "replace": (lambda it: maquette.Mesh(V, F).replace(it), V + 1, lambda it: it.vertices),
    "uv": (lambda it: maquette.Mesh(V, F, uv=it), V[:, :2], lambda it: it.uv),
    "uv of corners": (lambda it: maquette.Mesh(V, F, uv=it), np.arange(24.0).reshape(12, 2), lambda it: it.uv),
    "normal": (lambda it: maquette.Mesh(V, F, normal=it), V + 1, lambda it: it.attributes["normal"]),
    "Points": (maquette.Points, V, lambda it: it.positions),
    "Field": (maquette.Field, PICTURE[..., 0].astype(float), lambda it: it.numbers),
    "Labels": (maquette.Labels, PICTURE[..., 0] // 3.0, lambda it: it.label),
    "RangeImage": (maquette.RangeImage, np.minimum(GRID, 100), lambda it: it.points),
    "depth": (lambda it: maquette.RangeImage(it, camera=(1, 1, 0, 0)), PICTURE[..., 0] + 1.0, lambda it: it.points[..., 2]),
    "Curve": (maquette.Curve, V, lambda it: it.points),
    "weights": (lambda it: maquette.Curve(V, knots=[0, 0, 0, 0, 1, 1, 1, 1], weights=it), np.array([1.0, 2, 2, 1]), lambda it: it.parts["weight"].array),
    "ControlNet": (maquette.ControlNet, np.minimum(GRID, 100), lambda it: it.points),
    "weights of a net": (lambda it: maquette.ControlNet(GRID, it), PICTURE[..., 0] + 1.0, lambda it: it.weights),
    "Surface": (maquette.Surface, np.minimum(GRID, 100), lambda it: it.points),
    "weights of a surface": (lambda it: maquette.Surface(GRID, it), PICTURE[..., 0] + 1.0, lambda it: it.weights),
    "knots_u": (lambda it: maquette.Surface(GRID, knots_u=it), np.array([0.0, 0, 0, 0, 1, 1, 1, 1]), lambda it: it.knots[0]),
    "knots_v": (lambda it: maquette.Surface(GRID, knots_v=it), np.array([0.0, 0, 0, 0, 1, 2, 2, 2, 2]), lambda it: it.knots[1]),
    "camera": (lambda it: maquette.RangeImage(GRID, camera=it), np.array([100.0, 90, 2, 1]), lambda it: np.array(it.camera)),
    "replaced points": (lambda it: maquette.RangeImage(GRID).replace(it), np.minimum(GRID, 100), lambda it: it.points),
    "sigma": (lambda it: maquette.Handles(V, sigma=it, space="World"), V + 1, lambda it: it.parts["sigma"].array),
    "weight": (lambda it: maquette.Handles(V, weight=it, space="World"), np.array([1.0, 2, 2, 1]), lambda it: it.parts["weight"].array),
    "knots": (lambda it: maquette.KnotVector(it, degree=1), np.array([0.0, 0, 1, 1]), lambda it: it.knots),
    "at": (lambda it: maquette.Handles(it, space="World"), V, lambda it: it.at),
    "to": (lambda it: maquette.Handles(V, it, space="World"), V, lambda it: it.to),
    "Direction": (maquette.Direction, np.array([0.0, 0, 1]), lambda it: it.vector),
}


# Arguments in which numbers may be missing.
MISSING = ("Field", "RangeImage", "depth", "replaced points")


@pytest.mark.parametrize("name", ARGUMENTS)
def test_numbers_of_all_kinds_and_layouts_are_taken(name: str) -> None:
    make, array, back = ARGUMENTS[name]
    meant = make(array.astype(np.float32))
    for kind in NUMBERS:
        for layout in layouts(array.astype(kind)):
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                value = make(layout)
            assert (back(value) == array).all(), kind
            assert value == meant, kind


@pytest.mark.parametrize("name", ARGUMENTS)
def test_what_is_no_number_is_refused(name: str) -> None:
    make, array, _ = ARGUMENTS[name]
    for kind in NO_NUMBERS:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            other = array.astype("i8").astype(kind)
        with pytest.raises(ValueError, match="expected numbers"):
            make(other)


@pytest.mark.parametrize("name", [name for name in ARGUMENTS if name != "Labels"])
def test_bools_are_no_measures(name: str) -> None:
    make, array, _ = ARGUMENTS[name]
    with pytest.raises(ValueError, match="bools|flags|\\(n, 3\\)"):
        make(array > 0)


@pytest.mark.parametrize("name", ARGUMENTS)
def test_masked_numbers_are_not_there_or_refused(name: str) -> None:
    make, array, back = ARGUMENTS[name]
    mask = np.zeros(array.shape, bool)
    mask.reshape(-1)[1] = True
    if name in MISSING:
        for kind in ("f8", "f4", "i4", "u2"):
            numbers = back(make(np.ma.masked_array(array.astype(kind), mask)))
            assert np.isnan(numbers.reshape(-1)[1]) and not np.isnan(numbers.reshape(-1)[4])
    elif name == "Labels":
        assert back(make(np.ma.masked_array(array, mask))).reshape(-1)[1] == 0
    else:
        with pytest.raises(ValueError, match="masked|not finite"):
            make(np.ma.masked_array(array, mask))


@pytest.mark.parametrize("name", [name for name in ARGUMENTS if name not in MISSING])
def test_what_is_not_finite_is_refused_where_numbers_must_be_there(name: str) -> None:
    make, array, _ = ARGUMENTS[name]
    for number in (np.nan, np.inf, -np.inf):
        wrong = array.copy()
        wrong.reshape(-1)[1] = number
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with pytest.raises(ValueError):
                make(wrong)


@pytest.mark.parametrize("name", [name for name in ARGUMENTS if name != "RangeImage"])
def test_other_shapes_are_refused(name: str) -> None:
    make, array, _ = ARGUMENTS[name]
    more = np.concatenate([array, array[:1]])
    wide = np.concatenate([array, array], axis=-1)
    others = [array[None], array.reshape(-1)[:-1], np.zeros((2, 2, 2, 2)), np.array(1.0), wide if array.ndim > 1 else array[:, None]]
    if name in ("uv", "uv of corners", "normal", "weights", "to", "weights of a net", "sigma", "weight", "camera", "replaced points"):
        others.append(more)
    for other in others:
        is_net = name in ("ControlNet", "Surface") and other.shape[-1:] == (3,) and other.ndim == 3
        if name in ("Field", "Labels", "depth") and other.ndim == 2 or is_net:
            continue
        if name == "knots" and other.ndim == 1:
            continue
        with pytest.raises(ValueError):
            make(other)


# Arguments that take integers, flags or colors, in the format of the table above, with the types of numbers that they accept.
COUNTS: Dict[str, Tuple[Callable[[Any], Any], Array, Callable[[Any], Array], str]] = {
    "faces": (lambda it: maquette.Mesh(V, it), F, lambda it: it.faces, "i1 i2 i4 i8 u1 u2 u4 u8 >i4 >u2"),
    "replaced faces": (lambda it: maquette.Mesh(V, F).replace(faces=it), F[::-1], lambda it: it.faces, "i1 i2 i4 i8 u1 u2 u4 u8 >i4 >u2"),
    "flags": (lambda it: maquette.Mesh(V, F, it=it), V[:, 0] > 0, lambda it: it.attributes["it"], "?"),
    "ids": (lambda it: maquette.Points(V, it=it), np.array([3, 0, 7, 1]), lambda it: it.attributes["it"], "i1 i2 i4 i8 u1 u2 u4 u8 >i4 >u2"),
    "numbers": (lambda it: maquette.Mesh(V, F, it=it), V[:, :2] / 4, lambda it: it.attributes["it"], "f2 f4 f8 >f8 >f4"),
    "numbers of corners": (
        lambda it: maquette.Mesh(V, F, corner_attributes={"it": it}),
        np.arange(24.0).reshape(12, 2),
        lambda it: it.corner_attributes["it"],
        "i2 i4 u8 f2 f4 f8 >f8",
    ),
    "ids of faces": (lambda it: maquette.Mesh(V, F, face_attributes={"it": it}), np.arange(4), lambda it: it.face_attributes["it"], "i1 i8 u4 >i4"),
    "color": (lambda it: maquette.Points(V, color=it), PICTURE[0, :4], lambda it: it.attributes["color"], "u1"),
    "Mask": (maquette.Mask, PICTURE[..., 0] % 2, lambda it: it.inside, "? i1 i2 i4 i8 u1 u2 u4 u8 >i4"),
    "Image": (maquette.Image, PICTURE, lambda it: it.pixels, "u1"),
    "Image of 16 bits": (maquette.Image, PICTURE.astype("u2") * 257, lambda it: it.pixels.astype("u2") * 257, "u2 >u2"),
    "texture": (lambda it: maquette.Mesh(V, F, uv=V[:, :2], texture=it), PICTURE, lambda it: it.texture.pixels, "u1"),
    "color of a range image": (lambda it: maquette.RangeImage(GRID, it), PICTURE, lambda it: it.color, "u1"),
}


@pytest.mark.parametrize("name", COUNTS)
def test_whole_numbers_flags_and_colors_of_all_layouts_are_taken(name: str) -> None:
    make, array, back, kinds = COUNTS[name]
    for kind in kinds.split():
        for layout in layouts(array.astype(kind)):
            value = make(layout)
            assert (back(value) == array).all() and value == make(np.ascontiguousarray(array.astype(kind)))


EVERY: Dict[str, Tuple[Callable[[Any], Any], Array]] = {name: found[:2] for table in (ARGUMENTS, COUNTS) for name, found in table.items()}  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", EVERY)
def test_a_number_alone_and_no_number_at_all_are_taken_as_meant_or_refused(name: str) -> None:
    make, array = EVERY[name]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for alone in (array.dtype.type(1), np.array(1, array.dtype), 1, 1.0, True, "1"):
            with pytest.raises((ValueError, TypeError)):
                make(alone)
        for axis in range(array.ndim):
            empty = np.take(array, [], axis)
            for nothing in (empty, empty.astype(float), empty.tolist(), []):
                try:
                    value = make(nothing)
                except (ValueError, TypeError):
                    continue
                assert maquette.Value.from_parts(value.kind, value.parts, value.facts) == value


@pytest.mark.parametrize("name", EVERY)
def test_one_number_that_stands_for_all_is_as_many(name: str) -> None:
    make, array = EVERY[name]
    wide = np.broadcast_to(array.reshape(-1)[:1], array.shape)
    made: List[Any] = []
    for given in (wide, wide.copy()):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                made.append(make(given))
        except ValueError as error:
            made.append(str(error))
    assert made[0] == made[1]


def test_a_direction_is_as_long_as_it_may_be() -> None:
    for length in (1e-300, 1e-160, 1.0, 1e160, 1e300):
        assert np.allclose(maquette.Direction([0.0, 3 * length, 4 * length]).vector, [0, 0.6, 0.8])
    for wrong in ([0.0, np.inf, 0.0], [np.nan, 0.0, 1.0], [0.0, 0.0, 0.0]):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with pytest.raises(ValueError):
                maquette.Direction(wrong)


def test_colors_and_points_have_the_same_rows_and_columns() -> None:
    for shape in ((5, 4, 3), (2, 10, 3), (20, 1, 3), (1, 20, 3), (4, 4, 3)):
        with pytest.raises(ValueError, match="rows and columns"):
            maquette.RangeImage(GRID, np.zeros(shape, np.uint8))
        for parts in ({"point": ("pixel", GRID), "color": ("pixel", np.zeros(shape, np.uint8))},) * 2:
            with pytest.raises(ValueError, match="rows and columns"):
                maquette.Value.from_parts("RangeImage", dict(reversed(list(parts.items()))))
        with pytest.raises(ValueError, match="rows and columns"):
            maquette.RangeImage(GRID).replace(color=np.zeros(shape, np.uint8))
    assert maquette.RangeImage(GRID, PICTURE).points.shape == GRID.shape
    for weights in (np.ones((5, 4)), np.ones(20), np.ones((2, 10))):
        with pytest.raises(ValueError, match="weights"):
            maquette.ControlNet(GRID, weights)


@pytest.mark.parametrize("name", ["position", "corners", "sides", "creases", "frame", "pose", "texture", "texture size", "face x", "corner x"])
def test_no_attribute_takes_the_place_of_something_else(name: str) -> None:
    array: Any = V + 1 if name == "position" else [1, 2, 3, 4]
    if name != "texture":
        with pytest.raises(ValueError, match="another name"):
            maquette.Mesh(V, F, **{name: array})
        with pytest.raises(ValueError, match="another name"):
            maquette.Points(V, **{name: array})
    for attributes in ("face_attributes", "corner_attributes"):
        with pytest.raises(ValueError, match="another name"):
            maquette.Mesh(V, F, **{attributes: {name: array}})  # type: ignore[arg-type]


MAKERS: List[Callable[[Any], Array]] = [
    lambda it: maquette.Mesh(V, F, it=it).attributes["it"],
    lambda it: maquette.Mesh(V, F, face_attributes={"it": it}).face_attributes["it"],
    lambda it: maquette.Mesh(V, F, corner_attributes={"it": np.resize(it, (12, *np.shape(it)[1:]))}).corner_attributes["it"][:4],
    lambda it: maquette.Points(V, it=it).attributes["it"],
    lambda it: maquette.Mesh(V, F).replace(it=it).attributes["it"],
    lambda it: maquette.Value.from_parts("Points", {"position": ("point", V), "it": ("point", it)}).parts["it"].array,
]


@pytest.mark.parametrize("make", MAKERS)
def test_bools_and_integers_come_back_as_they_went_in(make: Callable[[Any], Array]) -> None:
    flags = np.array([False, True, False, True])
    back = make(flags)
    assert back.dtype == np.bool_ and V[back].tolist() == V[[1, 3]].tolist() and (~back == ~flags).all()
    for kind in ("i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", ">i4"):
        back = make(np.array([0, 1, 100, 3], kind))
        assert back.dtype.kind == "u" and back.tolist() == [0, 1, 100, 3]
    assert make(np.array([0, 2**32 - 1, 2, 3])).tolist() == [0, 2**32 - 1, 2, 3]
    for kind in ("f4", "f8"):
        assert make(np.array([0.25, -1, np.nan, 3], kind)).dtype.kind == "f"
    for array, number in (
        (np.array([-1, 0, 1, 2]), -1),
        (np.array([0, 2**33, 2, 3]), 2**33),
        (np.array([0, 2**53 + 1, 2, 3]), 2**53 + 1),
        (np.array([0, 1, 2, 2**64 - 1], np.uint64), 2**64 - 1),
        (np.array([0, 1, -128, 3], np.int8), -128),
    ):
        with pytest.raises(ValueError, match=f"is {number}"):
            make(array)


def test_ids_stay_ids_when_nodes_mix_numbers() -> None:
    text = 'Graph(format: 1, inputs: {"m": Mesh(doc: "")}, nodes: {"t": Subdivide(mesh: "m", scheme: Loop, levels: 1)}, outputs: {"t": "t"})'
    graph = maquette.load("ids.ron", text=text, cache=None)
    run = graph.run(inputs={"m": maquette.Mesh(V, F, label=[0, 1, 2, 3], seen=[True, False, True, True])})
    mesh = run.value("t", maquette.Mesh)
    assert mesh.attributes["label"].dtype == np.uint32 and mesh.attributes["seen"].dtype == np.bool_


def test_labels_that_get_other_numbers_are_told() -> None:
    with pytest.warns(UserWarning, match=r"number \(0, 1\) is 7, kept as 1"):
        assert maquette.Labels([[0, 7], [9, 7]]).label.tolist() == [[0, 1], [2, 1]]
    with pytest.raises(ValueError, match="is -1"):
        maquette.Labels([[0, -1]])


def test_marks_of_all_values_are_bools() -> None:
    mask, image = maquette.Mask(np.eye(3, dtype=bool)), maquette.RangeImage(GRID)
    for array in (mask.inside, mask.parts["inside"].array, image.filled, image.parts["filled"].array):
        assert array.dtype == np.bool_
    for value in (mask, image, maquette.Mesh(V, F, seen=V[:, 0] > 0)):
        assert maquette.Value.from_parts(value.kind, value.parts, value.facts) == value


def test_a_field_says_what_single_precision_rounds() -> None:
    with pytest.warns(UserWarning, match=r"number \(0, 1\) is 0.1, kept as 0.1"):
        maquette.Field([[0.5, 0.1]])
    for wrong in ([[2**24 + 1]], [[-(2**40) - 1]], [[2**63 - 1]], [[1e300]], np.array([[2**53 + 1]])):
        with pytest.raises(ValueError, match="single precision"):
            maquette.Field(wrong)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for right in ([[0.5, np.nan, np.inf]], [[2**40, -(2**24)]], np.array([[0.1]], np.float32)):
            assert (maquette.Field(right).numbers.astype(float) == np.asarray(right, dtype=float))[0, 0]


def test_pictures_are_what_files_of_them_are(tmp_path: Any) -> None:
    Image = pytest.importorskip("PIL.Image")
    wide = (np.arange(20, dtype=np.uint16).reshape(4, 5) * 3277).astype(np.uint16)
    Image.fromarray(wide).save(tmp_path / "gray.png")
    read = maquette.read(tmp_path / "gray.png", maquette.Image)
    assert maquette.Image(Image.open(tmp_path / "gray.png")) == read
    assert maquette.Image(Image.fromarray(wide.astype(np.int32))) == read
    assert maquette.Image(np.repeat(wide[..., None], 3, axis=2)) == read
    alpha = np.dstack([PICTURE, np.full((4, 5), 7, np.uint8)])
    for mode, picture in (("RGBA", alpha), ("L", PICTURE[..., 0]), ("RGB", PICTURE)):
        Image.fromarray(picture).save(tmp_path / "it.png")
        assert maquette.Image(Image.open(tmp_path / "it.png")) == maquette.read(tmp_path / "it.png"), mode
    light = Image.fromarray(np.array([[0.0, 0.5, 1.0]], np.float32))
    assert maquette.Image(light).pixels[0, :, 0].tolist() == [0, 188, 255]
    for wrong in (light.point(lambda it: it * 255), Image.fromarray(np.array([[70000]], np.int32)), Image.fromarray(np.array([[-1]], np.int32))):
        with pytest.raises(ValueError, match="from 0 to"):
            maquette.Image(wrong)


@pytest.mark.parametrize("wrong", [alpha for alpha in (PICTURE / 255, PICTURE.astype("i8"), PICTURE[..., :2], PICTURE[..., 0], PICTURE > 3)])
def test_other_pictures_are_refused(wrong: Array) -> None:
    for make in (maquette.Image, lambda it: maquette.Mesh(V, F, uv=V[:, :2], texture=it), lambda it: maquette.RangeImage(GRID, it)):
        with pytest.raises(ValueError, match="uint8"):
            make(wrong)
    with pytest.raises(ValueError, match="masked"):
        maquette.Image(np.ma.masked_array(PICTURE, PICTURE > 3))


def test_colors_may_be_floats_and_must_be_opaque() -> None:
    levels = np.array([[0, 128, 255]] * 4, np.uint8)
    for color in (levels, levels / 255, (levels / 255).astype("f4"), np.c_[levels, np.full(4, 255, np.uint8)], np.c_[levels / 255, np.ones(4)]):
        assert maquette.Mesh(V, F, color=color).attributes["color"].tolist() == levels.tolist()
        assert maquette.Points(V, color=color).attributes["color"].dtype == np.uint8
    for wrong in (levels * 1.0, -(levels / 255), levels.astype(int), np.c_[levels, levels[:, :1]], levels[:, 0], levels / 255 * np.nan):
        with pytest.raises(ValueError, match="color"):
            maquette.Mesh(V, F, color=wrong)


@pytest.mark.parametrize("faces", [F > 1, F * 1.0, F * 1j, F.astype(str), np.ma.masked_array(F, F > 2), F - 1, F + 2**32, [[0, 1, 2.5]], [[0, 1, None]]])
def test_faces_are_numbers_of_vertices(faces: Any) -> None:
    with pytest.raises(ValueError):
        maquette.Mesh(V, faces)
    with pytest.raises(ValueError):
        maquette.Mesh(V, F).replace(faces=faces)
