"""A host of maquette in sixty lines, without dependencies: runs a graph by `maquette serve --stdio` and prints its results.

    python examples/serve.py target/debug/maquette graphs/doll.ron growth=20 growth=30
"""

import array
import json
import os
import subprocess
import sys


class Server:
    """A process of `maquette serve`, and requests to it."""

    def __init__(self, program, *options):
        self.process = subprocess.Popen(
            [program, "serve", "--stdio", *options], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8"
        )
        self.folder = self.read_event()["folder"]
        self.last_id = 0

    def read_event(self):
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit("the server has ended")
        return json.loads(line)

    def ask(self, do, **fields):
        """Sends a request and returns its answer."""
        self.last_id += 1
        self.process.stdin.write(json.dumps({"id": self.last_id, "do": do, **fields}) + "\n")
        self.process.stdin.flush()
        while True:
            event = self.read_event()
            if event.get("id") == self.last_id and event["event"] == "answer":
                return event
            if event.get("id") == self.last_id and event["event"] == "refused":
                raise SystemExit("\n".join([event["why"], *(problem["message"] for problem in event["problems"])]))

    def numbers(self, column):
        """The numbers of a column, element by element."""
        numbers = array.array({"f64": "d", "f32": "f", "u32": "I", "u8": "B"}[column["type"]])
        with open(os.path.join(self.folder, column["file"]), "rb") as file:
            numbers.frombytes(file.read())
        return numbers


def main(program, graph, *values):
    server = Server(program)
    for value in values or [None]:
        values_to_set = dict([value.split("=", 1)]) if value else {}
        for name, entry in server.ask("run", graph=graph, set=values_to_set)["values"].items():
            position = next((column for column in entry["columns"] if column["name"] == "position"), None)
            highest = f", {max(server.numbers(position)[1::3]):.3f} mm high" if position else ""
            print(f"{value or graph}: {name} is a {entry['type']} of {entry['facts']}{highest}")


main(*sys.argv[1:])
