"""Blocks in flight: handed to workers, and back; what becomes of a block whose worker died.

A worker is one process or one actor, which computes its blocks one after the other. Retries are made here and nowhere
else. A block that was lost with its worker goes first in the queue again. The one that the worker was computing is
suspected: it is tried once more with nothing else in flight on its worker, and if that one dies too, its picture is
given up. Each block is answered exactly once, whatever died. Few are in flight and few wait
(:mod:`blurnoise_eval.sweep.lookahead`), so that the cells of a sweep take no memory here.
"""

from __future__ import annotations

import time
import warnings
from collections import deque
from collections.abc import Generator, Iterable
from concurrent.futures import Future
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue

from blurnoise._core.worker_lifetime import interrupts_held
from blurnoise_eval.datasets import UnreadablePicture
from blurnoise_eval.store.store import CellResult
from blurnoise_eval.sweep.blocks import Block
from blurnoise_eval.sweep.crews import Crew, Hand
from blurnoise_eval.sweep.lookahead import Lookahead
from blurnoise_eval.sweep.worker_process import Told

Answers = Generator[tuple[Block, list[CellResult] | Exception], None, None]
IN_FLIGHT = 2  # blocks for each worker: one that it works on, one that waits
_PAUSE_S = 1.0  # before another worker is asked for in place of one that died before it was ready
_OPENINGS = 3  # workers that may die one after the other before one is ready, where there is no patience


class WorkerDied(Exception):
    """A worker died while it computed the block. No answer yet: the block comes again."""


@dataclass(frozen=True)
class _Attempt:
    block: Block
    suspected: bool = False


@dataclass(eq=False)
class _Slot:
    hand: Hand
    ready: bool = False
    flying: deque[tuple[_Attempt, Future[Told]]] = field(default_factory=deque)


def fly(crew: Crew, blocks: Iterable[Block]) -> Answers:
    """Each block with its results or what a worker raised; beside them :class:`WorkerDied`, once for each that did.

    What workers warn of is warned of here, each text once. Raises ``ChildProcessError`` where no worker can be had
    any more, or all die before they are ready, and what opening the models raises. Without a block nobody is hired.
    """
    return _Flight(crew, blocks).answers()


def fly_once(crew: Crew, blocks: Iterable[Block]) -> Answers:
    """As :func:`fly`; then the crew leaves."""
    try:
        yield from fly(crew, blocks)
    finally:
        crew.leave()


class _Flight:
    def __init__(self, crew: Crew, blocks: Iterable[Block]) -> None:
        self._crew = crew
        self._ahead = Lookahead(blocks)
        self._suspects, self._again = deque[_Attempt](), deque[_Attempt]()
        self._given_up: dict[str, UnreadablePicture] = {}
        self._slots: list[_Slot] = []
        self._events = SimpleQueue[_Slot]()  # slots of which something is done
        self._died_opening = 0
        self._told = set[str]()
        self._hope_s = 0.0  # when there was a worker last, or the flight began

    def answers(self) -> Answers:
        any_at_all = self._ahead.look()
        self._hope_s = time.monotonic()
        try:
            for _ in range(self._crew.size if any_at_all else 0):
                self._hire()
            while self._left() or any(slot.flying for slot in self._slots):
                yield from self._land(self._next_event())
        finally:
            for slot in self._slots:
                if slot.ready and not slot.flying:
                    self._crew.done_with(slot.hand)
                else:
                    slot.hand.dismiss()

    def _left(self) -> bool:
        return self._ahead.look() or bool(self._again or self._suspects)

    def _hire(self) -> None:
        with interrupts_held():  # or somebody would be left behind
            slot = _Slot(self._crew.hire())
            self._slots.append(slot)
            slot.hand.opened.add_done_callback(lambda _: self._events.put(slot))

    def _next_event(self) -> _Slot:
        """A slot of which something is done; while nobody is ready, only for so long."""
        if any(slot.ready for slot in self._slots):
            slot = self._events.get()
            self._hope_s = time.monotonic()
            return slot
        try:
            return self._events.get(timeout=self._patience_left_s())
        except Empty:
            raise self._out_of_patience() from None

    def _patience_left_s(self) -> float | None:
        patience_s = self._crew.patience_s
        return None if patience_s is None else max(self._hope_s + patience_s - time.monotonic(), 0.0)

    def _out_of_patience(self) -> ChildProcessError:
        return ChildProcessError(
            f"engine = {self._crew.name!r}: no worker could be had for {self._crew.patience_s} s; "
            "what was finished is kept"
        )

    def _land(self, slot: _Slot) -> Answers:
        """What is done of a slot, and then its next blocks."""
        if slot not in self._slots:  # died meanwhile
            return
        if not slot.ready and slot.hand.opened.done():
            self._open(slot)
        while slot.flying and slot.flying[0][1].done():
            error = slot.flying[0][1].exception()
            if error is not None and self._crew.is_death(error):
                yield from self._bury(slot)
                return
            attempt, future = slot.flying.popleft()
            if error is None:
                yield attempt.block, self._results(future.result())
                continue
            error = self._crew.raised(error)
            if not isinstance(error, Exception):  # an interrupt, an exit
                raise error
            yield attempt.block, error
        self._fill(slot)

    def _open(self, slot: _Slot) -> None:
        error = slot.hand.opened.exception()
        if error is None:
            slot.ready, self._died_opening = True, 0
            return
        if not self._crew.is_death(error):
            raise self._crew.raised(error)
        self._end(slot)
        self._died_opening += 1
        if self._crew.patience_s is not None:  # a node that was lost is offered for some seconds
            if not self._patience_left_s() and not any(each.ready for each in self._slots):
                raise self._out_of_patience()
            time.sleep(_PAUSE_S)
            self._hire()
            return
        if self._died_opening < _OPENINGS:
            self._hire()
            return
        died = (
            f"engine = {self._crew.name!r}: {self._died_opening} workers one after the other died before they had "
            "opened the models (killed, or out of memory)"
        )
        if not self._slots:
            raise ChildProcessError(f"{died}; what was finished is kept")
        warnings.warn(f"{died}; goes on with {len(self._slots)}", RuntimeWarning, stacklevel=2)

    def _bury(self, slot: _Slot) -> Answers:
        """Back into the queue with what was in flight on a worker that died; the first of it is suspected."""
        (first, _), *others = slot.flying
        self._end(slot)
        picture = first.block.picture.name
        self._again.extendleft(attempt for attempt, _ in reversed(others))
        if first.suspected:
            self._given_up[picture] = UnreadablePicture(
                f"{picture}: the worker that computed it died, and so did the next one with nothing else to do "
                "(killed, out of memory, or a crash in native code)"
            )
        self._suspects.appendleft(_Attempt(first.block, suspected=True))
        yield first.block, WorkerDied(picture)
        yield from self._of_given_up()
        if self._left():
            self._hire()
            for each in self._slots:  # nobody may be busy any more
                self._fill(each)

    def _of_given_up(self) -> Answers:
        """Answers for blocks in the queue whose picture was given up."""
        for queue in (self._suspects, self._again):
            for attempt in [each for each in queue if each.block.picture.name in self._given_up]:
                queue.remove(attempt)
                yield attempt.block, self._given_up[attempt.block.picture.name]
        for picture, error in self._given_up.items():
            for block in self._ahead.of(picture):
                yield block, error

    def _end(self, slot: _Slot) -> None:
        self._slots.remove(slot)
        self._ahead.forget(slot)
        slot.hand.dismiss()

    def _fill(self, slot: _Slot) -> None:
        while slot in self._slots and (attempt := self._next_for(slot)) is not None:
            with interrupts_held():  # or a lock could stay taken
                future = slot.hand.compute(attempt.block)
                slot.flying.append((attempt, future))
                future.add_done_callback(lambda _: self._events.put(slot))

    def _next_for(self, slot: _Slot) -> _Attempt | None:
        """What a slot does next, if it has room. A suspect waits for one with nothing to do, and then is alone."""
        if not slot.ready or len(slot.flying) >= IN_FLIGHT or any(each.suspected for each, _ in slot.flying):
            return None
        if self._suspects:
            if not slot.flying:
                return self._suspects.popleft()
            if all(each.ready for each in self._slots):  # nobody new comes: let this one run out
                return None
        if self._again:
            return self._again.popleft()
        block = self._ahead.next_for(slot)
        return None if block is None else _Attempt(block)

    def _results(self, told: Told) -> list[CellResult]:
        results, warned = told
        for text, category in warned:
            if text not in self._told:
                self._told.add(text)
                warnings.warn(text, category, stacklevel=2)
        return results
