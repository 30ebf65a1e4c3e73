"""The page of failures says of every target what targets.csv says of it, and shows it where it is."""

import base64
import json
import shutil
from itertools import product
from typing import Any

import browsers
import cv2
import numpy as np
import pandas as pd
import pytest
from blurnoise_eval.report import failures
from blurnoise_eval.run.run import Run
from blurnoise_eval.store.columns import AxisValues
from blurnoise_eval.store.store import Store
from read_pages import Page
from squares_seen import SIZE_PX, SQUARES, squares_run

FOUND = 0.25
CHOOSE = """globalThis.choose = (id, word) => {
  const select = byId(id);
  select.value = [...select.options].find(each => each.text === word).value;
  select.dispatchEvent(new Event("change"));
};"""
KINDS = ("found at A, missed at B", "missed at A, found at B", "found at both", "missed at both")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    done = squares_run(tmp_path_factory.mktemp("squares"))
    done.report()
    return done


@pytest.fixture(scope="module")
def numbers(run):
    return numbers_of(run.folder / "failures.html")


@pytest.fixture(scope="module")
def targets(run):
    return pd.read_csv(run.folder / "targets.csv")


def numbers_of(page):
    return next(json.loads(text) for text in Page(page).scripts if text.startswith("{"))


def codes_of(model, n_conditions):
    return np.frombuffer(base64.b64decode(model["codes"]), "<u2").reshape(n_conditions, -1)


def counts_by_pandas(targets, a, b):
    """How many targets are of each of ``KINDS``, between two selections of rows."""
    key = ["image", "target_id"]
    both = a.merge(b, on=key, suffixes=("_a", "_b"))
    first, second = both["confidence_a"] >= FOUND, both["confidence_b"] >= FOUND
    return [int(each.sum()) for each in (first & ~second, ~first & second, first & second, ~first & ~second)]


def test_every_target_is_found_or_missed_as_in_the_table(numbers, targets):
    exposures, speeds = numbers["axes"]
    assert (exposures, speeds) == (["0.5 ms", "2 ms", "8 ms"], ["0 px/s", "2000 px/s"])
    (model,) = numbers["models"]
    codes = codes_of(model, len(numbers["conditions"]))
    seen = []
    for place, at in enumerate(numbers["conditions"]):
        for (picture, _, label, *_), code in zip(model["targets"], codes[place].tolist(), strict=True):
            exposure_s = None if at is None else (0.0005, 0.002, 0.008)[at[0]]
            speed = None if at is None else (0.0, 2000.0)[at[1]]
            name = numbers["pictures"][picture][0]
            seen.append((name, model["labels"][label], exposure_s, speed, bool(code & 1), (code >> 1) / 1000))
    columns = ["image", "label", "exposure_s", "velocity_x_px_s", "found", "confidence"]
    seen = pd.DataFrame(seen, columns=columns).sort_values(columns[:4], ignore_index=True)
    told = targets.assign(found=targets["confidence"] >= FOUND)[columns]
    told = told.sort_values(columns[:4], ignore_index=True)
    pd.testing.assert_frame_equal(seen, told, check_dtype=False, check_exact=False, atol=5.1e-4, rtol=0)
    assert 5 < told["found"].sum() < len(told) - 5


def test_a_confidence_just_below_is_missed_though_it_reads_alike(run, targets, tmp_path):
    """0.24996 rounds to 0.250, and is below 0.25."""
    copy = tmp_path / "run"
    shutil.copytree(run.folder, copy)
    with Store(copy, create=True) as store, store._transaction() as db:
        db.execute("UPDATE targets SET confidence = 0.24996 WHERE label = 'grey' AND clean = 1")
    Run.open(copy, progress=False).report()
    model = numbers_of(copy / "failures.html")["models"][0]
    original = codes_of(model, 7)[0]
    grey = [model["labels"][each[2]] == "grey" for each in model["targets"]]
    assert original[grey].tolist() == [500] * 3
    assert (original[~np.array(grey)] & 1).all()


def test_boxes_and_pictures_are_the_original_ones(run, numbers):
    for picture, _, label, *box in numbers["models"][0]["targets"]:
        name = numbers["models"][0]["labels"][label]
        assert tuple(box) == SQUARES[name][0]
        assert numbers["pictures"][picture][1:3] == list(SIZE_PX)
    for name, width, height, jpeg in numbers["pictures"]:
        shown = cv2.imdecode(np.frombuffer(base64.b64decode(jpeg), np.uint8), cv2.IMREAD_COLOR)
        real = cv2.imread(str(run.folder.parent / "pictures" / name))
        small = cv2.resize(shown, (width, height), interpolation=cv2.INTER_AREA)
        assert np.abs(small.astype(int) - real).mean() < 4, name


def test_the_opening_begins_with_the_exposure_that_finds_most(numbers, targets):
    model, a, b = numbers["opening"]
    at_a, at_b = numbers["conditions"][a], numbers["conditions"][b]
    assert at_a[1:] == at_b[1:]
    exposed = targets[targets["clean"] == False]  # noqa: E712
    exposed = exposed.assign(found=exposed["confidence"] >= FOUND)
    counts = exposed.groupby(["velocity_x_px_s", "exposure_s"])["found"].sum()
    speed, exposures = (0.0, 2000.0)[at_a[1]], (0.0005, 0.002, 0.008)
    assert counts[speed, exposures[at_a[0]]] == counts[speed].max() > counts[speed, exposures[at_b[0]]]
    assert model == 0


FOUND_AT_3_MS = {(3, 1): 4, (30, 1): 3, (3, 400): 4, (30, 400): 1, (3, 20000): 4, (30, 20000): 0}
"""Of four targets, by ms and lux."""


@pytest.mark.parametrize(
    ("found", "white", "opens"),
    [
        (
            FOUND_AT_3_MS,
            {(30, 20000)},
            (3, 30, 400),
        ),  # two lost say more than one, and white says nothing
        (
            {(3, 1): 4, (30, 1): 3, (3, 9): 4, (30, 9): 0},
            {(30, 9)},
            (3, 30, 1),
        ),  # one lost, but not in white
        (FOUND_AT_3_MS | {(30, 1): 2}, {(30, 20000)}, (3, 30, 1)),  # the darker of two that lose enough
        (FOUND_AT_3_MS | {(0.3, 1): 0, (30, 1): 2}, {(30, 20000)}, (3, 30, 1)),  # blur, before darkness
        ({(3, 1): 0, (0.3, 1): 0, (3, 400): 4, (0.3, 400): 3, (0.03, 400): 0}, set(), (3, 0.03, 400)),
        # a black picture teaches as little
        ({(3, 400): 4, (0.3, 400): 3, (0.03, 400): 0}, {(0.03, 400)}, (3, 0.3, 400)),
        (
            {(3, 20000): 4, (30, 20000): 0},
            {(30, 20000)},
            (3, 30, 20000),
        ),  # white where there is nothing else
    ],
)
def test_the_opening_teaches(found, white, opens):
    """Motion blur by night rather than a white picture by day."""
    exposures, lights = (sorted({at[axis] for at in found}) for axis in (0, 1))
    conditions = [AxisValues.of({"exposure_s": ms / 1e3, "illuminance_lux": lux}) for ms, lux in found]
    places: list[Any] = [(exposures.index(ms), lights.index(lux)) for ms, lux in found]
    codes = [[2 * 900 + 1] * n + [2 * 100] * (4 - n) for n in found.values()]
    model = failures._Model("model", [], np.array(codes, np.uint16), 0)
    tested = failures._TestedConditions([], [(at, 0) for at in conditions], places)
    seen = {("model", at) for at, key in zip(conditions, found, strict=True) if key not in white}
    view = max(failures._views(0, model, tested, seen), key=lambda each: each.teaches)
    (ms_a, lux), (ms_b, same) = list(found)[view.a], list(found)[view.b]
    assert (ms_a, ms_b, lux) == opens
    assert lux == same
    assert len(view.lost) == found[ms_a, lux] - found[ms_b, lux]


def test_crops_show_the_target_as_the_model_saw_it(numbers, run, targets):
    """Each against the mean of the square's pixels, which is the model's confidence."""
    assert numbers["crops"]
    codes = codes_of(numbers["models"][0], len(numbers["conditions"]))
    for key, (jpeg, left, top, width, height) in numbers["crops"].items():
        _, target, condition = map(int, key.split(":"))
        shown = cv2.imdecode(np.frombuffer(base64.b64decode(jpeg), np.uint8), cv2.IMREAD_GRAYSCALE)
        rows, columns = shown.shape
        x, y = round(left * columns / 100), round(top * rows / 100)
        inside = shown[y : y + round(height * rows / 100), x : x + round(width * columns / 100)]
        assert inside.mean() / 255 == pytest.approx((codes[condition, target] >> 1) / 1000, abs=0.03)


@pytest.fixture
def copy(run, tmp_path):
    return shutil.copytree(run.folder, tmp_path / "run")


def test_without_the_pictures_a_page_that_has_them_stays(copy, numbers, tmp_path):
    with pytest.warns(UserWarning, match=r"stays as it was, with 3 pictures; 0 of 3 .*--images"):
        Run.open(copy, progress=False, images=tmp_path / "gone").report()
    assert numbers_of(copy / "failures.html") == numbers


def test_without_the_pictures_a_new_page_says_so(copy, numbers, tmp_path):
    other = tmp_path / "other"
    with pytest.warns(UserWarning, match="has no pictures"):
        Run.open(copy, progress=False, images=tmp_path / "gone").report(other)
    left = numbers_of(other / "failures.html")
    assert [each[3] for each in left["pictures"]] == [None] * 3
    assert left["models"] == numbers["models"]
    assert "3 of 3 pictures cannot be shown" in Page(other / "failures.html").text


def test_pictures_that_moved_are_shown_from_their_new_folder(run, copy, numbers, tmp_path):
    there = shutil.copytree(run.folder.parent / "pictures", tmp_path / "elsewhere")
    Run.open(copy, progress=False, images=there).report(tmp_path / "other")
    assert numbers_of(tmp_path / "other" / "failures.html")["pictures"] == numbers["pictures"]


def test_cells_that_cannot_be_simulated_again_leave_the_page_without_crops(copy, numbers):
    with Store(copy, create=True) as store, store._transaction() as db:
        for table in ("cells", "targets"):
            db.execute(f"UPDATE {table} SET cell_id = substr(cell_id, 2) || substr(cell_id, 1, 1)")
    Run.open(copy, progress=False).report()
    left = numbers_of(copy / "failures.html")
    assert left["crops"] == {}
    assert left["models"] == numbers["models"]


def test_what_is_too_much_is_left_out_and_counted(run, tmp_path, monkeypatch):
    monkeypatch.setattr(failures, "MOST_CODES", 4 * 7)
    monkeypatch.setattr(failures, "MOST_PICTURE_BYTES", 1)
    Run.open(run.folder, progress=False).report(tmp_path)
    left = numbers_of(tmp_path / "failures.html")
    text = Page(tmp_path / "failures.html").text
    assert len(left["models"][0]["targets"]) == 4
    assert "2 targets whose confidence changes least are left out" in text
    assert sum(each[3] is not None for each in left["pictures"]) == 1
    assert f"{len(left['pictures']) - 1} of {len(left['pictures'])} pictures cannot be shown" in text


@pytest.mark.slow
@pytest.mark.skipif(browsers.CHROMIUM is None, reason="no Chromium on this machine")
def test_page_in_a_browser_counts_as_pandas_does(run, targets):
    clean = targets["clean"].astype(bool)
    choices = {"original picture": targets[clean]}
    with browsers.browser() as browser:
        tab = browser.tab()
        tab.open((run.folder / "failures.html").as_uri())
        tab.until("document.querySelectorAll('article').length")
        tab.run(CHOOSE)
        for speed in (0.0, 2000.0):
            of = targets[targets["velocity_x_px_s"] == speed]
            choices |= {f"{1e3 * each:g} ms": of[of["exposure_s"] == each] for each in (0.0005, 0.002, 0.008)}
            tab.run(f"choose('axis-1', '{speed:g} px/s')")
            for a, b in product(choices, repeat=2):
                tab.run(f"choose('a', '{a}'), choose('b', '{b}')")
                shown = tab.run("[...byId('kind').options].map(each => each.text)")
                expected = counts_by_pandas(targets, choices[a], choices[b])
                assert shown == [f"{kind} ({n})" for kind, n in zip(KINDS, expected, strict=True)], (a, b)
        tab.run(
            "choose('a', 'original picture'), choose('b', 'original picture'), byId('kind').value = 2, draw()"
        )
        assert tab.run("document.querySelectorAll('article').length") == 6
        tab.run("byId('name').value = 'ODD', byId('name').dispatchEvent(new Event('input'))")
        assert tab.run("document.querySelectorAll('article').length") == 2
        assert tab.run("document.querySelector('figcaption').textContent") == "<b>odd & 100%.png"
        tab.run("choose('label', 'grey')")
        assert tab.run("document.querySelectorAll('article').length") == 1
        tab.run("choose('size', 'above 96 px')")
        assert tab.run("document.querySelectorAll('article').length") == 0
        assert tab.run("document.querySelectorAll('b').length") == 0
        tab.call(
            "Emulation.setDeviceMetricsOverride", width=400, height=900, deviceScaleFactor=1, mobile=True
        )
        assert tab.run("document.documentElement.scrollWidth") <= 400
        assert not tab.failures
        assert [url for url in tab.asked if not url.startswith(("file:", "data:"))] == []
        tab.close()
