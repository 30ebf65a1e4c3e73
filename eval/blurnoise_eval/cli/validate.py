"""``blurnoise validate``: compare simulated frames or pictures with those of a camera."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from blurnoise_eval.cli import inputs
from blurnoise_eval.cli._options import (
    BlackLevel,
    CodingOfPicture,
    FramesCfa,
    FramesLayout,
    FramesLeftOut,
    FullScale,
    Json,
    new_folder,
)
from blurnoise_eval.system.terminal import say, say_json, say_wrapped, table_lines

if TYPE_CHECKING:
    from collections.abc import Sequence

    from blurnoise_eval.measure.comparison import MeasureComparison


def validate(
    real: Annotated[
        Path | None, Argument(metavar="REAL", help="folder of dark and flat frames, or a picture of a chart")
    ] = None,
    simulated: Annotated[
        Path | None,
        Argument(metavar="SIMULATED", help="picture of the same chart, made with 'blurnoise simulate'"),
    ] = None,
    *,
    bracket: Annotated[
        list[Path] | None,
        Option(metavar="FOLDER", help="pictures of one scene at several exposures; may be repeated"),
    ] = None,
    model: Annotated[
        list[Path] | None, Option(metavar="FILE", help="detector to follow over a bracket; may be repeated")
    ] = None,
    output: Annotated[
        Path | None,
        Option("-o", "--output", parser=new_folder, metavar="DIR", help="folder for the results"),
    ] = None,
    camera: Annotated[
        str | None,
        Option(
            metavar="NAME|FILE",
            help="camera to simulate (default: fitted to every other level; of a bracket the default camera with a "
            "fitted tone curve)",
        ),
    ] = None,
    raw_layout: FramesLayout = None,
    cfa: FramesCfa = None,
    leave_out: FramesLeftOut = None,
    seed: Annotated[int | None, Option(metavar="N", help="seed of the simulated noise (default: 0)")] = None,
    coding: CodingOfPicture = "auto",
    black_level: BlackLevel = None,
    full_scale: FullScale = None,
    as_json: Json = False,
) -> None:
    """Compare simulated with real pictures: a bracket, dark and flat frames level by level, or a chart.

      blurnoise validate --bracket bracket/ --model m.onnx -o check
      blurnoise validate frames/ -o check
      blurnoise validate frames/ --camera mine.yaml -o check
      blurnoise validate real.png simulated.png --black-level 64 --full-scale 4095

    Brackets: pictures of one still scene from a tripod, a stop or two apart, as the camera delivers them (JPEG, PNG,
    TIFF). Exposure times, ISO and f-number come from EXIF or from frames.csv (file, exposure_s, iso, f_number;
    speed_px_s and direction_deg for pictures of a scene that moves as a whole at this speed). Tone curve and scene
    come from every other picture, and the rest is simulated from them; then the halves change places. Compared are
    brightness, clipping, contrast, chroma and noise, and the confidence of each model's objects over exposure. The
    defaults of a sweep, from one photograph, stand beside it. The command writes DIR/validation.html and .json,
    pictures.csv, confidences.csv, halves.csv, and for sweeps the scene as DIR/scenes/NAME.tiff (linear light) and its
    camera as DIR/NAME.yaml.

    Frames: REAL is a folder as for 'blurnoise cameras fit'. First, the camera's figures are compared with those of
    the frames as EMVA 1288 release 4 defines them: pass or fail. Then frames are simulated and compared: mean,
    variance, rows, columns, correlation, kurtosis and spectrum of the noise and of the fixed pattern. A classifier
    also tries to tell real frames from simulated ones. Without --camera, a camera is fitted to half of the levels and
    compared with the other half. The command writes DIR/validation.html, .csv and .json, and the fitted camera as
    DIR/camera.yaml.

    Pictures: compared are the mean, the noise of areas that are uniform in both pictures, and MTF50 of slanted edges.
    Align the pictures to a few pixels. Both should be linear: simulate with --bit-depth native, and use a raw picture
    of the camera. The command writes DIR/validation.csv and .json.
    """
    if bracket:
        if real is not None:
            raise ValueError(f"real = {str(real)!r}: must not be given with --bracket")
        of_others = {
            "raw_layout": raw_layout,
            "cfa": cfa,
            "leave_out": leave_out,
            "coding": None if coding == "auto" else coding,
        }
        inputs.refuse_unused(
            of_others | {"black_level": black_level, "full_scale": full_scale}, "frames or a chart"
        )
        _validate_brackets(bracket, model or [], output, as_json, camera=camera, seed=seed or 0)
        return
    inputs.refuse_unused({"model": model or None}, "--bracket")
    if real is None:
        raise ValueError(
            "real: is missing; must be a folder of frames or a picture of a chart, or use --bracket"
        )
    of_frames = {"camera": camera, "raw_layout": raw_layout, "cfa": cfa, "leave_out": leave_out, "seed": seed}
    levels = {"black_level": black_level, "full_scale": full_scale}
    # Two commands share a name: options of the other one are refused rather than ignored.
    of_pictures = {"coding": None if coding == "auto" else coding, **levels}
    if simulated is None:
        if real.is_file():
            raise ValueError(f"simulated: is missing; must be a picture of the same chart as {real}")
        inputs.refuse_unused(of_pictures, "two pictures")
        how: dict[str, Any] = {"raw_layout": raw_layout, "cfa": cfa, "leave_out": leave_out or ()}
        _validate_frames(real, output, as_json, camera, seed=seed or 0, **how)
        return
    inputs.refuse_unused(of_frames, "a folder of frames")
    for name, picture in (("real", real), ("simulated", simulated)):
        if picture.is_dir():
            raise ValueError(f"{name} = {str(picture)!r}: is a folder; must be a picture of a chart")
    from blurnoise_eval.datasets import decode
    from blurnoise_eval.measure import pictures
    from blurnoise_eval.measure.comparison import summary

    pair = pictures.linear_pair(decode(real), decode(simulated), coding, **levels)
    comparisons, notes = pictures.compare(*pair)
    facts = {"real": str(real), "simulated": str(simulated), "notes": notes}
    document = _write(comparisons, facts, output)
    if as_json:
        say_json(document)
        return
    _say_table("measure", summary(comparisons))
    say(*notes, error=True)


def _validate_frames(
    folder: Path, output: Path | None, as_json: bool, name: str | None, *, raw_layout: str | None, **how: Any
) -> None:
    from blurnoise_eval import cameras
    from blurnoise_eval.calibration.formats import RawLayout
    from blurnoise_eval.calibration.standard import HEADS
    from blurnoise_eval.measure import frames, page
    from blurnoise_eval.measure.comparison import summary
    from blurnoise_eval.system.files import check_outputs

    if output:
        check_outputs(output, "validation.html", "validation.csv", "validation.json", "camera.yaml")
    layout = RawLayout.parse(raw_layout) if raw_layout else None
    validation = frames.validate(folder, cameras.find(name) if name else None, layout=layout, **how)
    classifier = {
        kind: {
            title: [auc.value, auc.low, auc.high]
            for title, auc in zip(("real from simulated", "real from real"), scores, strict=True)
            if auc.available
        }
        for kind, scores in validation.auc.items()
    }
    facts = {
        "standard": [row.record() for row in validation.standard],
        "answer": validation.answer,
        "camera": validation.camera.name,
        "classifier": classifier,
    }
    document = _write(validation.comparisons, facts | {"notes": [*validation.notes]}, output)
    notes = [*validation.notes]
    if output:
        notes.append(f"page: {page.write(validation, output)}")
        if validation.fitted:
            validation.camera.save(output / "camera.yaml")
    if as_json:
        say_json(document)
        return
    say_wrapped(validation.of_standard)
    say("")
    shown = [row.cells()[:-1] for row in validation.standard]  # the page says why they differ
    heads = HEADS[:-1]
    say(*table_lines(heads, shown, [0 < column < 5 for column in range(len(heads))]), "")
    say_wrapped(validation.answer)
    for kind in validation.auc:
        say("")
        _say_table(f"{kind} frames", summary(validation.of(kind)))
    say("", *notes)


def _validate_brackets(
    folders: Sequence[Path],
    models: Sequence[Path],
    output: Path | None,
    as_json: bool,
    *,
    camera: str | None,
    seed: int,
) -> None:
    from blurnoise_eval import cameras
    from blurnoise_eval.detectors.detector import Detector
    from blurnoise_eval.detectors.opening import open_models
    from blurnoise_eval.measure import bracket_page, bracket_tables
    from blurnoise_eval.measure.bracket_trial import try_bracket
    from blurnoise_eval.system.files import check_outputs

    if output:
        check_outputs(output, *bracket_page.FILES)
    found = cameras.find(camera) if camera else None
    names = [folder.resolve().name for folder in folders]
    if repeated := [name for name in names if names.count(name) > 1]:
        raise ValueError(f"bracket: two folders are named {repeated[0]!r}; names must differ")
    opened = open_models(models)
    if others := [one.name for one in opened if not isinstance(one, Detector)]:
        raise ValueError(f"model = {others[0]!r}: reads text; must be a detector")
    detectors = [one for one in opened if isinstance(one, Detector)]
    trials = [try_bracket(folder, detectors, found, seed) for folder in folders]
    notes = [f"{trial.name}: {note}" for trial in trials for note in trial.notes]
    document = bracket_tables.document(trials) | {"notes": notes}
    if output:
        bracket_page.write(trials, notes, output)
        document = {"output": str(output), **document}
    if as_json:
        say_json(document)
        return
    for answer in document["answers"]:
        say_wrapped(answer, hanging=2)
    for name, rows in bracket_tables.table(trials):
        say("", name)
        if rows:
            say(
                *table_lines(
                    bracket_tables.HEADS, rows, [False, False, *[True] * (len(bracket_tables.HEADS) - 2)]
                )
            )
    for trial in trials:
        heads = (f"pictures of {trial.name}, largest difference", *bracket_tables.WORDS.values())
        say("", *table_lines(heads, bracket_tables.picture_table(trial), [False, True, True]))
    for note in notes:
        say_wrapped(note, hanging=2)
    if output:
        say(f"page: {output / 'validation.html'}")


def _write(
    comparisons: Sequence[MeasureComparison], facts: dict[str, Any], output: Path | None
) -> dict[str, Any]:
    """Write validation.csv and validation.json, if there is a folder; return what the latter holds."""
    from blurnoise_eval.system.files import check_outputs, write_records

    rows = [comparison.row() for comparison in comparisons]
    document = {**facts, "rows": rows}
    if output:
        check_outputs(output, "validation.csv", "validation.json")
        output.mkdir(parents=True, exist_ok=True)
        write_records("validation", rows, document, output)
        document = {"output": str(output), **document}
    return document


def _say_table(title: str, rows: Sequence[tuple[Sequence[str], str]]) -> None:
    from blurnoise_eval.measure.comparison import HEADS

    heads = (title, *HEADS[1:])
    say(*table_lines(heads, [cells for cells, _ in rows], [column > 1 for column in range(len(heads))]))
