"""Merging: the runs of a sweep's parts (``--part``) joined to the run of the whole, every cell once.

The sweep's command without ``--part`` goes on with it, and so does another merge: of more parts, or of parts that
have more cells by now.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from pathlib import Path
from typing import Any, NamedTuple

from blurnoise._core.files import read_bytes
from blurnoise_eval.run.coco_export import read_truth, write_instances
from blurnoise_eval.run.identity import differences, listed
from blurnoise_eval.run.run import Run
from blurnoise_eval.run.setup import QUESTION, Batch, note_batch
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.system.files import LARGEST_EXAMPLE_BYTES, RUN_FILE, write_whole, written_whole


class Merged(NamedTuple):
    """What a merged run has: rows of cells, one per cell and model, and pictures."""

    cells: int
    pictures: int


def merge(
    runs: Sequence[Path],
    output: Path,
    command: str | None = None,
    progress: Callable[[int], None] = lambda runs: None,
) -> Merged:
    """Join ``runs`` in ``output``: in a new folder, which appears whole or not at all, or to the parts of the same
    sweep that are there.

    command: what the run's page gives as its origin; ``progress`` is called for each run. Raises :class:`StoreError`
    that names what differs, for runs that are no parts of one sweep, and where ``output`` holds anything else.
    """
    goes_on = (output / RUN_FILE).is_file()
    if not goes_on and output.exists() and (not output.is_dir() or any(output.iterdir())):
        raise StoreError(f"output = {str(output)!r}: is not empty; choose another folder")
    with ExitStack() as opened:
        # one that is named twice counts once, and the merged run itself not at all
        different = {run.resolve(): run for run in runs if not goes_on or run.resolve() != output.resolve()}
        parts = [opened.enter_context(Run.open(run)) for run in different.values()]
        joined = [Run.open(output)] if goes_on else []
        about, truth = _documents([*joined, *parts], goes_on=goes_on)
        about["manifest"]["command"] = command or " ".join(
            ["blurnoise merge", *map(str, runs), "-o", str(output)]
        )
        written: AbstractContextManager[Path] = nullcontext(output) if goes_on else written_whole(output)
        try:
            with written as folder:
                write_instances(folder, truth)
                return _join(parts, folder, about, progress)
        except OSError as error:
            raise StoreError(f"output = {str(output)!r}: cannot be written ({error.strerror})") from None


def _documents(runs: Sequence[Run], *, goes_on: bool) -> tuple[dict[str, Any], dict[str, Any]]:
    """The documents of the joined run by their keys, and its labels."""
    setups = [run.setup for run in runs]
    identity, truth = _identity(runs, goes_on=goes_on), _truth(runs)
    images = {**setups[0].manifest["images"], "count": len(truth["images"])}
    about: dict[str, Any] = {
        "identity": identity,
        "manifest": {**setups[0].manifest, "images": images},
        "wall_s": _wall_s(runs),
    }
    if all(setup.question == setups[0].question for setup in setups):
        about[QUESTION] = vars(setups[0].question)
    return about, truth


def _wall_s(runs: Sequence[Run]) -> float:
    """The time that the parts took, of each once: a joined run has that of its parts already."""
    total_s, numbers = 0.0, set[int]()
    for run in runs:
        of_run, count = _part(run)
        # A part that the joined run already has was counted with it.
        if count == 1 or not of_run <= numbers:
            total_s += run.setup.wall_s
        if count == 1:
            return total_s
        numbers |= of_run
    return total_s


def _truth(runs: Sequence[Run]) -> dict[str, Any]:
    """The labels of all parts, which know each picture and box by the ids of the whole."""
    truths = []
    for run in runs:
        with run.store as store:
            truths.append(read_truth(store))
    images = {image["file_name"]: image for truth in truths for image in truth["images"]}
    boxes = {box["id"]: box for truth in truths for box in truth["annotations"]}
    return {
        "images": sorted(images.values(), key=lambda image: image["id"]),
        "annotations": list(boxes.values()),
        "categories": truths[0]["categories"],
    }


def _join(
    parts: Sequence[Run], folder: Path, about: dict[str, Any], progress: Callable[[int], None]
) -> Merged:
    """Add the rows of the parts to those of the run in the folder, if any."""
    with Store(folder, create=True, own=all(part.trusted for part in parts)) as joined:
        for part in parts:
            with part.store as store:
                _add(part, store, joined)
            progress(1)
        for key, value in about.items():
            joined.set_about(key, value)
        there = Run(joined).setup.batches
        noted = {at for batch in there for at in batch.conditions}
        # A dict in place of a set: batches list their conditions in a fixed order.
        refined = {at: None for part in parts for batch in part.setup.batches for at in batch.conditions}
        if more := tuple(at for at in refined if at not in noted):
            note_batch(joined, Batch(about["manifest"]["images"]["count"], (), more))
        return Merged(queries.count_rows(joined), len(queries.pictures_seen(joined)))


def _add(part: Run, store: Store, joined: Store) -> None:
    pictures = joined.pictures()
    for name, facts in store.pictures().items():
        if name in pictures and pictures[name].content != facts.content:
            other = f"picture {name!r} differs from that of the other runs; they cannot be merged"
            raise StoreError(f"run = {str(part.folder)!r}: {other}")
    joined.take(store)
    for name in queries.example_files(store):
        file = joined.file(name)
        if store.file(name).is_file() and not file.exists():
            file.parent.mkdir(parents=True, exist_ok=True)
            write_whole(file, read_bytes(store.file(name), LARGEST_EXAMPLE_BYTES))


def _part(run: Run) -> tuple[set[int], int]:
    """The numbers of the parts that a run has, and how many parts there are."""
    numbers, _, count = run.setup.identity.get("part", "1/1").rpartition("/")
    return {int(number) for number in numbers.split(",")}, int(count)


def _identity(runs: Sequence[Run], *, goes_on: bool) -> dict[str, Any]:
    """What the joined run is: the whole sweep, or several of its parts. Raises ``StoreError`` for anything else.

    goes_on: the first run is the joined one so far.
    """
    numbers, wholes = set[int](), []
    is_whole = goes_on and _part(runs[0])[1] == 1
    for run in runs:
        of_run, count = _part(run)
        numbers |= of_run
        identity = {name: value for name, value in run.setup.identity.items() if name != "part"}
        of_whole = 1 if is_whole else count  # a whole run has every part, of however many
        wholes.append({**identity, "number of parts": of_whole})
        differing = differences(wholes[0], wholes[-1])
        first, versions = runs[0].setup.manifest["versions"], run.setup.manifest["versions"]
        differing += differences(first, versions, "software")
        if not run.setup.grid:
            differing = ["that it is a search's, whose conditions are one whole"]
        if differing:
            raise StoreError(
                f"run = {str(run.folder)!r}: differs from {str(runs[0].folder)!r} in {listed(differing)}; "
                "only parts of one sweep can be merged"
            )
    count = wholes[0].pop("number of parts")
    part = {"part": f"{','.join(map(str, sorted(numbers)))}/{count}"} if len(numbers) < count else {}
    return {**wholes[0], **part}
