"""Blocks: the cells of a sweep in pieces, each a worker's task."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise, product

from blurnoise_eval.datasets import Picture, PictureSet
from blurnoise_eval.grid.conditions import Cell, Conditions, SweepPlan, cell_seed

_CELLS = 8  # at least, that a worker computes before it reports: a block costs whoever hands it out 1 to 2 ms
_EXAMPLE_PICTURES = 3


@dataclass(frozen=True)
class Block:
    """Cells of one picture. examples: ids of those whose pictures are kept, for people to look at."""

    picture: Picture
    cells: tuple[Cell, ...]
    examples: frozenset[str] = frozenset()

    @classmethod
    def joined(cls, blocks: Sequence[Block]) -> Block:
        """One block with the cells of all, which are of one picture."""
        cells = tuple(cell for block in blocks for cell in block.cells)
        return cls(blocks[0].picture, cells, frozenset().union(*(block.examples for block in blocks)))

    def without(self, done: Collection[str]) -> Block:
        """Those cells whose ids are not ``done``."""
        todo = tuple(cell for cell in self.cells if cell.cell_id not in done)
        return Block(self.picture, todo, self.examples)


def count_cells(pictures: PictureSet, plan: SweepPlan) -> int:
    """How many cells a sweep has, the clean ones included."""
    return len(pictures) * cells_per_picture(plan)


def cells_per_picture(plan: SweepPlan) -> int:
    """How many cells each picture has, the clean one included."""
    return 1 + plan.repeats * len(plan.conditions())


def blocks(pictures: PictureSet, plan: SweepPlan) -> Iterator[Block]:
    """Every cell once. A picture's clean cell, which prepares it, comes before the last one's conditions."""
    shown = _example_pictures(pictures) if plan.examples else set()
    kept, together = (None, *plan.example_conditions()), _together(plan.conditions())

    def block(picture: Picture, repeat: int, some: Iterable[Conditions | None]) -> Block:
        seed = cell_seed(plan.seed, picture.name, repeat)
        cells = tuple(Cell(picture.name, repeat, at, seed) for at in some)
        if picture.name not in shown or repeat:
            return Block(picture, cells)
        return Block(picture, cells, frozenset(each.cell_id for each in cells if each.conditions in kept))

    for before, picture in pairwise([None, *pictures, None]):
        if picture is not None:
            yield block(picture, 0, [None])
        if before is not None:
            for repeat, some in product(range(plan.repeats), together):
                yield block(before, repeat, some)


def _together(conditions: Iterable[Conditions]) -> list[list[Conditions]]:
    """Conditions in their order, enough for a block at a time; the lights of one blur and exposure stay together."""
    found: list[list[Conditions]] = []
    for _, lights in groupby(conditions, key=lambda at: (at.blurs_as, at.exposure_s)):
        if not found or len(found[-1]) >= _CELLS:
            found.append([])
        found[-1] += lights
    return found


def _example_pictures(pictures: Iterable[Picture]) -> set[str]:
    """The pictures with the largest targets, or the first ones without labels."""

    def largest(picture: Picture) -> float:
        boxes = (target.box_xyxy for target in picture.targets or ())
        return max(((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in boxes), default=0.0)

    return {picture.name for picture in sorted(pictures, key=largest, reverse=True)[:_EXAMPLE_PICTURES]}
