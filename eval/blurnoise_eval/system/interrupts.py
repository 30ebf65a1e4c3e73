"""Interrupts: Ctrl-C (SIGINT), SIGTERM, and SIGHUP of a closed terminal end a command in the same way.

The first signal raises ``KeyboardInterrupt``, so that open files are closed and unfinished ones removed. The second
ends the process at once by its default action. So does the first during an import, which cannot be undone half-way;
no work has begun by then. Signals that are ignored, as under nohup, stay ignored.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
_SHOW_CURSOR = b"\x1b[?25h"  # a progress line hides it
_AGAIN_S = 0.02

_by = 0  # the signal that ended the command of this process
_over = False  # whether the command has ended, and its process ends, too
_kept: list[Callable[[], bool]] = []
_caught: dict[int, Any] = {}  # the caught signals, and their actions before


def in_order(run: Callable[[], int], *, own_process: bool = False) -> int:
    """Return what ``run`` returns. If a signal ends it, print a line and return 128 + the number of the signal.

    own_process: the process has no other work than ``run`` and ends by the same signal; otherwise a shell does not
    stop its loop. Signals are caught in the main thread only.
    """
    global _by, _over
    if not _caught:
        _by = 0
        _kept.clear()
    with _catching(own_process):
        try:
            code = run()
            _over = own_process
        except KeyboardInterrupt:
            from blurnoise_eval.system.terminal import (
                say,  # what is imported before signals are caught is little
            )

            with suppress(OSError, ValueError):  # the terminal has gone
                say(_last_line(), error=True)
            code = 128 + (_by or signal.SIGINT)
    return code


def keeps(work: Callable[[], bool]) -> None:
    """Register ``work``, which tells whether this command has finished work that an interrupt does not lose."""
    _kept.append(work)


@contextmanager
def taken_back() -> Iterator[None]:
    """Restore the handler of SIGTERM at the end: Ray sets one of its own. If that one exits, ours is called."""
    before = signal.getsignal(signal.SIGTERM)
    try:
        yield
    except SystemExit:
        if signal.SIGTERM not in _caught:
            raise
        signal.signal(signal.SIGTERM, before)
        signal.raise_signal(signal.SIGTERM)
    finally:
        with suppress(ValueError):  # in another thread nothing was set
            signal.signal(signal.SIGTERM, before)


@contextmanager
def _catching(own_process: bool) -> Iterator[None]:
    if _caught:
        yield
        return
    before, hook = {each: signal.getsignal(each) for each in _SIGNALS}, sys.unraisablehook
    with suppress(ValueError):  # not the main thread
        for each, action in before.items():
            if action is not signal.SIG_IGN:
                signal.signal(each, _end if own_process else _interrupt)
                _caught[each] = action
    # Python prints exceptions in destructors and goes on: a Ctrl-C there would be lost.
    sys.unraisablehook = lambda args: _raise_again() if args.exc_type is KeyboardInterrupt else hook(args)
    if own_process:
        atexit.register(_die)  # what is registered first runs last
        yield
        return
    try:
        yield
    finally:
        sys.unraisablehook = hook
        for each, action in _caught.items():
            signal.signal(each, action)
        _caught.clear()


def _interrupt(number: int, frame: FrameType | None) -> None:
    global _by
    _by = number
    # The second signal ends the process at once.
    for each in _caught:
        signal.signal(each, signal.SIG_DFL)
    if sys.stderr is not None and sys.stderr.isatty():
        os.write(2, _SHOW_CURSOR)
    raise KeyboardInterrupt


def _end(number: int, frame: FrameType | None) -> None:
    """As :func:`_interrupt`, but at once during an import and after the command."""
    try:
        _interrupt(number, frame)
    except KeyboardInterrupt:
        importing = False
        while frame is not None and not importing:
            importing, frame = frame.f_code.co_filename.startswith("<frozen importlib"), frame.f_back
        if importing:
            with suppress(OSError):
                os.write(2, f"{_last_line()}\n".encode())
        if importing or _over:
            _die()
        raise


def _raise_again() -> None:
    """Raise the interrupt again a little later: in a destructor or a callback, Python would print and forget it."""

    def again(*_: object) -> None:
        raise KeyboardInterrupt

    if hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, again)
        signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)


def _last_line() -> str:
    return "blurnoise: interrupted" + ("; finished work is kept" if any(work() for work in _kept) else "")


def _die() -> None:
    """End the process by the signal that ended the command, or exit: a container's first process ignores signals."""
    if _by:
        with suppress(OSError, ValueError, RuntimeError):
            sys.stdout.flush()
        signal.raise_signal(_by)
        os._exit(128 + _by)
