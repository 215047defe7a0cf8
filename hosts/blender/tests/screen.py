"""Takes pictures of the add-on in a real window: Debian's Blender on a screen in memory, drawn in software.

    python3 hosts/blender/tests/screen.py SCRIPT FOLDER [WIDTHxHEIGHT]

`SCRIPT` has a generator `shots(window)`, which `window.py` runs inside Blender, with the add-on registered from its source folder. It
yields a name to take the picture `FOLDER/NAME.png`, a number to wait for so many seconds, or None to let Blender draw. It runs in a timer,
as the add-on does. A script that raises or takes no picture fails.

Needs Debian's blender libgl1-mesa-dri xdotool xvfb.
"""

from __future__ import annotations

import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
NEEDED = ("blender", "Xvfb", "xdotool")


def missing() -> list[str]:
    """The required programs that are not installed."""
    return [it for it in NEEDED if not shutil.which(it)]


def take(script: pathlib.Path, folder: pathlib.Path, size: tuple[int, int] = (1600, 1000), seconds: float = 120) -> dict[str, pathlib.Path]:
    """Runs `script` and returns its pictures by name."""
    width, height = size
    folder.mkdir(parents=True, exist_ok=True)
    before = {it: it.stat().st_mtime_ns for it in folder.glob("*.png")}
    with tempfile.TemporaryDirectory() as resources, tempfile.TemporaryFile() as log:
        # The X server chooses a free display number and prints it.
        words = ["-screen", "0", f"{width}x{height}x24", "-nolisten", "tcp", "-displayfd", "1"]
        server = subprocess.Popen(["Xvfb", *words], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        try:
            assert server.stdout
            environment = {
                **os.environ,
                "DISPLAY": f":{server.stdout.readline().decode().strip()}",
                # Debian's Blender takes its modules from the Python that it finds first.
                "PATH": os.pathsep.join(["/usr/bin", os.environ["PATH"]]),
                "LIBGL_ALWAYS_SOFTWARE": "1",
                "BLENDER_USER_CONFIG": resources,
                "BLENDER_USER_SCRIPTS": resources,
                "PYTHONDONTWRITEBYTECODE": "1",
            }
            blender = ["blender", "--factory-startup", "--no-window-focus", "--window-geometry", "0", "0", str(width), str(height)]
            inside = ["--python-exit-code", "1", "--python", str(HERE / "window.py"), "--", str(script.resolve()), str(folder.resolve())]
            done = subprocess.run(
                [*blender, *inside], env=environment, timeout=seconds, stdout=log, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL
            )
            log.seek(0)
            said = log.read().decode(errors="replace")
        finally:
            server.terminate()
            server.wait()
    if done.returncode != 0:
        raise RuntimeError(f"{script.name} ended with {done.returncode}\n{said}")
    pictures = {it.stem: it for it in sorted(folder.glob("*.png")) if it.stat().st_mtime_ns != before.get(it)}
    if not pictures:
        raise RuntimeError(f"{script.name} took no picture\n{said}")
    return pictures


def main(words: list[str]) -> None:
    """The command line."""
    script, folder = map(pathlib.Path, words[:2])
    width, height = map(int, (words[2] if len(words) > 2 else "1600x1000").split("x"))
    for path in take(script, folder, (width, height)).values():
        print(path)


if __name__ == "__main__":
    main(sys.argv[1:])
