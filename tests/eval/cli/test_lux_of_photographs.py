"""What lux mean for photographs: the terminal's clause, and ``--grey-anchor`` of sweeps and decisions."""

import cv2
import numpy as np
import pytest
import torch
from blurnoise_eval import expose
from commands import main

from blurnoise.camera.colour import toned

SHORT = ("--lux", "10", "--exposure-ms", "10", "--dx", "0", "--threads", "1")


@pytest.mark.slow
@pytest.mark.parametrize("command", ["sweep", "decide"])
@pytest.mark.parametrize(
    ("anchor", "clause"),
    [
        ((), "lux: brightness is used as reflectance, so a photograph darker by 1 EV gets half of the light"),
        (("--grey-anchor", "mean"), "lux: the mean of each picture reflects 18 % (--grey-anchor mean)"),
    ],
)
def test_the_terminal_says_what_lux_mean(tmp_path, capsys, command, anchor, clause):
    (tmp_path / "photos").mkdir()
    seen = np.random.default_rng(1).integers(0, 200, (64, 96, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "photos" / "a.png"), cv2.GaussianBlur(seen, (0, 0), 3))
    given = ("--images", str(tmp_path / "photos"), "-o", str(tmp_path / "run"), *SHORT, *anchor)
    assert main([command, *given]) == 0
    assert clause in " ".join(capsys.readouterr().out.split())


def test_rendered_signs_need_no_such_clause(tmp_path, capsys):
    """Their brightness is reflectance."""
    assert main(["sweep", "--limit", "1", "-o", str(tmp_path / "run"), *SHORT]) == 0
    assert "lux:" not in capsys.readouterr().out


def explored(folder, *words):
    """A dim picture as the explorer writes it."""
    cv2.imwrite(str(folder / "dim.png"), np.full((24, 32, 3), 60, np.uint8))
    at = "exposure-ms=10&lux=60&gain=0&dx=0"
    given = ("--model", "none", "--at", at, "-o", str(folder / "out.png"), *words)
    assert main(["explore", str(folder / "dim.png"), *given]) == 0
    return cv2.imread(str(folder / "out.png"))


def test_an_explored_photograph_has_its_anchor(tmp_path, capsys):
    plain = explored(tmp_path)
    assert "a photograph darker by 1 EV gets half of the light" in " ".join(capsys.readouterr().out.split())
    anchored = explored(tmp_path, "--grey-anchor", "mean")
    assert "the mean of each picture reflects 18 %" in " ".join(capsys.readouterr().out.split())
    assert anchored.mean() > plain.mean() + 20
    taken = expose(
        np.full((24, 32, 3), 60, np.uint8),
        "imx250m",
        grey_anchor="mean",
        exposure_s=0.01,
        illuminance_lux=60.0,
    )
    assert taken.image.mean() == pytest.approx(anchored.mean(), abs=0.5)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("dim.png", "--grey-anchor", "card"), "--grey-anchor = 'card': must be mean, pNN"),
        (("--grey-anchor", "mean"), "--grey-anchor = 'mean': needs a picture"),
    ],
)
def test_an_anchor_of_nothing_is_one_line(tmp_path, capsys, monkeypatch, words, why):
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("dim.png", np.full((24, 32, 3), 60, np.uint8))
    assert main(["explore", *words, "-o", "out.png"]) == 2
    assert why in capsys.readouterr().err


@pytest.fixture
def stops_apart(tmp_path):
    """Arguments for a sweep of flat pictures of 2 to 32 % of white, a stop apart: sqrt(2) EV."""
    (tmp_path / "photos").mkdir()
    for place, linear in enumerate((0.02, 0.04, 0.08, 0.16, 0.32)):
        coded = 255 * float(toned(torch.tensor(linear), "typical"))
        cv2.imwrite(str(tmp_path / "photos" / f"{place}.png"), np.full((24, 32, 3), round(coded), np.uint8))
    return ("--images", str(tmp_path / "photos"), "-o", str(tmp_path / "run"), *SHORT)


@pytest.mark.slow
def test_a_sweep_says_by_how_much_its_photographs_differ(stops_apart, capsys):
    assert main(["sweep", *stops_apart]) == 0
    assert "(the pictures' light differs by 1.4 EV, SD)" in " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
def test_anchored_photographs_do_not_differ(stops_apart, capsys):
    assert main(["sweep", *stops_apart, "--grey-anchor", "mean"]) == 0
    assert "EV" not in capsys.readouterr().out
