"""PrusaSlicer, by its command line: it loads a file and saves it as OBJ."""

import pathlib
import subprocess
import tempfile

import record


def read(path: pathlib.Path) -> record.Record:
    with tempfile.TemporaryDirectory() as folder:
        output = pathlib.Path(folder) / "loaded.obj"
        words = ["--export-obj", "--no-ensure-on-bed", "--output", str(output), str(path)]
        done = subprocess.run(["prusa-slicer", *words], capture_output=True, text=True)
        if not output.is_file():
            lines = (done.stdout + done.stderr).strip().splitlines()
            raise ValueError(lines[-1] if lines else f"exit code {done.returncode}")
        rows = [line.split() for line in output.read_text().splitlines()]
    return {
        "points": [[float(x) for x in row[1:4]] for row in rows if row[:1] == ["v"]],
        "faces": [[int(word.split("/")[0]) - 1 for word in row[1:]] for row in rows if row[:1] == ["f"]],
    }


record.main(read)
