"""Merging: the runs of a sweep's parts (``--part``) joined to the run of the whole, every cell once.

The sweep's command without ``--part`` goes on with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

from blurnoise._core.files import read_bytes
from blurnoise_eval.run.coco_export import read_truth, write_instances
from blurnoise_eval.run.identity import differences, listed
from blurnoise_eval.run.run import ENOUGH, Batch, Run, ask
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.system.files import LARGEST_EXAMPLE_BYTES, write_whole, written_whole


class Merged(NamedTuple):
    """What a merge has joined: rows of cells, one per cell and model, and pictures."""

    cells: int
    pictures: int


def merge(
    runs: Sequence[Path],
    output: Path,
    command: str | None = None,
    progress: Callable[[int], None] = lambda runs: None,
) -> Merged:
    """Join ``runs`` in ``output``, a new folder, which appears whole or not at all.

    command: what the run's page gives as its origin; ``progress`` is called for each run. Raises :class:`StoreError`
    that names what differs, for runs that are no parts of one sweep, and where ``output`` holds anything.
    """
    if output.exists() and (not output.is_dir() or any(output.iterdir())):
        raise StoreError(f"output = {str(output)!r}: is not empty; choose another folder")
    with ExitStack() as opened:
        different = {run.resolve(): run for run in runs}  # one that is named twice counts once
        parts = [opened.enter_context(Run.open(run)) for run in different.values()]
        identity = _identity(parts)
        truth = _truth(parts)
        origin = command or " ".join(["blurnoise merge", *map(str, runs), "-o", str(output)])
        images = {**parts[0].manifest["images"], "count": len(truth["images"])}
        about = {
            "identity": identity,
            "manifest": {**parts[0].manifest, "images": images, "command": origin},
            "wall_s": sum(part.wall_s for part in parts),
        }
        questions = [part.question for part in parts]
        if all(each == questions[0] for each in questions):
            about[ENOUGH] = vars(questions[0])
        try:
            with written_whole(output) as folder:
                write_instances(folder, truth)
                return _joined(parts, folder, about, progress)
        except OSError as error:
            raise StoreError(f"output = {str(output)!r}: cannot be written ({error.strerror})") from None


def _truth(parts: Sequence[Run]) -> dict[str, Any]:
    """The labels of all parts, which know each picture and box by the ids of the whole."""
    truths = [read_truth(run.store) for run in parts]
    images = {each["file_name"]: each for truth in truths for each in truth["images"]}
    boxes = {each["id"]: each for truth in truths for each in truth["annotations"]}
    return {
        "images": sorted(images.values(), key=lambda each: each["id"]),
        "annotations": list(boxes.values()),
        "categories": truths[0]["categories"],
    }


def _joined(
    parts: Sequence[Run], folder: Path, about: dict[str, Any], progress: Callable[[int], None]
) -> Merged:
    with Store(folder, create=True, own=all(part.trusted for part in parts)) as joined:
        for part in parts:
            held = joined.pictures()
            for name, facts in part.store.pictures().items():
                if name in held and held[name].content != facts.content:
                    other = f"picture {name!r} differs from that of the other runs; they cannot be merged"
                    raise StoreError(f"run = {str(part.folder)!r}: {other}")
            joined.take(part.store)
            for name in queries.example_files(part.store):
                file = joined.file(name)
                if part.store.file(name).is_file() and not file.exists():
                    file.parent.mkdir(parents=True, exist_ok=True)
                    write_whole(file, read_bytes(part.store.file(name), LARGEST_EXAMPLE_BYTES))
            progress(1)
        for key, value in about.items():
            joined.set_about(key, value)
        if refined := {at: None for part in parts for batch in part.asked for at in batch.conditions}:
            ask(joined, Batch(about["manifest"]["images"]["count"], (), tuple(refined)))
        return Merged(queries.count_rows(joined), len(queries.pictures_seen(joined)))


def _identity(parts: Sequence[Run]) -> dict[str, Any]:
    """What the joined run is: the whole sweep, or several of its parts. Raises ``StoreError`` for anything else."""
    numbers, wholes = set[int](), []
    for run in parts:
        identity = dict(run.store.about("identity"))
        own, _, count = identity.pop("part", "1/1").rpartition("/")
        numbers |= {int(number) for number in own.split(",")}
        wholes.append({**identity, "number of parts": int(count)})
        differing = differences(wholes[0], wholes[-1])
        differing += differences(parts[0].manifest["versions"], run.manifest["versions"], "software")
        if not run.grid:
            differing = ["that it is a search's, whose conditions are one whole"]
        if differing:
            raise StoreError(
                f"run = {str(run.folder)!r}: differs from {str(parts[0].folder)!r} in {listed(differing)}; "
                "only parts of one sweep can be merged"
            )
    count = wholes[0].pop("number of parts")
    part = {"part": f"{','.join(map(str, sorted(numbers)))}/{count}"} if len(numbers) < count else {}
    return {**wholes[0], **part}
