"""``python -m blurnoise_eval.paper``: reproduce the paper by Lin et al. (2024)."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from blurnoise_eval.cli import inputs, run_alone
from blurnoise_eval.cli._options import Contract, Threads, new_folder
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say


def paper(
    *,
    only: Annotated[
        list[str] | None, Option(metavar="ITEM", help="compute only this item of the page; repeatable")
    ] = None,
    quick: Annotated[
        bool, Option("--quick", help="simulate one noise field per condition instead of three")
    ] = False,
    model: Annotated[
        Path | None,
        Option(metavar="M.onnx", help="detector of signs (default: the built-in stop-sign detector)"),
    ] = None,
    contract: Contract = None,
    threads: Threads = None,
    output: Annotated[
        Path, Option("-o", "--output", parser=new_folder, metavar="DIR", help="folder for page and table")
    ],
) -> None:
    """Reproduce the tables and figures of Lin et al., Sensors 2024, 24(16), 5135, and compare them with the paper.

      python -m blurnoise_eval.paper -o paper            all items: minutes
      python -m blurnoise_eval.paper -o paper --quick    one noise field
      python -m blurnoise_eval.paper -o paper --only table-2 --only sic
      python -m blurnoise_eval.paper -o paper --model yolov5m.onnx

    Networks receive the pictures in two ways: as in the paper (grey from coded values, used as light, linear 8 bits),
    and as from a camera. The command writes DIR/paper.csv (item, expected, found, rule, verdict) and DIR/paper.html.
    The exit code is 1 if an item that should agree does not. Text is read with PP-OCR of the package rapidocr;
    without it, these items are "not run".
    """
    workers = inputs.threads(threads)
    from blurnoise_eval.detectors.ocr import Recogniser, rapidocr_models
    from blurnoise_eval.paper import items, page
    from blurnoise_eval.paper.measurement import Measurements
    from blurnoise_eval.system.files import check_outputs

    check_outputs(output, "paper.csv", "paper.html")
    wanted, networks = items.chosen(only or ()), rapidocr_models()
    reader = None if networks is None else Recogniser(networks[1])
    repeats = 1 if quick else 3
    measured = Measurements(inputs.detector(model, contract), reader, repeats=repeats, threads=workers)
    with ProgressBar("paper", len(wanted)) as advance:
        outcomes = []
        for item in wanted:
            outcomes.append(item.run(measured))
            advance(1)
    how = (
        f"{repeats} noise fields, {measured.detector.name}, {'no reader' if reader is None else reader.name}"
    )
    page.write(outcomes, how, output)
    rows = page.rows_of(outcomes)
    for row in rows:
        chain = f" ({row['chain']})" if row["chain"] else ""
        say(f"{row['verdict']:10}  {row['place']}, {row['what']}{chain}: {row['found']}")
    say("", page.summary(outcomes), f"page: {output / 'paper.html'}")
    if any(row["verdict"] == "differs" for row in rows):
        raise typer.Exit(1)


if __name__ == "__main__":
    sys.exit(run_alone(paper, "python -m blurnoise_eval.paper", sys.argv[1:]))
