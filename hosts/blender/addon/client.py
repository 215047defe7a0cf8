"""A client of `maquette serve --stdio` that never blocks. `docs/serve.md` describes the messages. This module does not use Blender."""

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

# Callbacks of a request: for its answer, and for the events of its run before that.
OnAnswer = Callable[["Answer"], None]
OnEvent = Callable[[dict[str, Any]], None]

# The number of bytes to read at a time, more than a pipe holds on any system.
READ_SIZE = 1 << 20


class Answer:
    """The last event of a request: its answer, or the reason of its failure."""

    def __init__(self, event: dict[str, Any]) -> None:
        self.event = event

    @property
    def ok(self) -> bool:
        """True if the request succeeded."""
        return self.event.get("event") == "answer"

    @property
    def why(self) -> str:
        """The reason of a failure."""
        return str(self.event.get("why", ""))

    @property
    def problems(self) -> list[dict[str, Any]]:
        """The problems of the graph."""
        return list(self.event.get("problems") or ())

    def __getitem__(self, name: str) -> Any:
        return self.event[name]

    def get(self, name: str, default: Any = None) -> Any:
        """Returns an optional field."""
        return self.event.get(name, default)


class Client:
    """A server, and the requests to it. Callbacks are called in `poll`, in the thread that calls it."""

    def __init__(self, command: list[str]) -> None:
        """Starts the server. If that fails, `ended` has the reason."""
        self.folder: pathlib.Path | None = None
        # The reason why the server has ended, for the user; None while it runs.
        self.ended: str | None = None
        self._asked = 0
        self._waiting: dict[int, tuple[OnAnswer | None, OnEvent | None]] = {}
        self._unsent: collections.deque[memoryview] = collections.deque()
        self._line = bytearray()
        self._words = tempfile.TemporaryFile()
        self._process: subprocess.Popen[bytes] | None = None
        try:
            pipe = subprocess.PIPE
            # On Windows, no console window.
            flags = getattr(subprocess, "CREATE_NO_WINDOW", 0)
            self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=self._words, bufsize=0, creationflags=flags)
        except OSError as error:
            self._end(f"cannot start the engine: {error}")
            return
        for stream in self._process.stdin, self._process.stdout:
            assert stream
            if sys.platform != "win32":
                os.set_blocking(stream.fileno(), False)

    @property
    def busy(self) -> bool:
        """True if an answer is pending."""
        return bool(self._waiting)

    @property
    def pid(self) -> int | None:
        """The id of the server's process."""
        return self._process.pid if self._process else None

    def ask(self, do: str, done: OnAnswer | None = None, on_event: OnEvent | None = None, /, **fields: Any) -> int:
        """Sends a request and returns its id. `done` is called once with the answer, `on_event` with each event of a run before that."""
        self._asked += 1
        self._waiting[self._asked] = (done, on_event)
        line = json.dumps({"id": self._asked, "do": do, **fields}) + "\n"
        self._unsent.append(memoryview(line.encode()))
        self._send()
        return self._asked

    def poll(self, seconds: float = 0.003) -> None:
        """Handles messages that have arrived, for about `seconds` at most; the rest is handled by the next call."""
        until = time.monotonic() + seconds
        self._send()
        while self.ended is None or self._line.find(b"\n") >= 0:
            end = self._line.find(b"\n")
            if end >= 0:
                line = bytes(self._line[:end])
                del self._line[: end + 1]
                self._handle_line(line)
            elif not self._read():
                break
            if time.monotonic() > until:
                return
        if self.ended is not None and self._waiting:
            self._fail()

    def stop(self) -> None:
        """Ends the server; pending requests fail."""
        if self._process and self._process.stdin:
            self._process.stdin.close()
        self._end("the engine was stopped")
        self._fail()
        if self._process:
            try:
                # The server cancels its runs and writes results to disk, which takes up to two seconds; this does not wait for all of that.
                self._process.wait(0.2)
            except subprocess.TimeoutExpired:
                self._process.terminate()
            if self._process.stdout:
                self._process.stdout.close()
        self._words.close()

    def _send(self) -> None:
        """Writes as much as the pipe takes."""
        while self._unsent and self.ended is None:
            assert self._process and self._process.stdin
            try:
                written = os.write(self._process.stdin.fileno(), self._unsent[0])
            except BlockingIOError:
                return
            except OSError:
                # The server has ended; its last messages are still to be read.
                self._unsent.clear()
                return
            left = self._unsent[0][written:]
            self._unsent[0] = left
            if not left:
                self._unsent.popleft()

    def _read(self) -> bool:
        """Reads available bytes; returns true if there were any."""
        assert self._process and self._process.stdout
        stream = self._process.stdout.fileno()
        try:
            if sys.platform == "win32" and not _has_data(stream):
                piece = None
            else:
                piece = os.read(stream, READ_SIZE)
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

    def _handle_line(self, line: bytes) -> None:
        try:
            event = json.loads(line)
        except ValueError:
            return self._end(f"invalid message from the engine: {line[:60]!r}")
        if event.get("event") == "ready":
            self.folder = pathlib.Path(event["folder"])
        elif "id" in event:
            done, _ = self._waiting.pop(event["id"], (None, None))
            if done:
                done(Answer(event))
        elif "run" in event:
            _, on_event = self._waiting.get(event["run"], (None, None))
            if on_event:
                on_event(event)

    def _end(self, why: str) -> None:
        if self.ended is None:
            self.ended = why
            if self._process and self._process.poll() is None and self._process.stdin and self._process.stdin.closed is False:
                self._process.stdin.close()

    def _fail(self) -> None:
        """Fails all pending requests."""
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


def _has_data(stream: int) -> bool:
    """Returns true if a pipe on Windows, where reads block, has data."""
    import ctypes
    import msvcrt

    count = ctypes.c_ulong()
    handle = msvcrt.get_osfhandle(stream)  # type: ignore[attr-defined]
    peek = ctypes.windll.kernel32.PeekNamedPipe  # type: ignore[attr-defined]
    # If the pipe has ended, a read reports that.
    return not peek(handle, None, 0, None, ctypes.byref(count), None) or count.value > 0
