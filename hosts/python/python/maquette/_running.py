"""Runs on other threads."""

from __future__ import annotations

import threading
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any, Callable, Generator

from . import _maquette

if TYPE_CHECKING:
    from ._run import Run

    _Future = Future[Run]
else:
    _Future = Future


class Running(_Future):
    """A run on another thread, started by `Graph.start`: a future of `concurrent.futures`, which can also be awaited.

    `result(timeout)` waits and returns the run, or raises the error of `Graph.run`; `cancel` stops it. If a task of asyncio that awaits it
    is cancelled, the run is stopped.
    """

    def __init__(self, work: Callable[[], Run], token: _maquette.Cancel) -> None:
        super().__init__()
        self._token = token
        threading.Thread(target=self._work, args=(work,), name="maquette", daemon=True).start()

    def _work(self, work: Callable[[], Run]) -> None:
        try:
            run = work()
        except BaseException as error:
            if self.set_running_or_notify_cancel():
                self.set_exception(error)
        else:
            if self.set_running_or_notify_cancel():
                self.set_result(run)

    def cancel(self) -> bool:
        """Stops the run; returns True if it was still running."""
        is_under_way = super().cancel()
        self._token.cancel()
        return is_under_way

    def __await__(self) -> Generator[Any, None, Run]:
        """Waits for the run without blocking other tasks; a cancellation of the waiting task stops the run."""
        import asyncio

        return asyncio.wrap_future(self).__await__()
