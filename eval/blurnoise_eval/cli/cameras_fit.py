"""``blurnoise cameras fit``: your own camera, from its frames or from a DNG file's noise profile."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from blurnoise_eval.cli._options import FramesCfa, FramesLayout, new_file
from blurnoise_eval.system.terminal import say, say_wrapped, show


def cameras_fit(
    folder: Annotated[
        Path | None, Argument(metavar="FOLDER", help="dark and flat frames, two or more of each exposure")
    ] = None,
    *,
    output: Annotated[
        Path, Option("-o", "--output", parser=new_file, metavar="OUT.yaml", help="the camera; or OUT.json")
    ],
    dng: Annotated[
        Path | None, Option(metavar="PHOTO.dng", help="a photograph's noise profile, instead of frames")
    ] = None,
    libcamera: Annotated[
        Path | None,
        Option(metavar="MODULE.json", help="a tuning file of libcamera for Raspberry Pi, instead"),
    ] = None,
    tone: Annotated[
        Path | None,
        Option(
            metavar="FOLDER|SCALE.csv",
            help="the tone curve, too: of pictures of one scene at several exposures, or a grey scale "
            "(number, light)",
        ),
    ] = None,
    grey_card: Annotated[
        str | None,
        Option(metavar="LUX,REFLECTANCE", help="flat frames are of a grey card in that light, for lux"),
    ] = None,
    bit_depth: Annotated[
        int | None, Option(metavar="N", help="of the converter (default: the fewest that fit)")
    ] = None,
    raw_layout: FramesLayout = None,
    cfa: FramesCfa = None,
    base: Annotated[
        str,
        Option(
            metavar="PRESET|FILE",
            help="for figures that none of these has: lens, pixel pitch, quantum efficiency (default: imx250, or the "
            "preset that has a tuning file's name)",
        ),
    ] = "",
    temperature_c: Annotated[
        float | None, Option(metavar="C", help="of the sensor (default: the frames')")
    ] = None,
) -> None:
    """Measure your own camera: gain, read noise, dark current, black level, saturation, PRNU, DSNU and linearity,
    each with a 95 % interval, as a file for --camera, with plots beside it.

      blurnoise cameras fit frames/ -o mine.yaml --bit-depth 12      writes mine.yaml and mine.png
      blurnoise cameras fit --dng photo.dng -o phone.yaml            by the file's noise profile
      blurnoise cameras fit --libcamera imx219.json -o pi.yaml       by a module's tuning file
      blurnoise cameras fit frames/ --grey-card 500,0.18 -o mine.yaml     with lux of your own camera
      blurnoise cameras fit --tone bracket/ --base mine.yaml -o mine.yaml with its tone curve

    Frames are the sensor's own numbers. Dark: lens covered. Flat: an even, steady light, no part clipped. Eight
    exposures of two frames each are good; a few that saturate show the full well.

    Files: PNG, TIFF and PGM of one plane, FITS, NPY (pages of a TIFF, and N of (N, H, W), are frames), DNG and other
    raw files (pip install 'blurnoise[raw]'), and .raw or .bin without a header: --raw-layout u8, u16, mipi10, mipi12
    (MIPI CSI-2), mono10p or mono12p (GenICam), with the size.

    How they were taken, by the first that is there:

      frames.csv    columns file, kind (dark, flat), exposure_s, or more (below)
      a .txt file   descriptor of an EMVA 1288 data set
      names         dark_10ms_0.png, flat/2.5ms_1.tif; raw and FITS files state
                    their exposure and ISO; all but those in dark/ are flat

    Further columns: photons_per_px (for the quantum efficiency), illuminance_lux, wavelength_nm, gain_db,
    temperature_c, cfa, page. Of a colour sensor the green pixels are measured.

    A bracket (--tone) is of pictures as the camera delivers them, JPEG too, from a tripod, with exposures in EXIF or
    frames.csv (file, exposure_s).
    """
    from blurnoise._core import checks
    from blurnoise.optics.camera import PRESETS
    from blurnoise_eval.calibration import to_camera
    from blurnoise_eval.cameras import figures

    checks.one_of(f"suffix of {output}", output.suffix.lower(), (".yaml", ".yml", ".json"))  # before any work
    given = {"folder": folder, "dng": dng, "libcamera": libcamera}
    given = {name: path for name, path in given.items() if path is not None}
    if len(given) > 1 or not (given or tone):
        must = "must be one of them, as in 'blurnoise cameras fit FOLDER -o mine.yaml', or tone alone"
        raise ValueError(f"folder, dng, libcamera: {must}")
    of_frames = {"temperature_c": temperature_c, "raw_layout": raw_layout, "cfa": cfa, "grey_card": grey_card}
    of_frames |= {"bit_depth": bit_depth} if libcamera is None else {}
    if folder is None and (lone := [name for name, value in of_frames.items() if value is not None]):
        raise ValueError(f"{', '.join(lone)}: goes with a folder of frames")
    named = (
        libcamera.stem
        if libcamera and libcamera.stem in PRESETS
        else "imx250"
        if folder or dng
        else "imx250c"
    )
    base = base or named
    camera = to_camera.on_base(output.stem, {}, base)  # before any work
    curve = None
    if tone is not None:
        from blurnoise_eval.calibration import tone as of_tone

        curve = of_tone.of(tone)
    if dng is not None:
        camera = to_camera.camera_of_dng(dng, base=base)
    elif libcamera is not None:
        from blurnoise_eval.calibration.libcamera import camera_of_libcamera

        camera = camera_of_libcamera(libcamera, base=base, bit_depth=bit_depth)
    table, notes = None, list[str]()
    if folder is not None:
        from rich.table import Table

        from blurnoise_eval.calibration import figure, light
        from blurnoise_eval.calibration.fit import measure
        from blurnoise_eval.calibration.formats import RawLayout
        from blurnoise_eval.system.files import write_figure

        layout = RawLayout.parse(raw_layout) if raw_layout else None
        found = measure(folder, bit_depth=bit_depth, layout=layout, cfa=cfa)
        stated_c = [level.temperature_c for level in found.dark if level.temperature_c is not None]
        if temperature_c is None and stated_c:
            temperature_c = sum(stated_c) / len(stated_c)
        camera = to_camera.camera_of(found, output.stem, base=base, temperature_c=temperature_c)
        lux = light.of_grey_card(found, camera, grey_card)
        camera = to_camera.changed(camera, lux)
        plot = output.with_suffix(".png")
        write_figure(plot, figure.draw_fit(found, camera.name), dpi=150)
        table = Table("figure", "value", "95 %", "unit", title=f"photon transfer of {found.frames}")
        for name, each, unit in found.rows():
            interval = " to ".join(to_camera.ends(each)) if each else ""
            table.add_row(name, f"{each.value:.4g}" if each else "not available", interval, unit)
        if found.cfa and set(found.cfa) != set(camera.cfa):
            notes.append(f"the camera's mosaic is {camera.cfa}, as of its base: --base imx250c has RGGB")
        notes += [*(f"warning: {doubt.text}" for doubt in found.doubts), *found.notes]
        notes += [f"{name}: {source}" for name, (_, source) in lux.items()]
    if curve is not None:
        camera = to_camera.changed(camera, curve.known)
        notes += [f"tone: {curve.text}", *(f"warning: {doubt}" for doubt in curve.doubts)]
    camera.save(output)
    show(table or figures(camera))
    for note in notes:
        say_wrapped(note, hanging=2)
    say(output, *([] if folder is None else [plot]))
