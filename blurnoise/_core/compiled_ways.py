"""Ways that Numba compiles, beside others to the same bits: loaded where it is installed, and once that pays."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Generic, Literal, TypeVar

Way = TypeVar("Way")
When = Literal["where it pays", "always", "never"]
_taken: When = "where it pays"


@contextmanager
def compiled_ways(taken: When) -> Iterator[None]:
    """Take them always or never meanwhile, in all threads: to hold one way against the other."""
    global _taken
    before, _taken = _taken, taken
    try:
        yield
    finally:
        _taken = before


class CompiledWay(Generic[Way]):
    """What ``load`` returns, None where that is None or fails, once work of ``worth`` has been asked for.

    Until then the other way has taken as long as loading takes: what is over soon never waits for it.
    load: imports what Numba compiles, and makes sure of the bits on this machine.
    """

    def __init__(self, load: Callable[[], Way | None], worth: float) -> None:
        self._load, self._loaded = load, False
        self._worth, self._done = worth, 0.0
        self._lock = threading.Lock()
        self._way: Way | None = None

    def after(self, work: float) -> Way | None:
        """The way to take for more work of this size, if not the other one."""
        self._done += work
        if _taken == "never" or (_taken == "where it pays" and self._done < self._worth):
            return None
        if not self._loaded:
            with self._lock:
                if not self._loaded:
                    self._way, self._loaded = self._found(), True
        return self._way

    def _found(self) -> Way | None:
        try:
            return self._load()
        except Exception:  # no Numba, no folder to keep compiled code in, or what is kept there is damaged
            return None
