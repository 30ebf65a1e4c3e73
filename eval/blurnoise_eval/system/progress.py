"""Progress on the terminal: how much is done, how fast, how long it will take, and what else there is to say."""

from __future__ import annotations


class Advance:
    """Is told how much more is done, and what to say beside that. This one keeps it to itself."""

    def __call__(self, done: float) -> None:
        """So much more is done."""

    def note(self, text: str) -> None:
        """Say this in place of what was said before."""


class ProgressBar:
    """A progress bar on the terminal's error stream, silent where there is none. Inside: what advances it."""

    def __init__(self, label: str, total: int) -> None:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        from blurnoise_eval.system.terminal import plain_console

        label_column = TextColumn("{task.description}", style="bold", markup=False)
        rate, note = (TextColumn(f"{{task.fields[{name}]}}", markup=False) for name in ("rate", "note"))
        columns = (label_column, BarColumn(), MofNCompleteColumn(), rate, TimeRemainingColumn(), note)
        console = plain_console(error=True)
        self._progress = Progress(*columns, console=console, disable=not console.is_terminal)
        self._task = self._progress.add_task(label, total=total, rate="", note="")

    def __enter__(self) -> Advance:
        self._progress.start()
        return _OfBar(self)

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def advance(self, done: float) -> None:
        """So much more is done."""
        self._progress.advance(self._task, done)
        speed = self._progress.tasks[0].speed
        if speed:
            self._progress.update(self._task, rate=f"{speed:.3g}/s")

    def note(self, text: str) -> None:
        """Say this at the end of the line."""
        self._progress.update(self._task, note=text)


class _OfBar(Advance):
    def __init__(self, bar: ProgressBar) -> None:
        self._bar = bar

    def __call__(self, done: float) -> None:
        self._bar.advance(done)

    def note(self, text: str) -> None:
        self._bar.note(text)
