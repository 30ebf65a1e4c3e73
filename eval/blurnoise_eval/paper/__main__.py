"""``python -m blurnoise_eval.paper``: the paper that this project starts from, rerun."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from blurnoise_eval.cli import given, run_alone
from blurnoise_eval.cli._options import Contract, Json, Threads, new_folder
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say, say_json

ITEM_NAMES = "table-2, quanta, frequencies, mtf50, mtf50-dx, patch-snr, edge-snr, clipping, sic, neq, detection, maps, ocr, ocr-dx"  # noqa: E501


def paper(
    *,
    only: Annotated[
        list[str] | None, Option(metavar="ITEM", help=f"only this item, may be repeated: {ITEM_NAMES}")
    ] = None,
    quick: Annotated[
        bool, Option("--quick", help="one noise field for each condition instead of three")
    ] = False,
    model: Annotated[
        Path | None,
        Option(metavar="M.onnx", help="the detector that finds the signs (default: the built-in one)"),
    ] = None,
    contract: Contract = None,
    seed: Annotated[int, Option(metavar="N", help="of the noise")] = 0,
    threads: Threads = None,
    output: Annotated[
        Path, Option("-o", "--output", parser=new_folder, metavar="DIR", help="for page and table")
    ],
    as_json: Json = False,
) -> None:
    """Rerun the paper that this project starts from, Lin et al., Sensors 2024, 24(16), 5135: its tables and figures
    item by item beside what is found here, what should agree and by which rule.

      python -m blurnoise_eval.paper -o paper                             everything: minutes
      python -m blurnoise_eval.paper -o paper --quick                     one noise field
      python -m blurnoise_eval.paper -o paper --only table-2 --only sic   two items
      python -m blurnoise_eval.paper -o paper --model yolov5m.onnx

    Pictures go to networks in two chains side by side: as the paper makes them (grey of coded values, taken for
    light, linear 8 bits), and as a camera does. Writes DIR/paper.csv (item, expected, found, rule, verdict) and
    DIR/paper.html. Exit code 1 where an item that should agree does not. Text is read with PP-OCR of the package
    rapidocr; where that is missing, its items are "not run".
    """
    workers = given.threads(threads)
    from blurnoise._core.checks import integer
    from blurnoise._core.rng import LAST_SEED
    from blurnoise_eval.detectors.ocr import Recogniser
    from blurnoise_eval.detectors.ocr.packaged import rapidocr_models
    from blurnoise_eval.paper import page, table
    from blurnoise_eval.paper.measurement import Measurements

    integer("seed", seed, 0, LAST_SEED)
    items = table.chosen(only or ())
    networks = rapidocr_models()
    measured = Measurements(
        given.detector(model, contract),
        None if networks is None else Recogniser(networks[1]),
        repeats=1 if quick else 3,
        threads=workers,
        seed=seed,
    )
    outcomes = []
    with ProgressBar("paper", len(items)) as advance:
        for item in items:
            outcomes.append(item.run(measured))
            advance(1)
    reader = "none installed" if measured.reader is None else measured.reader.name
    facts = {
        "command": " ".join(["blurnoise", *sys.argv[1:]]),
        "noise fields": str(measured.repeats),
        "seed": str(seed),
        "detector": measured.detector.name,
        "reader of text": reader,
    }
    written = page.write(outcomes, facts, output)
    rows = page.rows_of(outcomes)
    if as_json:
        say_json({"output": str(output), "summary": page.summary(outcomes), "rows": rows})
    else:
        for row in rows:
            chain = f" ({row['chain']})" if row["chain"] else ""
            say(f"{row['verdict']:10}  {row['place']}, {row['what']}{chain}: {row['found']}")
        say("", page.summary(outcomes), f"open {written}")
    if page.differs(outcomes):
        raise typer.Exit(1)


if __name__ == "__main__":
    sys.exit(run_alone(paper, "python -m blurnoise_eval.paper", sys.argv[1:]))
