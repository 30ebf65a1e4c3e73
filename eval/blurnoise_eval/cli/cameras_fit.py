"""``blurnoise cameras fit``: your own camera, from its frames or from what a DNG file states."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from blurnoise_eval.cli._options import Json, camera_names, new_file, one_of
from blurnoise_eval.system.terminal import say, say_json, show

if TYPE_CHECKING:
    from blurnoise_eval.calibration.fit import Measurement

_UNITS = {
    "system_gain_dn_per_e": "DN/e-", "read_noise_e": "e-", "dark_current_e_s": "e-/s", "black_level_dn": "DN",
    "prnu": "", "dsnu_e": "e-", "full_well_e": "e-", "quantum_efficiency": "", "linearity_error": "",
}  # fmt: skip


def cameras_fit(
    folder: Annotated[
        Path | None, Argument(metavar="FOLDER", help="of dark and flat frames, two or more of each exposure")
    ] = None,
    *,
    output: Annotated[
        Path, Option("-o", "--output", parser=new_file, metavar="OUT.yaml", help="the camera; or OUT.json")
    ],
    dng: Annotated[
        Path | None, Option(metavar="PHOTO.dng", help="take what this file states, instead of frames")
    ] = None,
    bit_depth: Annotated[
        int | None, Option(metavar="N", help="of the converter (default: the fewest that fit)")
    ] = None,
    base: Annotated[
        str,
        Option(
            metavar="PRESET",
            help="for what frames do not tell: lens, pixel pitch, quantum efficiency",
            autocompletion=one_of(camera_names),
        ),
    ] = "imx250",
    temperature_c: Annotated[
        float | None, Option(metavar="C", help="of the sensor meanwhile, for its dark current")
    ] = None,
    raw_size: Annotated[
        str | None, Option(metavar="WxH", help="of headerless 16-bit planes (.raw, .bin), px")
    ] = None,
    as_json: Json = False,
) -> None:
    """Measure your own camera: gain, read noise, dark current, black level, saturation, PRNU, DSNU and linearity,
    each with a 95 % interval, as a file for --camera, with plots beside it.

      blurnoise cameras fit frames/ -o mine.yaml --bit-depth 12      writes mine.yaml and mine.png
      blurnoise cameras fit --dng photo.dng -o phone.yaml            what the file's noise profile says

    Frames are the sensor's own numbers: PNG, TIFF, PGM or NPY of one plane, .raw planes, or DNG and other raw files
    (pip install 'blurnoise[raw]'). Dark: lens covered. Flat: an even, steady light, no part clipped. Eight exposures
    of two frames each are good; a few that saturate tell the full well. FOLDER/frames.csv lists them (columns
    file, kind = dark or flat, exposure_s, and photons_per_px where known, which tells the quantum efficiency), or
    their names do: dark_10ms_0.png, flat_2.5ms_1.png, flat_500us_a.npy.
    """
    from blurnoise._core import checks

    checks.one_of(f"suffix of {output}", output.suffix.lower(), (".yaml", ".yml", ".json"))  # before any work
    checks.one_of("base", base, camera_names())
    if (folder is None) == (dng is None):
        raise ValueError(
            "folder, dng: must be one of them, as in 'blurnoise cameras fit FOLDER -o mine.yaml'"
        )
    if dng is not None:
        frames_only = {"bit_depth": bit_depth, "temperature_c": temperature_c, "raw_size": raw_size}
        for name, given in frames_only.items():
            if given is not None:
                raise ValueError(f"{name} = {given}: goes with a folder of frames, not with dng")
        from blurnoise_eval.calibration.to_camera import camera_of_dng
        from blurnoise_eval.cameras import facts, figures

        camera = camera_of_dng(dng, base=base)
        camera.save(output)
        if as_json:
            say_json(facts(camera))
            return
        show(figures(camera))
        say(output)
        return
    from blurnoise_eval.calibration import figure
    from blurnoise_eval.calibration.fit import measure
    from blurnoise_eval.calibration.to_camera import camera_of
    from blurnoise_eval.system.files import write_figure

    found = measure(Path(str(folder)), bit_depth=bit_depth, raw_size_px=_size(raw_size))
    camera = camera_of(found, output.stem, base=base, temperature_c=temperature_c)
    camera.save(output)
    plot = output.with_suffix(".png")
    write_figure(plot, figure.draw_fit(found, camera.name), dpi=150)
    warnings = [doubt.text for doubt in found.doubts]
    if as_json:
        measured = {
            name: {"value": each.value, "low": each.low, "high": each.high}
            for name, each in found.estimates.items()
        }
        say_json(
            {"camera": camera.to_dict(), "figures": measured, "warnings": warnings, "notes": found.notes}
        )
        return
    _print(found)
    say(*(f"warning: {warning}" for warning in warnings), *found.notes, output, plot)


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    sides = re.fullmatch(r"([1-9][0-9]{0,5})x([1-9][0-9]{0,5})", text, re.IGNORECASE)
    if not sides:
        raise ValueError(f"raw_size = {text!r}: must be WIDTHxHEIGHT, px, as in 640x480")
    return int(sides[1]), int(sides[2])


def _print(found: Measurement) -> None:
    from rich.table import Table

    from blurnoise_eval.calibration.to_camera import ends

    table = Table("figure", "value", "95 %", "unit", title=f"photon transfer of {found.frames}")
    for name, unit in _UNITS.items():
        if each := found.estimates.get(name):
            table.add_row(name, f"{each.value:.4g}", " to ".join(ends(each)), unit)
        else:
            table.add_row(name, "not available", "", unit)
    show(table)
