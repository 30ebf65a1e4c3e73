"""A sweep survives its own death, pictures that cannot be used and a set larger than memory."""

import os
import pickle
import random
import subprocess
import sys
import weakref
from contextlib import suppress
from dataclasses import replace

import pytest
from blurnoise_eval.run.engines import ThreadEngine
from blurnoise_eval.run.identity import begun_or_gone
from blurnoise_eval.run.work import count_cells
from blurnoise_eval.store.store import Store
from blurnoise_eval.system import working_folder
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.urls import location
from plans import plan as swept
from processes import limited, with_helpers
from s3_servers import BUCKET, at, s3_server
from signs_in_memory import (
    CAMERA,
    PLAN,
    TWO,
    computed,
    everything,
    noise,
    picture,
    picture_set,
    rows_of,
    sign,
    some_pictures,
    unreadable,
)
from stored_rows import result

ONE = swept((0.01,), (50.0,), repeats=2)


@pytest.mark.parametrize(("threads", "after"), [(1, 1), (1, 20), (3, 25)])
def test_interrupted_sweep_goes_on(detector, tmp_path, threads, after):
    settled = []

    def interrupt(cells):
        settled.append(cells)
        if sum(settled) >= after:
            raise KeyboardInterrupt

    def run(**options):
        return computed(tmp_path / "run", [detector], TWO, ThreadEngine(threads), PLAN, **options)

    total = count_cells(TWO, PLAN)
    with pytest.raises(KeyboardInterrupt):
        run(progress=interrupt)
    with Store(tmp_path / "run") as store:  # it is whole: it can be read at once
        kept = len({row.cell_id for row in store.cells()})
    assert after <= kept < total
    told = []
    outcome = run(progress=told.append)
    assert (outcome.resumed, outcome.computed, sum(told)) == (kept, total - kept, total)
    assert everything(tmp_path / "run") == rows_of(tmp_path / "whole", [detector], CAMERA, TWO, PLAN)
    again = run()
    assert (again.resumed, again.computed) == (total, 0)


@pytest.mark.parametrize("threads", [1, 2])
def test_pictures_in_memory_do_not_grow_with_the_set(detector, tmp_path, threads):
    """Scenes that are kept, and one that each task at work may still hold."""
    live = set()
    most = 0

    def load():
        nonlocal most
        image = noise(32, 32)
        live.add(id(image))
        weakref.finalize(image, live.discard, id(image))
        most = max(most, len(live))
        return image

    many = picture_set(*[picture(f"p{index}", load) for index in range(40)])
    assert computed(tmp_path, [detector], many, ThreadEngine(threads), ONE).computed == 120
    assert most <= 2 * threads + 2


def test_unreadable_picture_is_named_and_skipped_until_it_is_mended(detector, tmp_path):
    bad, told = picture("bad.png", unreadable), list[int]()
    for mended in (False, False, True):
        told.clear()
        shown = picture_set(picture("a"), replace(bad, load=sign) if mended else bad, picture("z"))
        outcome = computed(tmp_path, [detector], shown, ThreadEngine(2), ONE, progress=told.append)
        assert outcome.skipped == ({} if mended else {"bad.png": "bad.png: is empty (0 bytes)"})
        with Store(tmp_path) as store:
            assert [entry.image for entry in store.skipped()] == ([] if mended else ["bad.png"])
            assert ("bad.png" in {cell.image for cell in store.cells()}) == mended
        assert sum(told) == count_cells(shown, ONE)


# --- which folder is whose ---


def begin(folder, *, cells=0, skipped=False, before="", meanwhile=""):
    """Fail after so much was stored; what is there then."""
    for name in before.split():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("mine")
    begun = begun_or_gone(folder, [], TWO)
    with suppress(KeyboardInterrupt), begun, Store(folder, create=True) as store:
        (folder / "coco").mkdir(exist_ok=True)
        write_whole(folder / "coco/instances.json", b"{}")
        for name in meanwhile.split():
            (folder / name).write_text("mine, too")
        store.add([result(number) for number in range(cells)])
        if skipped:
            store.skip("a.png", "cannot be read")
        raise KeyboardInterrupt
    return sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []


def test_what_has_begun_and_what_was_there_stay(tmp_path):
    whole = ["coco", "results.sqlite"]
    assert begin(tmp_path / "new") == []
    assert not (tmp_path / "new").exists()
    assert begin(tmp_path / "cell", cells=1) == whole
    assert begin(tmp_path / "skipped", skipped=True) == whole
    assert begin(tmp_path / "mine", before="notes.txt") == ["notes.txt"]
    assert begin(tmp_path / "ours", meanwhile="download.zip") == ["download.zip"]
    theirs = "coco/mine.json examples/a.png results.sqlite-old results.sqlite.bak"
    assert begin(tmp_path / "more", before=theirs, meanwhile="results.sqlite-1 coco/b.json") == [
        "coco", "examples", "results.sqlite-1", "results.sqlite-old", "results.sqlite.bak"
    ]  # fmt: skip
    assert sorted(path.name for path in (tmp_path / "more/coco").iterdir()) == ["b.json", "mine.json"]
    with Store(tmp_path / "held", create=True) as store:
        store.set_about("identity", {})
    assert begin(tmp_path / "held") == whole
    used = pytest.raises(ValueError, match="another process is using it")
    with Store(tmp_path / "used", create=True), used:
        begin(tmp_path / "used")
    assert (tmp_path / "used/results.sqlite").is_file()


# --- drivers that are killed over and over, at cells by a fixed seed, and begun again ---

LONG = swept(tuple(ms / 1e3 for ms in range(1, 13)), (50.0, 200.0), (0.0, 300.0))
_DRIVER = """
import pickle, sys
from pathlib import Path
from blurnoise_eval.store.store import Store
from blurnoise_eval.run.engines import ThreadEngine
from blurnoise_eval.run.computing import compute
from blurnoise_eval.system import working_folder
from blurnoise_eval.system.urls import location
from signs_in_memory import CAMERA
given, where = sys.argv[1:]
detector, pictures, plan = pickle.loads(Path(given).read_bytes())
with working_folder.written_run(location(where)) as folder, Store(folder.path, create=True) as store:
    told = lambda cells: print(cells, flush=True)
    compute([detector], CAMERA, pictures, plan, store, engine=ThreadEngine(2), progress=told)
"""


def driven(command, kill_at, env):
    """Begin a driver and kill it once it has settled so many cells, None: never. How many it was heard to have."""
    settled, pipe = 0, subprocess.PIPE
    env = {**os.environ, "PYTHONPATH": with_helpers(), **env}
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=env) as driver:
        for line in driver.stdout:
            settled += int(line)
            if kill_at is not None and settled >= kill_at:
                driver.kill()
                break
        _, complaint = driver.communicate()
    assert kill_at is not None or driver.returncode == 0, complaint
    assert kill_at is None or settled >= kill_at, complaint
    return settled


@pytest.mark.slow
def test_killed_with_a_run_on_s3(detector, tmp_path, monkeypatch):
    """What is killed goes on from what its machine has, and is put in the end; another machine reads it."""
    s3fs = pytest.importorskip("s3fs")
    (tmp_path / "pictures").mkdir()
    shown = some_pictures(tmp_path / "pictures")
    two = replace(shown, pictures=shown.pictures[:2])
    computed(tmp_path / "unbroken", [detector], two, ThreadEngine(2), LONG)
    where, total = f"s3://{BUCKET}/run", count_cells(two, LONG)
    (tmp_path / "given").write_bytes(pickle.dumps((detector, two, LONG)))
    with limited(550), s3_server() as server:
        at(server, monkeypatch.setenv)
        s3fs.S3FileSystem(skip_instance_cache=True).mkdir(BUCKET)
        driver = [sys.executable, "-c", _DRIVER, str(tmp_path / "given"), where]
        for kill_at in [1, *sorted(random.Random(8).sample(range(2, total - 10), 2)), None]:
            settled = driven(driver, kill_at, {"BLURNOISE_CACHE": str(tmp_path / "machine")})
        assert settled == total
        monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "reader"))
        with working_folder.read_run(location(where)) as folder:
            assert everything(folder.path) == everything(tmp_path / "unbroken")
