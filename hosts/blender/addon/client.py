"""A client of `maquette serve --stdio` that never waits: `docs/serve.md` has the messages. Nothing of Blender is here."""

from __future__ import annotations

import collections
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time
from typing import Any, Callable

# What is called with the end of a request, and with the events before it.
Done = Callable[["Answer"], None]
Told = Callable[[dict[str, Any]], None]

# So many bytes are read at a time: more than a pipe holds on any system.
PIECE = 1 << 20


class Answer:
    """What a request came to."""

    def __init__(self, event: dict[str, Any]) -> None:
        self.event = event

    @property
    def ok(self) -> bool:
        """Whether it was done."""
        return self.event.get("event") == "answer"

    @property
    def why(self) -> str:
        """Why it was not."""
        return str(self.event.get("why", ""))

    @property
    def problems(self) -> list[dict[str, Any]]:
        """The problems of its graph."""
        return list(self.event.get("problems") or ())

    def __getitem__(self, name: str) -> Any:
        return self.event[name]

    def get(self, name: str, default: Any = None) -> Any:
        """A field that may not be there."""
        return self.event.get(name, default)


class Client:
    """A server, and the requests to it. Answers come in `poll`, and in the thread that calls it."""

    def __init__(self, command: list[str]) -> None:
        """Starts the server; that it could not be started is said as its end is."""
        self.folder: pathlib.Path | None = None
        # Why there is no server any more, in words for people.
        self.ended: str | None = None
        self._asked = 0
        self._waiting: dict[int, tuple[Done | None, Told | None]] = {}
        self._unsent: collections.deque[memoryview] = collections.deque()
        self._line = bytearray()
        self._words = tempfile.TemporaryFile()
        self._process: subprocess.Popen[bytes] | None = None
        try:
            pipe = subprocess.PIPE
            # No window on systems that would open one for a program of the command line.
            flags = getattr(subprocess, "CREATE_NO_WINDOW", 0)
            self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=self._words, bufsize=0, creationflags=flags)
        except OSError as error:
            self._end(f"the engine cannot be started: {error}")
            return
        for stream in self._process.stdin, self._process.stdout:
            assert stream
            if sys.platform != "win32":
                os.set_blocking(stream.fileno(), False)

    @property
    def busy(self) -> bool:
        """Whether an answer is awaited."""
        return bool(self._waiting)

    @property
    def pid(self) -> int | None:
        """The server's process."""
        return self._process.pid if self._process else None

    def ask(self, do: str, done: Done | None = None, told: Told | None = None, /, **fields: Any) -> int:
        """Sends a request and gives its id; `done` is called once with what it came to, `told` with the events of a run before that."""
        self._asked += 1
        self._waiting[self._asked] = (done, told)
        line = json.dumps({"id": self._asked, "do": do, **fields}) + "\n"
        self._unsent.append(memoryview(line.encode()))
        self._send()
        return self._asked

    def poll(self, seconds: float = 0.003) -> None:
        """Takes what has come, no longer than about `seconds`; what is left comes with the next call."""
        until = time.monotonic() + seconds
        self._send()
        while self.ended is None or self._line.find(b"\n") >= 0:
            end = self._line.find(b"\n")
            if end >= 0:
                line = bytes(self._line[:end])
                del self._line[: end + 1]
                self._hear(line)
            elif not self._read():
                break
            if time.monotonic() > until:
                return
        if self.ended is not None and self._waiting:
            self._fail()

    def stop(self) -> None:
        """Ends the server; who waits for an answer is told."""
        if self._process and self._process.stdin:
            self._process.stdin.close()
        self._end("the engine was stopped")
        self._fail()
        if self._process:
            try:
                # It stops what runs and puts results on disk; that takes it two seconds at most.
                self._process.wait(0.2)
            except subprocess.TimeoutExpired:
                self._process.terminate()
            if self._process.stdout:
                self._process.stdout.close()
        self._words.close()

    def _send(self) -> None:
        """Writes what the pipe takes."""
        while self._unsent and self.ended is None:
            assert self._process and self._process.stdin
            try:
                written = os.write(self._process.stdin.fileno(), self._unsent[0])
            except BlockingIOError:
                return
            except OSError:
                # What it said before it ended is still to be read.
                self._unsent.clear()
                return
            left = self._unsent[0][written:]
            self._unsent[0] = left
            if not left:
                self._unsent.popleft()

    def _read(self) -> bool:
        """Reads what is there; whether there was something."""
        assert self._process and self._process.stdout
        stream = self._process.stdout.fileno()
        try:
            if sys.platform == "win32" and not _is_filled(stream):
                piece = None
            else:
                piece = os.read(stream, PIECE)
        except BlockingIOError:
            piece = None
        except OSError:
            piece = b""
        if piece is None:
            return False
        if not piece:
            self._end(f"the engine has ended{self._last_words()}")
            return False
        self._line += piece
        return True

    def _hear(self, line: bytes) -> None:
        try:
            event = json.loads(line)
        except ValueError:
            return self._end(f"the engine says what is no message: {line[:60]!r}")
        if event.get("event") == "ready":
            self.folder = pathlib.Path(event["folder"])
        elif "id" in event:
            done, _ = self._waiting.pop(event["id"], (None, None))
            if done:
                done(Answer(event))
        elif "run" in event:
            _, told = self._waiting.get(event["run"], (None, None))
            if told:
                told(event)

    def _end(self, why: str) -> None:
        if self.ended is None:
            self.ended = why
            if self._process and self._process.poll() is None and self._process.stdin and self._process.stdin.closed is False:
                self._process.stdin.close()

    def _fail(self) -> None:
        """Tells all who wait that there is no answer."""
        waiting, self._waiting = self._waiting, {}
        for done, _ in waiting.values():
            if done:
                done(Answer({"event": "ended", "why": self.ended}))

    def _last_words(self) -> str:
        assert self._process
        try:
            code = self._process.wait(0.05)
        except subprocess.TimeoutExpired:
            return ""
        self._words.seek(0)
        words = self._words.read().decode(errors="replace").strip().splitlines()
        how = f" by signal {-code}" if code < 0 else f" with {code}"
        return f"{how}: {words[-1]}" if words else how


def _is_filled(stream: int) -> bool:
    """Whether there is something to read in a pipe of Windows, whose reads wait."""
    import ctypes
    import msvcrt

    count = ctypes.c_ulong()
    handle = msvcrt.get_osfhandle(stream)  # type: ignore[attr-defined]
    peek = ctypes.windll.kernel32.PeekNamedPipe  # type: ignore[attr-defined]
    # At the pipe's end reading says so.
    return not peek(handle, None, 0, None, ctypes.byref(count), None) or count.value > 0
