"""Cameras by name or file, and their tables: the presets, a line each, and all figures of one with sources."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from blurnoise.camera import PRESETS, Camera, camera_files
from blurnoise.camera.colour import FilterCurves
from blurnoise.camera.radiometry import filter_electrons
from blurnoise.camera.spectra import Curve

if TYPE_CHECKING:
    from rich.table import Table


_MOST_ROWS = 8  # of a table of points; longer ones are only counted


def find(name_or_file: str) -> Camera:
    """The preset of that name, or the camera of that file.

    Raises ``ValueError`` that lists the presets where it is neither, and what :meth:`Camera.load` raises.

    >>> find("imx250").name
    'imx250'
    """
    if name_or_file in PRESETS:
        return PRESETS[name_or_file]
    if Path(name_or_file).is_file():
        return Camera.load(name_or_file)
    raise ValueError(
        f"camera = {name_or_file!r}: must be a camera file or one of the presets {', '.join(sorted(PRESETS))}"
    )


def behind_one_filter(camera: Camera) -> Camera:
    """The camera with its mosaic's strongest filter under D55 before every pixel; unchanged without a mosaic.

    >>> behind_one_filter(Camera.preset("imx250c")).sensor.cfa
    'none'
    """
    curves, electrons = camera.sensor.quantum_efficiency, filter_electrons(camera)
    if isinstance(curves, FilterCurves):
        curves = curves.of(max(electrons, key=lambda letter: electrons[letter]))
    return camera.with_figures(cfa="none", quantum_efficiency=curves, white_balance="auto", ccm=None)


def derived(camera: Camera) -> dict[str, float]:
    """Derived figures of a camera: saturation in electrons and DN, threshold, SNR and dynamic range.

    >>> round(derived(Camera.preset("imx250"))["snr_max_db"], 1)  # 10 log10 of the electrons of saturation
    40.3
    """
    return {
        "saturation_e": camera.sensor.saturation_e,
        "clip_dn": float(camera.sensor.clip_dn),
        "threshold_e": camera.sensor.threshold_e,
        "snr_max_db": camera.sensor.snr_max_db,
        "dynamic_range_db": camera.sensor.dynamic_range_db,
    }


def overview(cameras: list[Camera]) -> Table:
    """One row per camera."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    table.add_column("\ncamera")
    for heading in (
        "pitch\nµm", "well\ne-", "read\ne-", "gain K\nDN/e-", "\nbits", "size\npx", "saturation\ne-",
        "SNR\nmax dB", "range\ndB",
    ):  # fmt: skip
        table.add_column(heading, justify="right")
    for camera in cameras:
        sensor = camera.sensor
        table.add_row(
            camera.name,
            f"{sensor.pixel_pitch_um:g}",
            f"{sensor.full_well_e:.0f}",
            f"{sensor.read_noise_e:.2f}",
            f"{round(sensor.system_gain_dn_per_e, 4):.4g}",
            f"{sensor.bit_depth}",
            f"{sensor.width_px}x{camera.sensor.height_px}",
            f"{sensor.saturation_e:.0f}",
            f"{sensor.snr_max_db:.1f}",
            f"{sensor.dynamic_range_db:.1f}",
        )
    return table


def figures(camera: Camera) -> Table:
    """Every figure of a camera with its source, then what follows from them."""
    from rich import box
    from rich.table import Table

    table = Table("figure", "value", "source", box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for name, value in camera_files.flat(camera).items():
        if name != "sources":
            table.add_row(name, _shown(value), camera.sources.get(name, ""))
    table.add_section()
    table.add_row("gain", camera.sensor.gain_law, "follows from the above")
    for name, value in derived(camera).items():
        table.add_row(name, _shown(value), "follows from the above")
    return table


def _shown(value: object) -> str:
    if isinstance(value, FilterCurves):
        return "\n".join(f"{name}: {_shown(curve)}" for name, curve in value.items())
    if isinstance(value, tuple) and len(value) > _MOST_ROWS:
        return f"{len(value)} points"
    if isinstance(value, tuple) and value and all(isinstance(row, tuple) for row in value):
        return "\n".join(" ".join(f"{each:.4g}" for each in row) for row in value)
    if isinstance(value, tuple) and value and all(is_dataclass(row) for row in value):
        rows = [camera_files.plain(row).items() for row in value]
        return "\n".join(", ".join(f"{name} {_shown(each)}" for name, each in row) for row in rows)
    if isinstance(value, Mapping):
        given = {name: figure for name, figure in camera_files.plain(value).items() if figure}
        return "\n".join(f"{name}: {figure}" for name, figure in given.items()) or "the same over the field"
    if not isinstance(value, Curve):
        return f"{value:.5g}" if isinstance(value, float) else str(value)
    nm, values = value.wavelengths_nm, value.values
    if len(nm) > 6:
        return f"{len(nm)} samples, {nm[0]:g}-{nm[-1]:g} nm, at most {max(values):.3g}"
    return "\n".join(f"{each:.3g} at {at:g} nm" for at, each in zip(nm, values, strict=True))
