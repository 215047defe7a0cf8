"""PCL, by its command line tools, which convert point clouds to ASCII PCD."""

import pathlib
import subprocess
import tempfile

import record


def read(path: pathlib.Path) -> record.Record:
    with tempfile.TemporaryDirectory() as folder:
        output = pathlib.Path(folder) / "cloud.pcd"
        binary = pathlib.Path(folder) / "binary.pcd"
        if path.suffix == ".ply":
            command("pcl_ply2pcd", "-format", "0", path, output)
        elif path.suffix == ".pcd":
            command("pcl_convert_pcd_ascii_binary", path, output, "0")
        elif path.suffix == ".obj":
            command("pcl_obj2pcd", path, binary)
            command("pcl_convert_pcd_ascii_binary", binary, output, "0")
        else:
            command("pcl_converter", "-f", "ascii", "-c", path, output)
        return parse(output.read_text())


def command(*words: object) -> None:
    output = next(word for word in reversed(words) if str(word).endswith(".pcd"))
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True)
    if done.returncode != 0 or not pathlib.Path(str(output)).is_file():
        lines = (done.stdout + done.stderr).strip().splitlines()
        raise ValueError(lines[-1] if lines else f"{words[0]}: exit code {done.returncode}")


def parse(text: str) -> record.Record:
    head, _, body = text.partition("DATA ascii\n")
    header = dict(line.split(" ", 1) for line in head.splitlines() if not line.startswith("#"))
    fields, kinds = header["FIELDS"].split(), header["TYPE"].split()
    rows = [line.split() for line in body.splitlines()]
    # The coordinates of invalid cells are NaN.
    rows = [row for row in rows if row[0] != "nan"]
    found = {"points": [[float(x) for x in row[:3]] for row in rows], "colors": [], "normals": [], "wear": []}
    if "normal_x" in fields:
        first = fields.index("normal_x")
        found["normals"] = [[float(x) for x in row[first : first + 3]] for row in rows]
    if "wear" in fields:
        found["wear"] = [[float(row[fields.index("wear")])] for row in rows]
    if "rgb" in fields:
        place = fields.index("rgb")
        if kinds[place] == "F":
            raise ValueError("colors are floats")
        packed = [int(row[place]) for row in rows]
        found["colors"] = [[it >> 16 & 255, it >> 8 & 255, it & 255] for it in packed]
    return found


record.main(read)
