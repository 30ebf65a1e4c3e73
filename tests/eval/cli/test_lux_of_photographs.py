"""What lux mean for photographs: the terminal's clause, and ``--grey-anchor`` of sweeps and decisions."""

import cv2
import numpy as np
import pytest
from commands import main

SHORT = ("--lux", "10", "--exposure-ms", "10", "--dx", "0", "--threads", "1")


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
