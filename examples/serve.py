"""A host of maquette in sixty lines of any Python: runs a graph by `maquette serve --stdio` and prints what it gives.

    python examples/serve.py target/debug/maquette graphs/doll.ron growth=20 growth=30
"""

import array
import json
import os
import subprocess
import sys


class Server:
    """A server, and the requests to it."""

    def __init__(self, program, *options):
        self.process = subprocess.Popen(
            [program, "serve", "--stdio", *options], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8"
        )
        self.folder = self.hear()["folder"]
        self.asked = 0

    def hear(self):
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit("the server is gone")
        return json.loads(line)

    def ask(self, do, **fields):
        """The answer to a request."""
        self.asked += 1
        self.process.stdin.write(json.dumps({"id": self.asked, "do": do, **fields}) + "\n")
        self.process.stdin.flush()
        while True:
            event = self.hear()
            if event.get("id") == self.asked and event["event"] == "answer":
                return event
            if event.get("id") == self.asked and event["event"] == "refused":
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
        given = dict([value.split("=", 1)]) if value else {}
        for name, told in server.ask("run", graph=graph, set=given)["values"].items():
            position = next((column for column in told["columns"] if column["name"] == "position"), None)
            highest = f", {max(server.numbers(position)[1::3]):.3f} mm high" if position else ""
            print(f"{value or graph}: {name} is a {told['type']} of {told['facts']}{highest}")


main(*sys.argv[1:])
