"""The parts of a cell: their names are the package's folders, and their times those of the whole cell."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from blurnoise_eval import datasets
from blurnoise_eval.bench import parts
from blurnoise_eval.detectors.detector import Detector
from blurnoise_models.detector import STOP_SIGN


def test_every_folder_of_a_part_exists():
    roots = {package.name: package for package in parts._PACKAGES}
    for _, *folders in parts.PARTS:
        for folder in folders:
            package, *inside = Path(folder).parts
            assert roots[package].joinpath(*inside).is_dir(), folder


def test_parts_have_what_they_are_named_after_and_add_up_to_the_cell():
    found = parts.parts(Detector(STOP_SIGN), datasets.rendered_signs((50,), count=1), quick=True)
    by_name = {row.part: row for row in found.rows}
    assert list(by_name) == [part for part, *_ in parts.PARTS]
    assert all(row.native_ms > 0 and row.python_ms >= 0 for row in found.rows)
    # Inference is one call of a compiled function; no other part of the built-in detector's cell is as long.
    inference = by_name["onnxruntime"]
    assert inference.native_ms > 10 * inference.python_ms
    assert inference.native_ms == max(row.native_ms for row in found.rows)
    total = sum(row.native_ms + row.python_ms for row in found.rows)
    assert f"{total:.2f} ms" in found.title
    assert found.table()[-1].split()[-1] == f"{total:.2f}"


def test_a_library_counts_where_it_is_called():
    ours, theirs = (str(parts._PACKAGES[1] / "store" / "rows.py"), 1, "ours"), ("elsewhere.py", 1, "theirs")
    native = ("~", 0, "<compiled>")

    stats = {
        ours: (1, 1, 0.001, 0.006, {}),
        theirs: (1, 1, 0.002, 0.005, {ours: (1, 1, 0.002, 0.005)}),
        native: (1, 1, 0.003, 0.003, {theirs: (1, 1, 0.003, 0.003)}),
    }
    store = {row.part: row for row in parts._rows(SimpleNamespace(stats=stats), 2, 2.5)}["store"]
    assert store.native_ms == pytest.approx(1.5)
    assert store.python_ms == pytest.approx(1.0)
