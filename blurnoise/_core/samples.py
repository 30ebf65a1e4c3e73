"""Samples of a curve in a CSV file: positions in the first column, values in another."""

from __future__ import annotations

import csv
from pathlib import Path

from blurnoise._core.files import read_text


def read_samples(path: str | Path, column: int, position: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Positions (column 0, ``position`` says of what) and values (``column``), sorted; a header may stand.

    Raises ``ValueError`` that names the file and line when a row does not hold numbers, or for fewer than two.
    """
    samples: list[tuple[float, float]] = []
    for number, row in enumerate(csv.reader(read_text(Path(path)).split("\n")), start=1):
        if not row or not row[0].strip():
            continue
        try:
            samples.append((float(row[0]), float(row[column])))
        except (ValueError, IndexError):
            if samples or number > 1:
                raise ValueError(
                    f"{path}, line {number}: expected {position} and a number in column "
                    f"{column}, got {','.join(row)!r}"
                ) from None
    if len(samples) < 2:
        raise ValueError(f"{path}: holds {len(samples)} samples; a curve needs at least 2")
    positions, values = zip(*sorted(samples), strict=True)
    return positions, values
