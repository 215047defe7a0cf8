"""Units and transforms of live objects: the scene's units, and a persistent transform from the graph's values to the mesh.

The transform is what users have applied to the mesh (Apply > Scale, Set Origin), and for a new object the move of its origin to its center.
"""

from __future__ import annotations

import pathlib
from typing import Any

import bpy
from mathutils import Matrix

# Custom properties of a mesh with the transform, by rows, and with the axes of the values that it applies to.
APPLIED = "maquette_applied"
APPLIED_AXES = "maquette_applied_axes"

# A millimeter in meters.
MILLIMETER = 0.001

# A mesh was transformed as a whole if the deviation of each vertex is at most this fraction of its size.
TOLERANCE = 1e-4


def scale(scene: bpy.types.Scene) -> float:
    """The length of a millimeter in the units of a scene."""
    units = scene.unit_settings
    return MILLIMETER / (units.scale_length if units.system != "NONE" and units.scale_length > 0 else 1.0)


def world_matrix(owner: bpy.types.Object) -> Matrix:
    """The matrix of an object in the world, valid also before the scene is evaluated again."""
    return owner.matrix_world if owner.parent or len(owner.constraints) else owner.matrix_basis


def transform_of(mesh: bpy.types.Mesh | None) -> Matrix:
    """The transform from the graph's values to the mesh."""
    numbers = list((mesh.get(APPLIED) if mesh else None) or ())
    return Matrix([numbers[at : at + 4] for at in range(0, 16, 4)]) if len(numbers) == 16 else Matrix.Identity(4)


def set_transform(mesh: bpy.types.Mesh, transform: Matrix, axes: str) -> None:
    """Sets the transform for all later values."""
    mesh[APPLIED] = [number for row in transform for number in row]
    mesh[APPLIED_AXES] = axes


def change_axes(mesh: bpy.types.Mesh, axes: str, turn: Matrix) -> None:
    """Adapts the transform to values with other axes, for which the object itself is rotated by `turn`."""
    if APPLIED in mesh.keys() and mesh.get(APPLIED_AXES) != axes:
        set_transform(mesh, turn.inverted() @ transform_of(mesh) @ turn, axes)


def transform_positions(mesh: bpy.types.Mesh, places: Any) -> Any:
    """Transforms the positions of a value to positions of the mesh, as flat arrays."""
    import numpy as np

    if places is None or APPLIED not in mesh.keys():
        return places
    transform = np.array(transform_of(mesh))
    whole = places.reshape(-1, 3).astype("f8") @ transform[:3, :3].T + transform[:3, 3]
    return whole.astype("f4").ravel()


def transform_normals(mesh: bpy.types.Mesh, normals: Any) -> Any:
    """Transforms the normals of a value to normals of the mesh, one row for each element."""
    import numpy as np

    transform = np.array(transform_of(mesh))[:3, :3]
    if (transform == np.identity(3)).all():
        return normals
    found = normals @ np.linalg.pinv(transform)
    return (found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-30)).astype("f4")


def center(owner: bpy.types.Object, places: Any, axes: str, stays: bool) -> None:
    """Moves the origin of an object to the center of its first value; if `stays`, the mesh keeps its position, else the origin does."""
    import numpy as np

    whole = places.reshape(-1, 3).astype("f8")
    middle = Matrix.Translation(((whole.min(0) + whole.max(0)) / 2).tolist())
    set_transform(owner.data, middle.inverted(), axes)
    if stays:
        owner.matrix_basis = owner.matrix_basis @ middle


def learn_transform(mesh: bpy.types.Mesh, folder: pathlib.Path, file: str, axes: str) -> bool:
    """Finds and stores the affine transform from the positions in a file to the mesh; returns false if there is no such transform."""
    import numpy as np

    try:
        were = np.fromfile(folder / file, "<f4").reshape(-1, 3).astype("f8")
    except OSError:
        return False
    are = np.empty(3 * len(mesh.vertices), "f4")
    mesh.vertices.foreach_get("co", are)
    are = are.reshape(-1, 3).astype("f8")
    if len(were) != len(are) or len(were) < 3 or not np.isfinite(are).all():
        return False
    middle = were.mean(0)
    # In flat meshes, the normal direction is undetermined: it is scaled like the others.
    axis, sizes, _ = np.linalg.svd((were - middle).T, full_matrices=False)
    from_, to = were - middle, are - are.mean(0)
    if sizes[1] <= 1e-6 * sizes[0]:
        return False
    if sizes[2] <= 1e-6 * sizes[0]:
        images = [to.T @ (from_ @ axis[:, k]) / max(sizes[k] ** 2, 1e-300) for k in (0, 1)]
        normal = np.cross(*images)
        normal *= np.linalg.det(axis) / max(np.sqrt(np.linalg.norm(normal)), 1e-300)
        linear = np.column_stack([*images, normal]) @ axis.T
    else:
        linear = np.linalg.solve(from_.T @ from_, from_.T @ to).T
    move = are.mean(0) - linear @ middle
    size = np.linalg.norm(are.max(0) - are.min(0))
    if np.abs(were @ linear.T + move - are).max() > TOLERANCE * size or abs(np.linalg.det(linear)) < 1e-18:
        return False
    whole = np.identity(4)
    whole[:3, :3], whole[:3, 3] = linear, move
    set_transform(mesh, Matrix(whole.tolist()), axes)
    return True
