"""The bench of scale: its arithmetic, its rows, its command."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest
from blurnoise_eval.bench import scale, scale_pictures, scale_view
from blurnoise_eval.bench.scale import Bench, Extent, Row
from blurnoise_eval.bench.scale_pictures import Pictures
from blurnoise_eval.bench.scale_work import CELLS, SleepingWork, made_blocks, results
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.blocks import Block
from blurnoise_eval.sweep.engines import ThreadEngine
from blurnoise_eval.sweep.flight import IN_FLIGHT, Answers
from blurnoise_eval.sweep.work import Work


def row(engine: str, driver_ms: float, cell_s: float = 0.0) -> Row:
    return Row(engine, 2, cell_s, 800, 100.0, None, driver_ms, 1.0, 500.0, None)


MADE = Bench(
    [row("threads", 9.0), row("processes", 0.15), row("ray", 0.4), row("ray", 0.35), row("ray", 0.1, 0.08)],
    store_ms=0.1, cell_bytes=5000.0, disk_bytes=1500.0, extent=Extent(cell_s=(0.0, 0.08)), machine={},
)  # fmt: skip


def test_what_gives_out_first() -> None:
    """The driver: its own time and the store's, of cells that take none; threads have no line of their own."""
    assert MADE.engines == ["processes", "ray"]
    assert MADE.cost_ms("processes") == pytest.approx(0.25)
    assert MADE.most_rate("ray") == pytest.approx(1e3 / 0.45)
    assert MADE.paper("processes", 0.08, 100) == pytest.approx(1250.0)
    assert MADE.paper("processes", 0.08, 1000) == pytest.approx(4000.0)
    told = MADE.losses()
    assert (
        "processes: 0.15 ms of the driver and 0.10 ms of the store a cell: at most 1000 / 0.25 = 4000 cells/s; "
        "for cells of t ms on t / 0.25 cores" in told
    )
    assert "processes, 80 ms a cell: 12.5 cells/s a core, the driver is full from 320 cores on" in told
    held = 1000 * IN_FLIGHT * CELLS * 5000 / 1e6
    assert any(
        "20.0 MB/s of rows come in, 6.0 MB/s are stored" in line and f"{held:.0f} MB" in line for line in told
    )


def test_pictures_on_their_way() -> None:
    """As they come, every worker would begin with each; looking ahead, a few do."""
    pictures = Pictures(20.0, 5.0, 100_000, {8: 2.0, 1000: 4.0})
    few, many = replace(MADE, pictures=pictures).losses()[6:8]
    assert "8 workers: each picture is begun by 2.0 of them, not 8: 2.0, not 8.0 MB/s" in few
    assert "2.0, not 8.0 % of the work" in few
    assert "by 4.0 of them, not 50: 4.0, not 49.9 MB/s" in many
    assert 1.0 <= scale_pictures.begun_by(16) < 4.0


def test_made_up_rows_fit_the_store(tmp_path: Path) -> None:
    work = SleepingWork()
    blocks = list(made_blocks(3))
    with Store(tmp_path, create=True) as store:
        for block in blocks:
            store.add(work.open(1).compute(block))
        assert (
            len(list(store.cells()))
            == 3 * CELLS
            == len({cell.cell_id for block in blocks for cell in block.cells})
        )
        assert len(list(store.targets())) == 6 * CELLS
    assert results(blocks[0])[0].cell == results(blocks[0])[0].cell


def test_threads_are_measured_and_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scale, "engines", lambda: ["threads"])
    extent = Extent((1, 2), (0.0, 0.002), 0.1, 80, 0)
    shares = list[float]()
    bench = scale.measure(extent, progress=shares.append)
    assert sum(shares) == scale.steps(extent)
    assert [(each.workers, each.cell_s) for each in bench.rows] == [
        (1, 0.0),
        (1, 0.002),
        (2, 0.0),
        (2, 0.002),
    ]
    for each in bench.rows:
        assert each.cells > 0
        assert each.ideal is None or 0 < each.rate < 1.01 * each.ideal
    assert bench.store_ms > 0
    assert 500 < bench.cell_bytes < 20_000
    scale.write(bench, tmp_path)
    assert len((tmp_path / "scale.csv").read_text().splitlines()) == 5
    assert json.loads((tmp_path / "scale.json").read_text())["rows"][0]["engine"] == "threads"


def test_an_engine_that_cannot_begin_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    class Unreachable(ThreadEngine):
        def map(self, work: Work, blocks: Iterable[Block]) -> Answers:
            raise ChildProcessError("no worker could be had")

    monkeypatch.setattr(scale, "engines", lambda: ["processes", "threads"])
    monkeypatch.setitem(scale.ENGINES, "processes", Unreachable)
    shares = list[float]()
    extent = Extent((1,), (0.0,), 0.05, 8, 0)
    bench = scale.measure(extent, progress=shares.append)
    assert [each.engine for each in bench.rows] == ["threads"]
    assert bench.losses()[0] == "processes: left out (no worker could be had)"
    assert sum(shares) == scale.steps(extent)


def test_the_chart_and_the_table(tmp_path: Path) -> None:
    scale_view.write(MADE, tmp_path)
    assert (tmp_path / "scale.png").stat().st_size > 10_000
    (table,) = scale_view.tables(MADE)
    assert table.row_count == 5


@pytest.mark.slow
def test_the_page_of_a_made_up_run_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of whole pictures, 401 cells each; the page has a process of its own."""
    monkeypatch.setattr(scale, "engines", list)
    bench = scale.measure(Extent(stored=8, results=402))
    assert bench.results["cells"] == 802
    assert bench.results["peak_mb"] > 100
    assert bench.results["cpu_s"] > 1
    assert bench.losses()[-1].startswith("page and tables of 802 cells: ")


@pytest.mark.slow
def test_processes_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scale, "engines", lambda: ["processes"])
    bench = scale.measure(Extent((2,), (0.0, 0.004), 0.5, 80, 0))
    assert [each.engine for each in bench.rows] == ["processes"] * 2
    assert all((each.worker_mb or 0) > 50 for each in bench.rows)
    assert bench.rows[1].start_s < bench.rows[0].start_s  # the workers stayed
