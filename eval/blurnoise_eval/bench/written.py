"""A bench's measurements on disk: a tidy table for pandas and one JSON document."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from blurnoise_eval.system.files import write_whole


def write_bench(name: str, records: Sequence[dict[str, Any]], document: dict[str, Any], folder: Path) -> None:
    """Write ``name``.csv, a row per record, and ``name``.json, each whole; raises ``OSError``."""
    table = io.StringIO()
    writer = csv.DictWriter(table, list(records[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(records)
    write_whole(folder / f"{name}.csv", table.getvalue().encode())
    write_whole(folder / f"{name}.json", json.dumps(document, indent=1, allow_nan=False).encode())
