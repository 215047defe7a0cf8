"""Tests of the built extension: validated, installed, enabled, updated and removed by Blender's own commands."""

from __future__ import annotations

import os
import pathlib
import re
import shutil
import sys
import zipfile
from typing import Any, Callable, Iterable

import bpy
import pytest

from conftest import PACKAGE, Done

ZIP = pathlib.Path(os.environ["MAQUETTE_ZIP"])
VERSION = ZIP.stem.split("-")[1]
GRAPHS = pathlib.Path(__file__).resolve().parents[3] / "graphs"

ENABLE = f"import bpy; assert bpy.ops.preferences.addon_enable(module='{PACKAGE}') == {{'FINISHED'}}"


@pytest.fixture
def installed(extension: Callable[..., Done]) -> None:
    """Installs and enables the extension in an empty user folder."""
    install(extension, ZIP)


def install(extension: Callable[..., Done], zip: pathlib.Path) -> None:
    # The exit code is 0 even after some failures.
    done = extension("install-file", "--repo", "user_default", "--enable", zip)
    assert done.returncode == 0 and re.search('STATUS (Inst|Reinst)alled "maquette"', done.stdout), done.stdout + done.stderr


def changed(folder: pathlib.Path, old: str, new: str) -> pathlib.Path:
    """A copy of the extension with a changed manifest."""
    made = folder / "changed.zip"
    with zipfile.ZipFile(ZIP) as source, zipfile.ZipFile(made, "w") as target:
        for name in source.namelist():
            data = source.read(name)
            if name == "blender_manifest.toml":
                assert data.count(old.encode()) == 1, old
                data = data.replace(old.encode(), new.encode())
            target.writestr(name, data)
    return made


def traces() -> dict[str, set[str]]:
    """The things that an add-on can leave in Blender: names by place."""
    types = contents(bpy.types)
    drawn = {name: getattr(getattr(it, "draw", None), "_draw_funcs", ()) for name, it in types.items()}
    called = {name: it for name, it in contents(bpy.app.handlers).items() if isinstance(it, list)}
    keymaps = bpy.context.window_manager.keyconfigs.addon
    return {
        "classes": {f"{it.__module__}.{it.__qualname__}" for it in registered(bpy.types.bpy_struct)},
        "types": set(types),
        "operators": {f"{group}.{name}" for group, it in contents(bpy.ops).items() for name in dir(it)},
        "properties": {f"{name}.{key}" for name, it in types.items() if hasattr(it, "bl_rna") for key in it.bl_rna.properties.keys()},
        # Blender keeps a list of draw functions for each menu that ever had an additional one.
        "menus": {it for it in functions(drawn) if ": bl_ui." not in it},
        "handlers": functions(called),
        "keys": {f"{keymap.name}: {item.idname}" for keymap in keymaps.keymaps for item in keymap.keymap_items} if keymaps else set(),
    }


def contents(module: Any) -> dict[str, Any]:
    return {name: getattr(module, name) for name in dir(module)}


def functions(places: dict[str, Iterable[Any]]) -> set[str]:
    return {f"{place}: {it.__module__}.{it.__qualname__}" for place, all_of in places.items() for it in all_of}


def registered(kind: type) -> set[type]:
    """The subclasses of `kind` that add-ons and scripts have registered; Blender creates its own ones on access."""
    below = set()
    for it in kind.__subclasses__():
        below |= registered(it)
        if it.__module__ != "bpy.types" and getattr(it, "is_registered", False):
            below.add(it)
    return below


def test_1_blender_validates_the_zip(extension: Callable[..., Done]) -> None:
    print(f"{ZIP.name}: {ZIP.stat().st_size} bytes")
    done = extension("validate", ZIP)
    assert (done.returncode, "Success" in done.stdout) == (0, True), done.stdout + done.stderr


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"Node", ', '"Nodes", ', "Nodes"),
        ('files = "', 'disk = "', "disk"),
        (f'version = "{VERSION}"', 'version = "new"', "semantic-version"),
    ],
)
def test_1_the_validation_notices_faults(extension: Callable[..., Done], tmp_path: pathlib.Path, old: str, new: str, words: str) -> None:
    done = extension("validate", changed(tmp_path, old, new))
    assert done.returncode == 1 and words in done.stdout + done.stderr, done.stdout + done.stderr


def test_1_it_asks_for_files_and_nothing_else() -> None:
    import tomllib

    manifest = tomllib.loads(zipfile.ZipFile(ZIP).read("blender_manifest.toml").decode())
    assert list(manifest["permissions"]) == ["files"]
    assert manifest["blender_version_min"] == "4.2.0" and "blender_version_max" not in manifest
    assert manifest["version"] == VERSION
    # The manifest names exactly the wheels in the zip.
    wheels = {name for name in zipfile.ZipFile(ZIP).namelist() if name.endswith(".whl")}
    assert wheels == {it.removeprefix("./") for it in manifest["wheels"]} and wheels
    # One wheel for each Python of Blender since 4.2.
    assert all("-abi3-" in it for it in wheels)


@pytest.mark.usefixtures("installed")
def test_1_it_is_installed_and_stays_enabled(extension: Callable[..., Done], resources: pathlib.Path, blender: Callable[[str], Done]) -> None:
    assert "maquette [installed]" in extension("list").stdout
    assert PACKAGE.encode() in (resources / "config/userpref.blend").read_bytes()
    # The module of Blender 4.2 crashes when it reads saved preferences.
    if bpy.app.version >= (5, 0):
        done = blender(f"import bpy; bpy.ops.wm.read_userpref(); assert '{PACKAGE}' in bpy.context.preferences.addons")
        assert done.returncode == 0, done.stderr


@pytest.mark.usefixtures("installed")
def test_1_the_engine_is_the_extension_s_own_and_computes(resources: pathlib.Path, blender: Callable[[str], Done]) -> None:
    done = blender(
        f"""{ENABLE}
import importlib.metadata, maquette
print("file", maquette.__file__)
print("version", importlib.metadata.version("maquette"))
print("faces", len(maquette.load({str(GRAPHS / "hull.ron")!r}, cache=None).run()["hull.glb"].triangles))
from {PACKAGE} import preferences
print("engine", preferences.version())
"""
    )
    assert done.returncode == 0, done.stderr
    said = dict(line.split(" ", 1) for line in done.stdout.splitlines() if " " in line)
    # Blender's folder for packages of extensions.
    assert pathlib.Path(said["file"]).is_relative_to(resources / "extensions/.local/lib")
    assert said["version"] == VERSION and int(said["faces"]) > 0
    assert said["engine"] == f"Engine: maquette {VERSION}, in the extension"


def test_enabled_and_disabled_again_and_again_it_leaves_nothing() -> None:
    bpy.ops.preferences.addon_disable(module=PACKAGE)
    before = traces()
    for _ in range(3):
        assert bpy.ops.preferences.addon_enable(module=PACKAGE) == {"FINISHED"}
        during = traces()
        # The enabled add-on leaves traces, so that the comparison below is not trivial.
        assert any(it.startswith(PACKAGE) for it in during["classes"])
        assert bpy.ops.preferences.addon_disable(module=PACKAGE) == {"FINISHED"}
        after = traces()
        assert {place: after[place] ^ before[place] for place in before if after[place] != before[place]} == {}


def test_a_registration_that_fails_leaves_nothing(addon: Any) -> None:
    bpy.ops.preferences.addon_disable(module=PACKAGE)
    before = traces()

    class Broken:
        """A module that cannot be registered."""

        @staticmethod
        def register() -> None:
            raise RuntimeError("broken")

    modules = addon.MODULES
    addon.MODULES = (*modules, Broken)
    try:
        with pytest.raises(RuntimeError, match="broken"):
            addon.register()
    finally:
        addon.MODULES = modules
    assert traces() == before
    assert bpy.ops.preferences.addon_enable(module=PACKAGE) == {"FINISHED"}


@pytest.mark.usefixtures("installed")
def test_an_update_takes_the_place_of_what_is_there(
    extension: Callable[..., Done], blender: Callable[[str], Done], resources: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    install(extension, changed(tmp_path, f'version = "{VERSION}"', 'version = "99.0.0"'))
    assert 'version = "99.0.0"' in (resources / "extensions/user_default/maquette/blender_manifest.toml").read_text()
    assert blender(f"{ENABLE}\nimport maquette; maquette.nodes()").returncode == 0


@pytest.mark.usefixtures("installed")
def test_removed_it_takes_its_engine_along(extension: Callable[..., Done], resources: pathlib.Path) -> None:
    done = extension("remove", "maquette")
    assert done.returncode == 0, done.stdout + done.stderr
    assert not re.search(r"maquette \[", extension("list").stdout)
    left = [str(it.relative_to(resources)) for it in resources.rglob("*maquette*")]
    assert left == [], left


def test_it_imports_nothing_by_its_full_name(tmp_path: pathlib.Path) -> None:
    """Blender names the package after its repository, so it must register under any name."""
    shutil.copytree(pathlib.Path(sys.modules[PACKAGE].__file__ or "").parent, tmp_path / "elsewhere", ignore=shutil.ignore_patterns("wheels"))
    bpy.ops.preferences.addon_disable(module=PACKAGE)
    sys.path.insert(0, str(tmp_path))
    try:
        import elsewhere  # type: ignore[import-not-found]

        elsewhere.register()
        elsewhere.unregister()
    finally:
        sys.path.remove(str(tmp_path))
    assert bpy.ops.preferences.addon_enable(module=PACKAGE) == {"FINISHED"}
