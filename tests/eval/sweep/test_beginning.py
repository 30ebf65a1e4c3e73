"""A run that never begins leaves nothing behind; one that did, and what was there before, stays."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from blurnoise_eval.datasets import rendered_signs
from blurnoise_eval.evaluation import evaluate
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.run_folder import begun_or_gone
from blurnoise_eval.sweep.work import Block, Work
from made_work import made_blocks, results


class Unreachable:
    def map(self, work: Work, blocks: Iterator[Block]) -> Iterator[object]:
        next(iter(blocks))
        raise ChildProcessError("no cluster")
        yield


def test_a_sweep_whose_engine_cannot_begin_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(ChildProcessError, match="no cluster"):
        evaluate(pictures=rendered_signs(sizes_px=(24,)), output=tmp_path / "of/runs", engine=Unreachable())  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def begin(
    folder: Path,
    *,
    cells: int = 0,
    skipped: bool = False,
    before: tuple[str, ...] = (),
    meanwhile: tuple[str, ...] = (),
) -> list[str]:
    """Fail after so much was stored; what is there then."""
    for name in before:
        folder.mkdir(exist_ok=True)
        (folder / name).write_text("mine")
    with suppress(KeyboardInterrupt), begun_or_gone(folder), Store(folder, create=True) as store:
        (folder / "coco").mkdir(exist_ok=True)
        (folder / "coco/instances.json").write_text("{}")
        for name in meanwhile:
            (folder / name).write_text("mine, too")
        store.add(results(next(made_blocks(1)))[:cells])
        if skipped:
            store.skip("a.png", "cannot be read")
        raise KeyboardInterrupt
    return sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []


def test_what_has_begun_and_what_was_there_stay(tmp_path: Path) -> None:
    whole = ["coco", "results.sqlite"]
    assert begin(tmp_path / "new") == []
    assert not (tmp_path / "new").exists()
    assert begin(tmp_path / "cell", cells=1) == whole
    assert begin(tmp_path / "skipped", skipped=True) == whole
    assert begin(tmp_path / "mine", before=("notes.txt",)) == ["notes.txt"]
    assert begin(tmp_path / "ours", meanwhile=("download.zip",)) == ["download.zip"]
    with Store(tmp_path / "held", create=True) as store:
        store.set_about("identity", {})
    assert begin(tmp_path / "held") == whole
    with (
        Store(tmp_path / "used", create=True),
        pytest.raises(ValueError, match="another process is using it"),
    ):
        begin(tmp_path / "used")
    assert (tmp_path / "used/results.sqlite").is_file()
