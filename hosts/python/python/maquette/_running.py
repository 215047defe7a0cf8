"""Runs under way on threads of their own."""

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
    """A run under way, made by `Graph.start`: a future of `concurrent.futures`, and `await` waits for it.

    `result(timeout)` waits and gives the run or raises what `Graph.run` raises; `cancel` stops it. Where a task of asyncio that awaits it is
    cancelled, the run is stopped.
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
        """Stops the run, and says whether it was still under way."""
        is_under_way = super().cancel()
        self._token.cancel()
        return is_under_way

    def __await__(self) -> Generator[Any, None, Run]:
        """Waits for the run without blocking others; who is cancelled meanwhile stops it."""
        import asyncio

        return asyncio.wrap_future(self).__await__()
