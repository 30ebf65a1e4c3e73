"""``blurnoise cameras fit``: your own camera, from its frames or from what a DNG file states."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from blurnoise_eval.cli._options import Json, camera_names, new_file, one_of
from blurnoise_eval.system.terminal import say, say_json, show

if TYPE_CHECKING:
    from blurnoise.optics.camera import Camera
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
        for name, given in (
            ("bit_depth", bit_depth),
            ("temperature_c", temperature_c),
            ("raw_size", raw_size),
        ):
            if given is not None:
                raise ValueError(f"{name} = {given}: goes with a folder of frames, not with dng")
        _from_dng(dng, output, base, as_json)
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
    if as_json:
        say_json(_facts(found, camera))
        return
    _print(found)
    for doubt in found.doubts:
        say(f"warning: {doubt.text}")
    for note in found.notes:
        say(note)
    say(output, plot)


def _from_dng(photo: Path, output: Path, base: str, as_json: bool) -> None:
    from blurnoise_eval.calibration.to_camera import camera_of_dng
    from blurnoise_eval.cameras import facts, figures

    camera = camera_of_dng(photo, base=base)
    camera.save(output)
    if as_json:
        say_json(facts(camera))
        return
    show(figures(camera))
    say(output)


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    sides = text.lower().split("x")
    if len(sides) != 2 or not all(
        side.isascii() and side.isdigit() and 0 < int(side[:9]) < 1 << 17 for side in sides
    ):
        raise ValueError(f"raw_size = {text!r}: must be WIDTHxHEIGHT, px, as in 640x480")
    return int(sides[0]), int(sides[1])


def _print(found: Measurement) -> None:
    from rich import box
    from rich.table import Table

    from blurnoise_eval.calibration.to_camera import ends

    table = Table("figure", "value", "95 %", "unit", box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    table.title, table.title_justify = f"photon transfer of {found.frames}", "left"
    for name, unit in _UNITS.items():
        told = found.estimates.get(name)
        table.add_row(
            name,
            "not told" if told is None else f"{told.value:.4g}",
            "" if told is None else " to ".join(ends(told)),
            unit,
        )
    show(table)


def _facts(found: Measurement, camera: Camera) -> dict[str, Any]:
    levels = [
        {
            "kind": level.kind,
            "exposure_s": level.exposure_s,
            "photons_per_px": level.photons_per_px,
            "frames": level.frames,
            "mean_dn": level.mean_dn,
            "variance_dn2": level.variance_dn2,
            "variance_error_dn2": level.variance_error_dn2,
            "fitted": level.kind == "dark" or place - len(found.dark) in found.used,
        }
        for place, level in enumerate([*found.dark, *found.flat])
    ]
    figures = {
        name: {"value": told.value, "low": told.low, "high": told.high}
        for name, told in found.estimates.items()
    }
    warnings = [doubt.text for doubt in found.doubts]
    about = {"method": "photon transfer", "warnings": warnings, "notes": found.notes}
    return {"camera": camera.to_dict(), **about, "figures": figures, "levels": levels}
