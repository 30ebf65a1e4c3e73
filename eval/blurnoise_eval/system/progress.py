"""Progress of long work: a line of rich on a terminal; in a log, a line after 10 s and then one per minute."""

from __future__ import annotations

from time import monotonic

from blurnoise_eval.system.terminal import plain, say, text_console

FIRST_S, PAUSE_S = 10.0, 60.0  # until the first line of a log, and between lines


class ProgressBar:
    """The progress of ``total`` steps, on standard error. Call it with the number of further steps that are done.

    shown: False or None for no output.
    """

    def __init__(self, label: str, total: float, shown: bool | None = True) -> None:
        from rich.progress import Progress, TextColumn
        from rich.table import Column

        console = text_console(stderr=True)
        self._label, self._is_log = plain(label), bool(shown) and not console.is_terminal
        self._progress = Progress(
            TextColumn("{task.description}", markup=False, table_column=Column(overflow="fold")),
            console=console,
            disable=not shown or self._is_log,
            speed_estimate_period=86_400.0,  # steps may take minutes
            get_time=monotonic,
        )
        self._number = self._progress.add_task(f"{self._label}: 0 of {total:.0f}", total=total)
        self._task = self._progress.tasks[0]
        self._began_s = monotonic()
        self._next_line_s = self._began_s + FIRST_S

    def __enter__(self) -> ProgressBar:
        self._progress.start()
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        self._progress.stop()
        took_s = monotonic() - self._began_s
        if self._is_log and took_s >= FIRST_S:
            say(self._line(f"{'stopped after' if kind else 'took'} {duration_text(took_s)}"), error=True)

    def __call__(self, done: float) -> None:
        """Add steps that are done."""
        most = max(self._task.total or 0.0, self._task.completed + done)  # more was to do than it seemed
        self._progress.update(self._number, advance=done, total=most)
        speed, left_s = self._task.speed, self._task.time_remaining
        rate = f", {speed:.3g}/s" if speed else ""
        left = f", {duration_text(left_s)} left" if left_s else ""
        line = self._line(f"{self._task.percentage:.0f} %{rate}{left}")
        self._progress.update(self._number, description=line)
        if self._is_log and monotonic() >= self._next_line_s and self._task.completed < most:
            self._next_line_s = monotonic() + PAUSE_S
            say(line, error=True)

    def already(self, done: float) -> None:
        """Add steps that were done earlier; they do not count for the speed."""
        self._progress.reset(self._number, completed=int(self._task.completed + done))

    def _line(self, how: str) -> str:
        return f"{self._label}: {self._task.completed:.0f} of {self._task.total:.0f}, {how}"


def duration_text(seconds: float) -> str:
    """A duration in words.

    >>> duration_text(40), duration_text(735), duration_text(12_000)
    ('40 s', '12 min', '3 h 20 min')
    """
    minutes = round(seconds / 60)
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
