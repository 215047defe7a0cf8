"""CloudCompare, by its command line: it loads a file and saves it as ASCII PLY."""

import os
import pathlib
import shutil
import subprocess
import tempfile

import record

# CloudCompare needs a window system even without a window.
os.environ["QT_QPA_PLATFORM"] = "offscreen"


def read(path: pathlib.Path) -> record.Record:
    with tempfile.TemporaryDirectory() as folder:
        for file in path.parent.glob(f"{path.stem}.*"):
            shutil.copy(file, folder)
        # A temporary home, so that the user's settings are not changed.
        environment = {**os.environ, "HOME": folder, "XDG_CONFIG_HOME": folder}
        words = "-SILENT -NO_TIMESTAMP -AUTO_SAVE OFF -C_EXPORT_FMT PLY -M_EXPORT_FMT PLY -PLY_EXPORT_FMT ASCII".split()
        outputs = {kind: pathlib.Path(folder) / f"loaded-{kind}.ply" for kind in ("MESHES", "CLOUDS")}
        for kind, output in outputs.items():
            files = ["-O", str(pathlib.Path(folder) / path.name), f"-SAVE_{kind}", "FILE", str(output)]
            done = subprocess.run(["CloudCompare", *words, *files], capture_output=True, text=True, env=environment)
            if output.is_file():
                return parse(output.read_text(errors="replace"), path)
    lines = [line for line in done.stdout.splitlines() if "Processed" not in line and line.strip()]
    raise ValueError(lines[-1] if lines else f"exit code {done.returncode}")


def parse(text: str, path: pathlib.Path) -> record.Record:
    head, _, body = text.partition("end_header\n")
    elements = []
    for line in head.splitlines():
        words = line.split()
        if words[0] == "element":
            elements.append((words[1], int(words[2]), []))
        elif words[0] == "property":
            elements[-1][2].append(words[-1])
    lines = iter(body.splitlines())
    found = {"points": [], "faces": [], "colors": [], "normals": []}
    for name, count, properties in elements:
        rows = [next(lines).split() for _ in range(count)]
        if name == "vertex":
            columns = lambda *names: [[float(row[properties.index(it)]) for it in names] for row in rows] if names[0] in properties else []
            found["points"] = columns("x", "y", "z")
            found["colors"] = columns("red", "green", "blue")
            found["normals"] = columns("nx", "ny", "nz")
        elif name == "face":
            found["faces"] = [[int(x) for x in row[1:4]] for row in rows]
            if any(len(row) > 10 for row in rows):
                pairs = [[float(x) for x in row[5:11]] for row in rows]
                found["uv"] = [row[k : k + 2] for row in pairs for k in (0, 2, 4)]
    if path.suffix == ".obj":
        # Corner normals are lost when CloudCompare saves PLY.
        del found["normals"]
    if path.suffix == ".ptx":
        found["points"] = record.scaled(found["points"], 1000)
    return found


record.main(read)
