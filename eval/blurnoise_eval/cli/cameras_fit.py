"""``blurnoise cameras fit``: a camera file from frames, from the noise profile of a DNG, or from a tuning file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from blurnoise_eval.cli import inputs
from blurnoise_eval.cli._options import FramesCfa, FramesLayout, FramesLeftOut, new_file
from blurnoise_eval.system.terminal import say, say_wrapped, show

if TYPE_CHECKING:
    from rich.table import Table

    from blurnoise.camera import Camera
    from blurnoise_eval.calibration.fit import Measurement


def cameras_fit(
    folder: Annotated[
        Path | None,
        Argument(metavar="FOLDER", help="folder of dark and flat frames, two or more per exposure"),
    ] = None,
    *,
    output: Annotated[
        Path,
        Option(
            "-o", "--output", parser=new_file, metavar="OUT.yaml", help="camera file to write (YAML or JSON)"
        ),
    ],
    dng: Annotated[
        Path | None,
        Option(metavar="PHOTO.dng", help="use the noise profile of a DNG photograph instead of frames"),
    ] = None,
    libcamera: Annotated[
        Path | None,
        Option(
            metavar="MODULE.json", help="use a tuning file of libcamera for Raspberry Pi instead of frames"
        ),
    ] = None,
    tone: Annotated[
        Path | None,
        Option(
            metavar="FOLDER|SCALE.csv",
            help="also measure the tone curve, from pictures of one scene at several exposures, or from a table of "
            "a grey scale (number, light)",
        ),
    ] = None,
    developed: Annotated[
        Path | None,
        Option(
            metavar="FOLDER",
            help="also fit noise reduction and sharpening, from flat frames as the camera delivers them, two or more "
            "at each gain",
        ),
    ] = None,
    grey_card: Annotated[
        str | None,
        Option(
            metavar="LUX,REFLECTANCE",
            help="illuminance and reflectance of the grey card in the flat frames; calibrates lux",
        ),
    ] = None,
    bit_depth: Annotated[
        int | None, Option(metavar="N", help="bit depth of the converter (default: the smallest that fits)")
    ] = None,
    raw_layout: FramesLayout = None,
    cfa: FramesCfa = None,
    leave_out: FramesLeftOut = None,
    base: Annotated[
        str,
        Option(
            metavar="PRESET|FILE",
            help="camera for the values that cannot be measured: lens, pixel pitch, quantum efficiency (default: "
            "imx250, or the preset with the name of the tuning file)",
        ),
    ] = "",
    temperature_c: Annotated[
        float | None, Option(metavar="C", help="temperature of the sensor, °C (default: from the frames)")
    ] = None,
    strict: Annotated[
        bool, Option("--strict", help="write nothing if simulated frames of the camera miss the frames")
    ] = False,
) -> None:
    """Measure your own camera and write a camera file for --camera.

      blurnoise cameras fit frames/ -o mine.yaml --bit-depth 12
      blurnoise cameras fit frames/ --grey-card 500,0.18 -o mine.yaml
      blurnoise cameras fit --dng photo.dng -o phone.yaml
      blurnoise cameras fit --libcamera imx219.json -o pi.yaml
      blurnoise cameras fit --tone bracket/ --base mine.yaml -o toned.yaml
      blurnoise cameras fit --developed flats/ --base mine.yaml -o denoised.yaml

    Measured are gain, read noise, dark current, black level, saturation, PRNU, DSNU and linearity, each with a 95 %
    interval. Plots are written beside the camera file, as mine.png. The camera is tried on its own frames: what
    simulated frames of all levels miss is printed.

    Frames hold the raw numbers of the sensor. Dark frames: lens covered. Flat frames: uniform, constant light, not
    clipped. Take about eight exposures with two frames each. A few saturated frames give the full well.

    File types: PNG, TIFF and PGM with one channel, FITS, NPY, DNG and other raw files (pip install 'blurnoise[raw]'),
    and .raw or .bin without a header. Each page of a TIFF and each picture of an (N, H, W) array is a frame. For
    files without a header, --raw-layout names the packing and the size. The packing is u8, u16, mipi10, mipi12 (MIPI
    CSI-2), mono10p or mono12p (GenICam).

    The kind and the exposure of the frames come from the first of these sources that exists:

      frames.csv    table with the columns file, kind (dark or flat), exposure_s
      a .txt file   descriptor of an EMVA 1288 data set
      file names    such as dark_10ms_0.png, flat/2.5ms_1.tif, flat_0,1s.png;
                    dark flats are dark, light frames and averages are left
                    out; raw and FITS files also contain kind, exposure, ISO

    Optional columns of frames.csv: photons_per_px (for the quantum efficiency), illuminance_lux, wavelength_nm,
    gain_db, temperature_c, cfa, page. Of a colour sensor, the green pixels are measured.

    For --tone, take pictures of one scene from a tripod, at several exposures, as the camera delivers them (JPEG,
    too). The exposures come from EXIF or from frames.csv (file, exposure_s).

    For --developed, take pictures of an even grey surface as the camera delivers them, some seconds apart. All of one
    gain have the same light and exposure. The gains come from ISO in EXIF or from frames.csv (file, gain_db).
    For the sharpening, add edge.png: a part of such a picture that one slanted edge crosses.
    """
    from blurnoise._core import checks
    from blurnoise.camera import PRESETS
    from blurnoise_eval.calibration import to_camera
    from blurnoise_eval.cameras import figures

    checks.one_of(f"suffix of {output}", output.suffix.lower(), (".yaml", ".yml", ".json"))
    plot = None if folder is None else new_file(str(output.with_suffix(".png")))
    sources = [path for path in (folder, dng, libcamera) if path is not None]
    if len(sources) > 1 or not (sources or tone or developed):
        must = "exactly one is needed, as in 'blurnoise cameras fit FOLDER -o mine.yaml', or --tone or --developed"
        raise ValueError(f"folder, dng, libcamera: {must}")
    of_frames: dict[str, Any] = {
        "temperature_c": temperature_c,
        "raw_layout": raw_layout,
        "cfa": cfa,
        "grey_card": grey_card,
    }
    of_frames["leave_out"] = leave_out
    of_frames |= {"bit_depth": bit_depth} if libcamera is None else {}
    if folder is None:
        inputs.refuse_unused(of_frames | {"strict": strict or None}, "a folder of frames")
    # Tuning files and tone curves are those of colour cameras as a rule.
    base = base or ("imx250" if folder or dng else "imx250c")
    if libcamera and libcamera.stem in PRESETS:
        base = libcamera.stem
    camera = to_camera.on_base(output.stem, {}, base)  # refuses a wrong base before the frames are read
    curve, notes = None, list[str]()
    tables: list[Table] = []
    if tone is not None:
        from blurnoise_eval.calibration.tone import measure_tone

        curve = measure_tone(tone)
    if dng is not None:
        from blurnoise_eval.calibration.dng import camera_of_dng

        camera = camera_of_dng(dng, base=base)
    elif libcamera is not None:
        from blurnoise_eval.calibration.libcamera import camera_of_libcamera

        camera = camera_of_libcamera(libcamera, base=base, bit_depth=bit_depth)
        for name in ("noise_reduction", "sharpening", "local_tone"):
            if libcamera.name in camera.sources.get(name, ""):
                notes.append(f"{name}: {camera.sources[name]}")
    elif folder is not None:
        from blurnoise_eval.calibration import figure, light
        from blurnoise_eval.calibration.fit import measure
        from blurnoise_eval.calibration.formats import RawLayout
        from blurnoise_eval.measure.trial import misses
        from blurnoise_eval.system.files import write_figure

        layout = RawLayout.parse(raw_layout) if raw_layout else None
        measurement = measure(folder, bit_depth=bit_depth, layout=layout, cfa=cfa, leave_out=leave_out or ())
        camera = to_camera.camera_of(measurement, output.stem, base=base, temperature_c=temperature_c)
        lux = light.of_grey_card(measurement, camera, grey_card)
        camera = to_camera.changed(camera, lux)
        missed = misses(measurement, camera)
        if strict and missed:
            raise ValueError(f"--strict: {'; '.join(missed)}; nothing was written")
        if plot:
            write_figure(plot, figure.draw_fit(measurement, camera.name), dpi=150)
        tables = [_table(measurement), _standard(measurement, camera)]
        if measurement.cfa and set(measurement.cfa) != set(camera.sensor.cfa):
            filters = f"the camera file has the colour filters {camera.sensor.cfa} of its base"
            notes.append(f"{filters}; use --base imx250c for RGGB")
        notes += [*(f"warning: {doubt.text}" for doubt in measurement.doubts), *measurement.notes]
        notes += missed
        notes += [f"{name}: {source}" for name, (_, source) in lux.items()]
    if curve is not None:
        camera = to_camera.changed(camera, curve.known)
        notes += [f"tone: {curve.text}", *(f"tone: left out: {each}" for each in curve.left_out)]
        notes += [f"warning: {doubt}" for doubt in curve.doubts]
    if developed is not None:
        from blurnoise_eval.calibration.developed import measure_developed

        steps = measure_developed(developed, camera)
        camera = to_camera.changed(camera, steps.known)
        notes += [f"developed, {at.text}" for at in steps.gains]
        notes += [f"warning: {doubt}" for doubt in steps.doubts]
    camera.save(output)
    show(*(tables or [figures(camera)]))
    for note in notes:
        say_wrapped(note, hanging=2)
    say(*filter(None, (output, plot)))


def _standard(measurement: Measurement, camera: Camera) -> Table:
    """The figures as the standard defines them, beside the camera's."""
    from rich.table import Table

    from blurnoise_eval.calibration import standard

    heads = [standard.HEADS[column] for column in (0, 1, 2, 6)]
    table = Table(*heads, title="The same frames by EMVA 1288 release 4")
    for row in standard.rows(measurement.standard, camera):
        cells = dict(zip(standard.HEADS, row.cells(), strict=True))
        table.add_row(*(cells[head] for head in heads))
    return table


def _table(measurement: Measurement) -> Table:
    """The measured figures with their intervals."""
    from rich.table import Table

    from blurnoise_eval.calibration.uncertain import interval_texts

    title = f"Photon transfer of {measurement.frames}"
    table = Table("quantity", "value", "95 % interval", "unit", title=title)
    for name, estimate, unit in measurement.rows():
        interval = " to ".join(interval_texts(estimate)) if estimate else ""
        value = f"{estimate.value:.4g}" if estimate else "not available"
        table.add_row(name, value, interval, unit)
    return table
