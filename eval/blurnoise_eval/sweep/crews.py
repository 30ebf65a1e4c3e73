"""Crews: where workers come from that are processes, on this machine or another."""

from __future__ import annotations

import pickle
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import Future
from typing import Protocol, TypeVar

from blurnoise_eval.sweep.blocks import Block
from blurnoise_eval.sweep.worker_process import Told

T = TypeVar("T")


class Hand(Protocol):
    """One worker. Its futures fail with what it raised, or with its death; they are done in their order."""

    opened: Future[None]
    """Done once models are open."""

    def compute(self, block: Block) -> Future[Told]:
        """Begin after what it was given before. Raises ``ValueError`` for a block that cannot be sent."""

    def dismiss(self) -> None:
        """End it, at once or when it has finished what it works on."""


class Crew(ABC):
    """Where workers come from; those with nothing to do stay until it leaves.

    name: of the engine. patience_s: how long to wait while there is no worker at all; None: for ever.
    """

    name: str
    patience_s: float | None = None

    def __init__(self) -> None:
        self._idle: list[Hand] = []

    @property
    @abstractmethod
    def size(self) -> int:
        """How many workers are wanted; asked before the first is hired."""

    @abstractmethod
    def begin(self) -> Hand:
        """One worker more, soon or later; itself at once, since no interrupt comes meanwhile. Raises
        ``ChildProcessError`` where none can be had any more."""

    @abstractmethod
    def is_death(self, error: BaseException) -> bool:
        """Whether a future failed with its worker's death, and not with what it raised."""

    def raised(self, error: BaseException) -> BaseException:
        """What the worker itself raised."""
        return error

    def hire(self) -> Hand:
        """Somebody with nothing to do, else as :meth:`begin`."""
        return self._idle.pop() if self._idle else self.begin()

    def done_with(self, hand: Hand) -> None:
        """Keep a worker that has nothing to do."""
        self._idle.append(hand)

    def leave(self) -> None:
        """There is nothing to do any more: all go."""
        while self._idle:
            self._idle.pop().dismiss()


def pickled(engine: str, what: str, value: object) -> bytes:
    """The value pickled, as :func:`sent`."""
    return sent(engine, what, lambda: pickle.dumps(value))


def sent(engine: str, what: str, pack: Callable[[], T]) -> T:
    """What ``pack`` makes for another process. Raises ``ValueError`` that names what cannot be sent."""
    try:
        return pack()
    except Exception as error:  # all sorts
        raise ValueError(
            f"engine = {engine!r}: {what} cannot be sent to another process ({error}); use 'threads'"
        ) from None
