"""The sensor under the EMVA 1288 method, analysed by a package that knows nothing of it.

Frames of flat light at 77 exposure times, and stacks of frames at half saturation and in the dark, go
through the analysis of the ``emva1288`` package (release 4 of the standard), which gives back the camera. Its
own camera model is not used. Expected values come from the camera's figures, not from ``blurnoise.sensor.readout``.
"""

import logging

import numpy as np
import pytest
import torch
from made_frames import from_photons

from blurnoise import Camera

process = pytest.importorskip("emva1288.process", reason="needs emva1288: pip install 'blurnoise[test]'")

ROWS, COLUMNS = 260, 321
LEVELS = np.concatenate([np.arange(2, 88, 2), np.arange(88, 105, 0.5)]) / 100
"""Light, relative to the nominal saturation: steps of 2 %, then of 0.5 % around the peak of the variance."""
STACK = 48  # frames for a spatial measurement
TEMPERATURE_C = 27.0
NANOSECONDS = 1e9  # the package's unit of time

# Standard deviations of the estimators: a pair of frames of P = 83460 pixels gives a variance to sqrt(2/P) = 0.49 %.
# Lines through n = 77 pairs leave 0.11 % of the system gain and the efficiency, 0.17 % of the read noise and the
# dark current, 0.36 % of the dark current by variance; PRNU and DSNU are known to 0.32 %.
QUANTITIES = {
    "system gain": ("K", 1, 0.01),
    "quantum efficiency": ("QE", 100, 0.01),
    "read noise": ("sigma_d", 1, 0.01),
    "dark current": ("u_I_mean", 1, 0.01),
    "dark current, by variance": ("u_I_var", 1, 0.02),
    "PRNU": ("PRNU1288", 100, 0.02),
    "DSNU": ("DSNU1288", 1, 0.02),
}
"""The package's name, its unit, and the tolerance, a share."""

PRESET = Camera.preset("imx250").with_figures(
    quantum_efficiency=0.6,
    dark_current_e_s=60.0,
    prnu=0.008,
    dsnu_e=1.2,
    black_level_dn=8.0,
)
FINE = PRESET.with_figures(
    name="14 bit, full well below the converter's range",
    quantum_efficiency=0.7,
    full_well_e=5000.0,
    system_gain_dn_per_e=2.5,
    read_noise_e=1.6,
    dark_current_e_s=40.0,
    dark_reference_c=20.0,
    dark_doubling_c=7.0,
    prnu=0.012,
    dsnu_e=1.5,
    black_level_dn=200.0,
    bit_depth=14,
)
QUIET = FINE.with_figures(
    name="read noise below one electron", read_noise_e=0.7, dark_current_e_s=8.0, dsnu_e=0.8
)
CAMERAS = {"fine": FINE, "quiet": QUIET, "imx250": PRESET}


@pytest.fixture(autouse=True)
def surroundings(monkeypatch):
    """One thread, as operations are short; and a function that the package calls and NumPy 2 has dropped."""
    monkeypatch.setattr(np, "asfarray", lambda values: np.asarray(values, dtype=float), raising=False)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def dark_electrons_s(camera):
    doublings = (TEMPERATURE_C - camera.sensor.dark_reference_c) / camera.sensor.dark_doubling_c
    return camera.sensor.dark_current_e_s * 2**doublings


class Bench:
    """A lamp and a range of exposure times, set once for the camera that the data sheet promises."""

    def __init__(self, promised):
        self.longest_s = 1.5 * promised.sensor.read_noise_e**2 / dark_electrons_s(promised)
        self.photons_s = promised.sensor.saturation_e / promised.sensor.quantum_efficiency / self.longest_s

    def analysis(self, camera, seed, fidelity="auto", lines=False):
        """What the package finds in ``camera``'s frames; lines: also of rows and columns."""
        pattern = camera.sensor.fixed_pattern((1, ROWS, COLUMNS), seed)
        generator = torch.Generator().manual_seed(seed)

        def frames(photons, exposure_s, count):
            dn = from_photons(
                torch.full((count, 1, ROWS, COLUMNS), photons),
                camera,
                exposure_s=exposure_s,
                temperature_c=TEMPERATURE_C,
                fixed_pattern=pattern,
                generator=generator,
                fidelity=fidelity,
            )
            return process.routines.get_int_imgs(list(dn[:, 0].numpy()))

        def series(exposure_s, count):
            photons = self.photons_s * exposure_s
            return {light: frames(light, exposure_s, count) for light in (0.0, photons)}

        temporal = {}
        for exposure_s in LEVELS * self.longest_s:
            pairs = series(exposure_s, 2)
            temporal[exposure_s * NANOSECONDS] = {
                light: {**pair, "sum": np.sum(pair["sum"]), "pvar": np.sum(pair["pvar"])}
                for light, pair in pairs.items()
            }
        half_s = self.longest_s / 2
        reduced = {
            "width": COLUMNS,
            "height": ROWS,
            "temporal": temporal,
            "spatial": {half_s * NANOSECONDS: series(half_s, STACK)},
        }
        results = process.Results1288(process.Data1288(reduced).data, loglevel=logging.WARNING)
        parts = (f"{kind}1288_{part}" for kind in ("PRNU", "DSNU") for part in ("row", "col", "pixel"))
        found = {name: float(getattr(results, name)) for name in parts} if lines else {}
        return found | {
            name: float(getattr(results, field)) / unit for name, (field, unit, _) in QUANTITIES.items()
        }

    def expected(self, camera):
        dark_s = dark_electrons_s(camera)
        by_camera = (
            camera.sensor.system_gain_dn_per_e,
            camera.sensor.quantum_efficiency,
            camera.sensor.read_noise_e,
            dark_s,
            dark_s,
        )
        values = (*by_camera, camera.sensor.prnu, camera.sensor.dsnu_e)
        return dict(zip(QUANTITIES, values, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "fidelity"), [*((name, "auto") for name in CAMERAS), ("fine", "full")])
def test_the_camera_is_found_in_its_frames(name, fidelity):
    camera, bench = CAMERAS[name], Bench(CAMERAS[name])
    found, expected = bench.analysis(camera, 1, fidelity), bench.expected(camera)
    for quantity, value in expected.items():
        assert found[quantity] == pytest.approx(value, rel=QUANTITIES[quantity][2]), quantity


@pytest.mark.slow
def test_rows_and_columns_are_found_in_the_frames():
    """The standard's read noise is that of pixels, rows and columns together: sqrt(1.6^2 + 1.2^2) = 2 e-.

    The deviation of 260 rows is known to 1 / sqrt(2 * 260) = 4.4 %; five of them.
    """
    camera = FINE.with_figures(
        row_noise_e=1.2, prnu_row=0.02, prnu_column=0.03, dsnu_row_e=3.0, dsnu_column_e=5.0
    )
    found = Bench(FINE).analysis(camera, seed=5, lines=True)
    for part, percent, offset_e, within in (
        ("row", 2.0, 3.0, 0.22), ("col", 3.0, 5.0, 0.22), ("pixel", 1.2, 1.5, 0.02)
    ):  # fmt: skip
        assert found[f"PRNU1288_{part}"] == pytest.approx(percent, rel=within), part
        assert found[f"DSNU1288_{part}"] == pytest.approx(offset_e, rel=within), part
    assert found["read noise"] == pytest.approx(2.0, rel=0.02)
    assert found["system gain"] == pytest.approx(2.5, rel=0.02)
