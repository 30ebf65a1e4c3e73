"""Progress of long work: what is done, how far it is, how fast, when it will end.

On a terminal it is a line that changes. Elsewhere it is a line of standard error after 10 s and then ever more
rarely, down to one a minute, so that a log says how a night's work goes on; what takes less than 10 s says nothing,
unless with what went right before it takes longer.
"""

from __future__ import annotations

import sys
from time import monotonic
from typing import TYPE_CHECKING

from blurnoise_eval.system.terminal import plain, plain_console, say

if TYPE_CHECKING:
    from rich.text import Text

FIRST_S, RAREST_S = 10.0, 60.0  # between lines
BAR, WITH_BAR = 20, 100  # cells of the bar, and of a terminal that has room for it


class Advance:
    """Is told how much more is done, and what to say beside that. This one keeps it to itself."""

    def __call__(self, done: float) -> None:
        """So much more is done."""

    def already(self, done: float) -> None:
        """So much was done before, and says nothing about speed."""

    def note(self, text: str) -> None:
        """Say this in place of what was said before."""


class ProgressBar(Advance):
    """Progress of ``total`` steps, on standard error. Inside: what advances it."""

    _spoken, _ended = (
        0.0,
        float("-inf"),
    )  # of any: the last line, or the beginning of those without one; the end

    def __init__(self, label: str, total: float) -> None:
        from rich.live import Live

        self._label, self._total, self._note = plain(label), total, ""
        self._done = self._before = 0.0
        self._began = monotonic()
        console = plain_console(error=True)
        self._bar = console.width >= WITH_BAR
        live = Live(get_renderable=self._drawn, console=console, refresh_per_second=5)
        self._live = live if console.is_terminal else None

    def __enter__(self) -> Advance:
        self._began = monotonic()
        if abs(self._began - ProgressBar._ended) > FIRST_S:
            ProgressBar._spoken = self._began
        if self._live:
            self._live.start()
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        ProgressBar._ended = monotonic()
        took = ProgressBar._ended - self._began
        if self._live:
            self._live.stop()
        elif took >= FIRST_S:
            self._say(f"{'took' if kind is None else 'stopped after'} {duration_text(took)}")

    def __call__(self, done: float) -> None:
        """So much more is done."""
        self._done += done
        self._total = max(self._total, self._done)  # where more was to do than it seemed
        now = monotonic()
        pause = min(max(FIRST_S, (now - self._began) / 5), RAREST_S)
        if not self._live and now - ProgressBar._spoken >= pause and self._done < self._total:
            self._say(self._how())

    def already(self, done: float) -> None:
        """So much was done before."""
        self._before += done
        self(done)

    @classmethod
    def command_begins(cls) -> None:
        """What was worked on before has nothing to do with what comes."""
        cls._ended = float("-inf")

    def note(self, text: str) -> None:
        """Say this at the end of the line."""
        self._note = f"; {plain(text)}"

    def _how(self) -> str:
        """'13 %, 12/s, 20 s left', by what was done since it began."""
        took, now = monotonic() - self._began, self._done - self._before
        share = f"{100 * self._done / self._total:.0f} %" if self._done else "0 %"
        if now <= 0 or not took:
            return share
        rate = now / took
        left_s = (self._total - self._done) / rate
        speed = f"{rate:.3g}" if rate < 100 else f"{rate:.0f}"
        left = f", {duration_text(left_s)} left" if left_s > 0 else ""
        return f"{share}, {speed}/s{left}"

    def _far(self) -> str:
        return f"{self._label}: {self._done:.0f} of {self._total:.0f}"

    def _say(self, how: str) -> None:
        ProgressBar._spoken = monotonic()
        say(f"{self._far()}, {how}{self._note}", error=True)
        sys.stderr.flush()

    def _drawn(self) -> Text:
        from rich.text import Text

        filled = int(BAR * min(self._done / self._total, 1.0)) if self._total else BAR
        bar = f"[{'=' * filled}{' ' * (BAR - filled)}] " if self._bar else ""
        return Text(f"{bar}{self._far()}, {self._how()}{self._note}")


def duration_text(seconds: float) -> str:
    """'40 s', '12 min', '3 h 20 min'."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
