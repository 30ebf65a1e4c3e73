"""The networks that a comparison of trainings needs: every arm with every seed, each trained once and kept."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.queues import Queue
from pathlib import Path
from queue import Empty
from typing import Any

import onnx

from blurnoise_models.export import write_onnx
from blurnoise_models.mixes import ARMS, Arm, mix_facts
from blurnoise_models.training import FEWEST_PICTURES, Step, end_with_parent, pool, train


@dataclass(frozen=True)
class Recipe:
    """A training: its arm and seed, the scenes it draws from, the pictures it sees, and its ONNX file."""

    arm: Arm
    seed: int
    scenes: int
    pictures: int
    path: Path

    @property
    def facts(self) -> dict[str, Any]:
        """What the file says of its training."""
        facts = {"arm": self.arm, "seed": self.seed, "scenes": self.scenes, "pictures": self.pictures}
        return {**facts, **mix_facts(self.arm)}

    @property
    def checkpoint(self) -> Path:
        """The file that keeps the training until it is done."""
        return self.path.with_suffix(".checkpoint")

    def is_ready(self) -> bool:
        """Whether the file is there. Raises ``ValueError`` where it comes from another training."""
        if not self.path.is_file():
            return False
        properties = {entry.key: entry.value for entry in onnx.load(str(self.path)).metadata_props}
        held = json.loads(properties.get("blurnoise.training", "null"))
        if held != self.facts:
            raise ValueError(
                f"model = {str(self.path)!r}: was trained with {held}, not with {self.facts}; "
                "choose another folder, or repeat the command that it comes from"
            )
        return True


def recipes(folder: Path, *, seeds: int, scenes: int, pictures: int) -> list[Recipe]:
    """Every arm with ``seeds`` seeds, as ``folder``/ARM-SEED.onnx.

    Raises ``ValueError`` for no seed, no scene, or fewer than 320 pictures.
    """
    given = {"seeds": (seeds, 1), "scenes": (scenes, 1), "pictures": (pictures, FEWEST_PICTURES)}
    for name, (value, least) in given.items():
        if value < least:
            raise ValueError(f"{name} = {value!r}: must be >= {least}")
    return [
        Recipe(arm, seed, scenes, pictures, folder / f"{arm}-{seed}.onnx")
        for arm in ARMS
        for seed in range(seeds)
    ]


def train_all(
    wanted: Sequence[Recipe],
    scenes: Path,
    *,
    processes: int,
    progress: Callable[[int], None] = lambda pictures: None,
) -> None:
    """Train networks side by side, a process with one thread each, from the pool drawn in ``scenes``.

    One thread each, because several small trainings use the cores better than one that shares them out.
    ``progress`` is told how many pictures were seen. Files appear whole as they are ready, and a training that is
    not done has a checkpoint, so what was stopped goes on where it was. Raises ``ChildProcessError`` where a
    training dies.
    """
    context = get_context("spawn")
    told: Queue[int] = context.Queue()
    waiting = list(wanted)
    running: dict[Recipe, Any] = {}
    try:
        while waiting or running:
            while waiting and len(running) < processes:
                recipe = waiting.pop(0)
                recipe.path.parent.mkdir(parents=True, exist_ok=True)
                running[recipe] = context.Process(target=_train, args=(recipe, scenes, told), daemon=True)
                running[recipe].start()
            with suppress(Empty):
                progress(told.get(timeout=0.2))
            for recipe, process in list(running.items()):
                if process.is_alive():
                    continue
                if process.exitcode:
                    raise ChildProcessError(f"training of {recipe.path.name} died ({process.exitcode})")
                del running[recipe]
        while not told.empty():
            progress(told.get())
    finally:
        for process in running.values():
            process.terminate()
            process.join()


def _train(recipe: Recipe, scenes: Path, told: Queue[int]) -> None:
    end_with_parent()
    seen = 0

    def tell(step: Step) -> None:
        nonlocal seen
        told.put(step.pictures - seen)
        seen = step.pictures

    network = train(
        pool(scenes, recipe.scenes), recipe.arm, pictures=recipe.pictures, seed=recipe.seed, threads=1,
        checkpoint=recipe.checkpoint, progress=tell,
    )  # fmt: skip
    write_onnx(network, recipe.path, facts=recipe.facts)
    recipe.checkpoint.unlink(missing_ok=True)
