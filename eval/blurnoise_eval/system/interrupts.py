"""Interrupts: Ctrl-C (SIGINT), SIGTERM, and SIGHUP where the terminal closes, end a command in one way.

The first raises ``KeyboardInterrupt``, so that what is open is closed and what is unfinished is removed. The next
one ends the process at once, by the signal's default action, as the first does within an import, which cannot be
undone half-way and before which nothing has been begun. Signals that are ignored, as under nohup, stay ignored.
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

_by = 0  # the signal that has ended the command, of this process
_over = False  # whether the command has ended, and this process with it
_kept: list[Callable[[], bool]] = []
_caught: dict[int, Any] = {}  # signals that are caught now, and what was done about them before


def in_order(run: Callable[[], int], *, own_process: bool = False) -> int:
    """What ``run`` returns; 128 + the signal's number where a signal ended it, and a line that says so.

    own_process: there is nothing but ``run`` in this process, which then ends by the same signal: shells stop a loop
    only for that, and report the same number. In other threads than the main one no signal is caught.
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
    """``work`` says whether something is finished that an interrupt of this command does not lose."""
    _kept.append(work)


@contextmanager
def taken_back() -> Iterator[None]:
    """A handler of SIGTERM that is set inside, as Ray sets it, is replaced by the one before. Its exit is ours."""
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
    for each in _caught:
        signal.signal(each, signal.SIG_DFL)
    if sys.stderr is not None and sys.stderr.isatty():
        os.write(2, _SHOW_CURSOR)
    raise KeyboardInterrupt


def _end(number: int, frame: FrameType | None) -> None:
    """As :func:`_interrupt`; at once within an import, and after the command."""
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
    """An interrupt in a destructor or a callback, which Python would print and forget, comes again a little later."""

    def again(*_: object) -> None:
        raise KeyboardInterrupt

    if hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, again)
        signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)


def _last_line() -> str:
    return "blurnoise: interrupted" + ("; finished work is kept" if any(work() for work in _kept) else "")


def _die() -> None:
    """End by the signal, if one has ended the command. The first process of a container is not ended by it."""
    if _by:
        with suppress(OSError, ValueError, RuntimeError):
            sys.stdout.flush()
        signal.raise_signal(_by)
        os._exit(128 + _by)
