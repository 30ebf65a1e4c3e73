"""Blocks looked at ahead, so that each picture goes to few workers: whoever has one goes on with it.

A worker reads and decodes a picture, and asks every model about it as it is, before its first condition: what a cell
or more costs. Blocks taken as they come would have every worker do so for a block or two of each picture.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Hashable, Iterable, Iterator

from blurnoise_eval.sweep.blocks import Block

AHEAD, AHEAD_OF_WORKER = 256, 16
"""Blocks that wait at most, about 2 kB each: so many, and so many more for each worker."""


class Lookahead:
    """The next block for a worker. Blocks are taken from the source as some are needed, in their order."""

    def __init__(self, blocks: Iterable[Block]) -> None:
        self._source: Iterator[Block] = iter(blocks)
        self._waiting: dict[str, deque[Block]] = {}  # by picture, in the order in which they came
        self._free: dict[str, None] = {}  # pictures of these that nobody has
        self._count, self._more = 0, True
        self._has: dict[Hashable, str] = {}  # worker: its picture
        self._having = Counter[str]()  # picture: how many have it

    def look(self, workers: int = 1) -> bool:
        """Take as many from the source as may wait for so many workers; whether there are any."""
        while self._more and self._count < AHEAD + AHEAD_OF_WORKER * workers:
            block = next(self._source, None)
            self._more = block is not None
            if block is not None:
                self._waiting.setdefault(block.picture.name, deque()).append(block)
                self._count += 1
                self._free_unless_had(block.picture.name)
        return bool(self._waiting)

    def next_for(self, worker: Hashable) -> Block | None:
        """Of the picture that the worker has, else of the first that nobody has, else of the one of which most is
        left for each who has it. None: there is nothing left."""
        if not self.look(len(self._has) + (worker not in self._has)):
            return None
        name = self._has.get(worker)
        if name is None or name not in self._waiting:
            self.forget(worker)
            name = next(iter(self._free), None) or max(
                self._waiting, key=lambda each: len(self._waiting[each]) / self._having[each]
            )
            self._has[worker] = name
            self._having[name] += 1
            self._free.pop(name, None)
        block = self._waiting[name].popleft()
        if not self._waiting[name]:
            del self._waiting[name]
        self._count -= 1
        return block

    def forget(self, worker: Hashable) -> None:
        """It has gone, or has another picture."""
        name = self._has.pop(worker, None)
        if name is not None:
            self._having[name] -= 1
            if not self._having[name]:
                del self._having[name]
            self._free_unless_had(name)

    def of(self, picture: str) -> list[Block]:
        """Take out what waits of this picture."""
        taken = list(self._waiting.pop(picture, ()))
        self._count -= len(taken)
        self._free.pop(picture, None)
        return taken

    def _free_unless_had(self, name: str) -> None:
        if name in self._waiting and name not in self._having:
            self._free[name] = None
