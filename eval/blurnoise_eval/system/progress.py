"""Progress on the terminal."""

from __future__ import annotations

from collections.abc import Callable


class ProgressBar:
    """A progress bar on the terminal's error stream, silent where there is none. Inside: what advances it."""

    def __init__(self, label: str, total: int) -> None:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        from blurnoise_eval.system.terminal import plain_console

        label_column = TextColumn("{task.description}", style="bold", markup=False)
        columns = (label_column, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        console = plain_console(error=True)
        self._progress = Progress(*columns, console=console, disable=not console.is_terminal)
        self._task = self._progress.add_task(label, total=total)

    def __enter__(self) -> Callable[[float], None]:
        self._progress.start()
        return lambda done: self._progress.advance(self._task, done)

    def __exit__(self, *_: object) -> None:
        self._progress.stop()
