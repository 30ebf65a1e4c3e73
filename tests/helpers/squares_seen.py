"""Runs whose failures are known: squares of two brightnesses, a model that is as sure as they are bright."""

from pathlib import Path

import numpy as np
from blurnoise_eval.datasets import PictureSet, Target, image_folder, write_picture
from blurnoise_eval.run.evaluation import evaluate
from plans import plan

SQUARES = {"bright": ((10, 12, 26, 28), 250), "grey": ((50, 30, 74, 54), 150)}
SIZE_PX = 96, 64
PLAN = plan((0.0005, 0.002, 0.008), (200.0,), (0.0, 2000.0), gain_db=(0.0,))


def sure_of_light(picture):
    """Both squares where they are at rest, with the mean of their pixels as score, and a false one."""
    boxes = [box for box, _ in SQUARES.values()]
    scores = [picture[y0:y1, x0:x1].mean() / 255 for x0, y0, x1, y1 in boxes]
    return [*boxes, (0, 0, 8, 8)], [*scores, 0.5], [*SQUARES, "bright"]


def squares_run(folder: Path, **how):
    """A run of three such pictures, in ``folder``/run; the pictures are in ``folder``/pictures."""
    (folder / "pictures").mkdir()
    for number, name in enumerate(("dim.png", "<b>odd & 100%.png", "plain.png")):
        picture = np.full((SIZE_PX[1], SIZE_PX[0], 3), 20, np.uint8)
        for (x0, y0, x1, y1), value in SQUARES.values():
            picture[y0:y1, x0:x1] = value - 40 * number
        write_picture(folder / "pictures" / name, picture)
    targets = tuple(Target(label, f"{label} squares", box) for label, (box, _) in SQUARES.items())
    opened = image_folder(folder / "pictures")
    labelled = [type(each)(each.name, targets, each.load, each.identity, each.image_id) for each in opened]
    pictures = PictureSet("folder", opened.source, tuple(labelled))
    how = {"strategy": "grid", "progress": False, **how}
    return evaluate(sure_of_light, pictures, "imx250", PLAN, output=folder / "run", **how)
