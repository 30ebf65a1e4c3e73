"""``blurnoise validate``: compare simulated frames with the frames of a camera."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from blurnoise_eval.cli._options import FramesCfa, FramesLayout, Json, NewFolder
from blurnoise_eval.system.terminal import say, say_json, say_wrapped, table_lines


def validate(
    frames: Annotated[Path, Argument(metavar="FRAMES", help="folder of dark and flat frames")],
    *,
    output: NewFolder,
    camera: Annotated[
        str | None,
        Option(metavar="NAME|FILE", help="camera to simulate (default: fitted to every other level)"),
    ] = None,
    raw_layout: FramesLayout = None,
    cfa: FramesCfa = None,
    seed: Annotated[int, Option(metavar="N", help="seed of the simulated noise")] = 0,
    as_json: Json = False,
) -> None:
    """Simulate the dark and flat frames of a camera and compare them with the real frames, level by level.

      blurnoise validate frames/ -o check
      blurnoise validate frames/ --camera mine.yaml -o check

    Compared are mean, variance, kurtosis, correlation, rows, columns and spectrum of the noise and of the fixed
    pattern. A classifier also tries to tell real frames from simulated ones.

    Without --camera, a camera is fitted to half of the levels and compared with the other half. FRAMES is a folder as
    for 'blurnoise cameras fit'. The command writes DIR/validation.html, .csv and .json, and the fitted camera as
    DIR/camera.yaml.
    """
    from blurnoise_eval import cameras
    from blurnoise_eval.calibration.formats import RawLayout
    from blurnoise_eval.measure import page
    from blurnoise_eval.measure.frames import validate as compared
    from blurnoise_eval.system.files import check_outputs, write_records

    check_outputs(output, "validation.html", "validation.csv", "validation.json", "camera.yaml")
    layout = RawLayout.parse(raw_layout) if raw_layout else None
    known = cameras.find(camera) if camera else None
    found = compared(frames, known, layout=layout, cfa=cfa, seed=seed)
    output.mkdir(parents=True, exist_ok=True)
    rows = [each.row() for each in found.comparisons]
    names = ("real from simulated", "real from real")
    scores = {
        kind: {
            name: [auc.value, auc.low, auc.high]
            for name, auc in zip(names, pair, strict=True)
            if auc.available
        }
        for kind, pair in found.apart.items()
    }
    facts = {
        "answer": found.answer,
        "camera": found.camera.name,
        "classifier": scores,
        "notes": [*found.notes],
    }
    document = {**facts, "rows": rows}
    write_records("validation", rows, document, output)
    written = page.write(found, output)
    if found.fitted:
        found.camera.save(output / "camera.yaml")
    if as_json:
        say_json({"output": str(output), **document})
        return
    say_wrapped(found.answer)
    for kind in found.apart:
        heads = (f"{kind} frames", *page.HEADS[1:])
        rows_shown = [cells for cells, _ in page.summary(found, kind)]
        say("", *table_lines(heads, rows_shown, [place > 1 for place in range(len(heads))]))
    say("", *found.notes, f"page: {written}")
