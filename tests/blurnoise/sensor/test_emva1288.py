"""The sensor under the EMVA 1288 method, analysed by a package that knows nothing of it.

Frames of flat light at 77 exposure times, and stacks of frames at half saturation and in the dark, go
through the analysis of the ``emva1288`` package (release 4 of the standard), which gives back the camera. Its
own camera model is not used. Expected values come from the camera's figures, not from ``blurnoise.sensor.readout``.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
import torch
from made_frames import from_photons
from scipy.stats import norm

from blurnoise import Camera
from blurnoise.sensor import readout as sensor

process = pytest.importorskip("emva1288.process", reason="needs emva1288: pip install 'blurnoise[test]'")

ROWS, COLUMNS = 260, 321
LEVELS = np.concatenate([np.arange(2, 88, 2), np.arange(88, 105, 0.5)]) / 100
"""Light, relative to the nominal saturation: steps of 2 %, then of 0.5 % around the peak of the variance."""
STACK = 48  # frames for a spatial measurement
TEMPERATURE_C = 27.0
NANOSECONDS = 1e9  # the package's unit of time

# Why these bounds: standard deviations of the estimators, with those over 24-80 seeds in brackets (largest of
# the cameras). A pair of frames of P = 83460 pixels gives a variance to sqrt(2/P) = 0.49 %. n = 77 pairs, at
# times of mean 0.67 and standard deviation 0.32 of the longest.
#   System gain: slope through the origin of variance against mean, over 33 levels up to 70 % of saturation
#     and with the variance in proportion to the level: 0.49 % sqrt(9/(5 * 33)) = 0.11 % (0.11 %).
#   Quantum efficiency: responsivity / K, and means are exact to 1e-4: 0.11 % (0.11 %).
#   Read noise: half the error of the dark variance at time 0, which a line finds to
#     0.49 % sqrt(1 + (0.67/0.32)^2)/sqrt(n) = 0.13 %, twice that as dark charge grows to 1.5 times the read
#     noise's variance; so 0.13 %, and K's 0.11 %: 0.17 % (0.17 %).
#   Dark current: a dark mean has sigma/sqrt(2 P) = 0.24 % of sigma, and a slope 1/(0.32 sqrt(n)) = 0.36 of it.
#     With sigma at most 1.5 times the longest exposure's charge (QUIET) that is 0.13 %, and K's 0.11 %:
#     0.17 % (0.13 %).
#   Dark current, by variance: 0.49 % * 0.36 of a variance of 1.6 times the charge: 0.28 %; and K's twice:
#     0.36 % (0.30 %), so that 1 % would be too tight.
#   PRNU, DSNU: half of sqrt(2/P), a tenth more for the temporal noise left in the mean of the stack; DSNU
#     also K's: 0.29 % (0.32 %).
#   Saturation: the highest of noisy variances. The curve rises by 1 % per 1 % of light up to a rounded peak,
#     where 0.49 % of noise can move the highest by two steps of 0.5 % (0.52 %).
TOLERANCE = {
    "system gain": 0.01,
    "quantum efficiency": 0.01,
    "read noise": 0.01,
    "dark current": 0.01,
    "dark current, by variance": 0.02,
    "PRNU": 0.02,
    "DSNU": 0.02,
    "saturation": 0.03,
}

FINE = Camera(
    name="2.2 um, 14 bit, full well below the converter's range",
    pixel_pitch_um=2.2,
    f_number=2.0,
    transmission=1.0,
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
DEEP = replace(
    FINE,
    name="5.5 um, 12 bit, converter full before the well",
    pixel_pitch_um=5.5,
    quantum_efficiency=0.45,
    full_well_e=32000.0,
    system_gain_dn_per_e=0.15,
    read_noise_e=8.0,
    dark_current_e_s=800.0,
    dark_doubling_c=8.0,
    prnu=0.01,
    dsnu_e=10.0,
    black_level_dn=40.0,
    bit_depth=12,
)
QUIET = replace(
    FINE,
    name="9 um, read noise below one electron",
    pixel_pitch_um=9.0,
    quantum_efficiency=0.92,
    full_well_e=20000.0,
    system_gain_dn_per_e=3.2,
    read_noise_e=0.7,
    dark_current_e_s=8.0,
    dark_doubling_c=6.0,
    prnu=0.02,
    dsnu_e=0.8,
    black_level_dn=32.5,
    bit_depth=12,
)
PRESET = replace(
    Camera.preset("imx250"),
    quantum_efficiency=0.6,
    dark_current_e_s=60.0,
    prnu=0.008,
    dsnu_e=1.2,
    black_level_dn=8.0,
)
CAMERAS = {"fine": FINE, "deep": DEEP, "quiet": QUIET, "imx250": PRESET}


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Thousands of short operations: on a busy machine a second thread costs far more than it gives."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@contextmanager
def for_numpy_2() -> Iterator[None]:
    """The package still calls a function that NumPy 2 has dropped."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(np, "asfarray", lambda values: np.asarray(values, dtype=float), raising=False)
        yield


def dark_electrons_s(camera: Camera) -> float:
    doublings = (TEMPERATURE_C - camera.dark_reference_c) / camera.dark_doubling_c
    return camera.dark_current_e_s * 2**doublings


def limit_e(camera: Camera) -> float:
    """Electrons beyond which the digital number no longer grows."""
    return min(
        camera.full_well_e, (2**camera.bit_depth - 1 - camera.black_level_dn) / camera.system_gain_dn_per_e
    )


class Bench:
    """A lamp and a range of exposure times, set once for the camera that the data sheet promises."""

    def __init__(self, promised: Camera) -> None:
        self.longest_s = 1.5 * promised.read_noise_e**2 / dark_electrons_s(promised)
        self.photons_s = limit_e(promised) / float(promised.quantum_efficiency) / self.longest_s

    def analysis(
        self, camera: Camera, seed: int, fidelity: sensor.Fidelity = "auto", *, lines: bool = False
    ) -> dict[str, float]:
        """What the package finds in ``camera``'s frames; lines: also of rows and columns."""
        pattern = camera.fixed_pattern((1, ROWS, COLUMNS), seed)
        generator = torch.Generator().manual_seed(seed)

        def frames(photons: float, exposure_s: float, count: int) -> dict[str, object]:
            dn = from_photons(
                torch.full((count, 1, ROWS, COLUMNS), photons),
                camera,
                exposure_s=exposure_s,
                temperature_c=TEMPERATURE_C,
                fixed_pattern=pattern,
                generator=generator,
                fidelity=fidelity,
            )
            assert torch.equal(dn, dn.round())
            return process.routines.get_int_imgs(list(dn[:, 0].numpy()))

        def series(exposure_s: float, count: int) -> dict[float, dict[str, object]]:
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
        with for_numpy_2():
            results = process.Results1288(process.Data1288(reduced).data, loglevel=logging.WARNING)
            parts = (f"{kind}1288_{part}" for kind in ("PRNU", "DSNU") for part in ("row", "col", "pixel"))
            found = {name: float(getattr(results, name)) for name in parts} if lines else {}
            return found | {
                "system gain": float(results.K),
                "quantum efficiency": float(results.QE) / 100,
                "read noise": float(results.sigma_d),
                "dark current": float(results.u_I_mean),
                "dark current, by variance": float(results.u_I_var),
                "PRNU": float(results.PRNU1288) / 100,
                "DSNU": float(results.DSNU1288),
                "saturation": float(results.u_e_sat),
            }

    def expected(self, camera: Camera) -> dict[str, float]:
        return {
            "system gain": camera.system_gain_dn_per_e,
            "quantum efficiency": float(camera.quantum_efficiency),
            "read noise": camera.read_noise_e,
            "dark current": dark_electrons_s(camera),
            "dark current, by variance": dark_electrons_s(camera),
            "PRNU": camera.prnu,
            "DSNU": camera.dsnu_e,
            "saturation": self.saturation_e(camera),
        }

    def saturation_e(self, camera: Camera) -> float:
        """Photo-electrons at the peak of the temporal variance, which the standard calls saturation."""
        photo_e = np.linspace(0.7, 1.05, 3501) * limit_e(camera)
        dark_e = dark_electrons_s(camera) * photo_e / (self.photons_s * float(camera.quantum_efficiency))
        return float(photo_e[np.argmax(temporal_variance_e2(camera, photo_e, dark_e))])


def temporal_variance_e2(camera: Camera, photo_e: np.ndarray, dark_e: np.ndarray) -> np.ndarray:
    """Variance over time, averaged over pixels, of the charge that the limit c cuts off; no rounding.

    The charge of a pixel is taken as normal, of mean m and of variance v. With a = (c - m)/sqrt(v) the rest has
    the variance v [Phi - a phi + a^2 (1 - Phi) - (a (1 - Phi) - phi)^2], as integrating min(x, c) and its
    square gives. PRNU and DSNU spread m, over which the mean is taken.
    """
    unevenness = np.linspace(-5, 5, 201)
    shares = norm.pdf(unevenness) / norm.pdf(unevenness).sum()
    spread_e = np.sqrt((camera.prnu * photo_e) ** 2 + camera.dsnu_e**2)
    mean_e = (photo_e + dark_e)[:, None] + spread_e[:, None] * unevenness
    variance_e2 = (photo_e + dark_e + camera.read_noise_e**2)[:, None]
    a = (limit_e(camera) - mean_e) / np.sqrt(variance_e2)
    above, density = norm.sf(a), norm.pdf(a)
    cut = variance_e2 * (1 - above - a * density + a**2 * above - (a * above - density) ** 2)
    return cut @ shares


def disagreements(found: Mapping[str, float], expected: Mapping[str, float]) -> set[str]:
    """Names of the quantities that are further from what is expected than their tolerance, or not a number."""
    return {name for name, value in expected.items() if not abs(found[name] / value - 1) <= TOLERANCE[name]}


@pytest.mark.slow
@pytest.mark.parametrize("fidelity", ["auto", "full"])
@pytest.mark.parametrize("name", CAMERAS)
def test_the_camera_is_found_in_its_frames(name: str, fidelity: sensor.Fidelity) -> None:
    camera, seed = CAMERAS[name], 1 + list(CAMERAS).index(name)
    bench = Bench(camera)
    found, expected = bench.analysis(camera, seed, fidelity), bench.expected(camera)
    assert not disagreements(found, expected), (found, expected)


@pytest.mark.slow
def test_rows_and_columns_are_found_in_the_frames() -> None:
    """The standard's read noise is that of pixels, rows and columns together: sqrt(1.6^2 + 1.2^2) = 2 e-.

    The deviation of 260 rows or 321 columns is known to 1 / sqrt(2 * 260) = 4.4 %; five of them. That of the pixels,
    as without lines, to 2 %; the read noise's row part to sqrt(2 / (77 * 260)) = 1 % of a variance of which it is a
    third.
    """
    camera = replace(
        FINE, row_noise_e=1.2, prnu_row=0.02, prnu_column=0.03, dsnu_row_e=3.0, dsnu_column_e=5.0
    )
    found = Bench(FINE).analysis(camera, seed=5, lines=True)
    for part, percent, offset_e, within in (
        ("row", 2.0, 3.0, 0.22), ("col", 3.0, 5.0, 0.22), ("pixel", 1.2, 1.5, 0.02)
    ):  # fmt: skip
        assert found[f"PRNU1288_{part}"] == pytest.approx(percent, rel=within), part
        assert found[f"DSNU1288_{part}"] == pytest.approx(offset_e, rel=within), part
    assert found["read noise"] == pytest.approx(2.0, rel=0.02)
    assert found["system gain"] == pytest.approx(2.5, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("gain_db", [6.0, 12.0, 18.0])
def test_gain_and_read_noise_are_found_at_three_gains(gain_db: float) -> None:
    at_rest = replace(
        PRESET, read_noise_post_share=0.5, black_level_dn=60.0
    )  # six times the read noise at 18 dB
    camera = at_rest.at_gain(gain_db).camera
    bench = Bench(camera)
    found = bench.analysis(camera, seed=70 + int(gain_db))
    g = 10 ** (gain_db / 20)
    assert found["system gain"] == pytest.approx(g * PRESET.system_gain_dn_per_e, rel=0.01)
    assert found["read noise"] == pytest.approx(PRESET.read_noise_e * (0.5 + 0.5 / g**2) ** 0.5, rel=0.01)
    assert not disagreements(found, bench.expected(camera)), found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("field", "factor", "noticed"),
    [
        ("system_gain_dn_per_e", 1.1, {"system gain"}),
        # not 1.1: the package looks for the peak from the end, and stays in the noise that full wells have
        ("quantum_efficiency", 0.9, {"quantum efficiency"}),
        ("read_noise_e", 1.1, {"read noise"}),
        ("dark_current_e_s", 1.1, {"dark current", "dark current, by variance"}),
        ("dark_doubling_c", 1.1, {"dark current", "dark current, by variance"}),
        ("prnu", 1.1, {"PRNU"}),
        ("dsnu_e", 1.1, {"DSNU"}),
        ("full_well_e", 0.9, {"saturation"}),
    ],
)
def test_a_camera_off_by_a_tenth_is_rejected(field: str, factor: float, noticed: set[str]) -> None:
    """Frames of a camera that is not as promised: what is off is noticed, and nothing else."""
    bench = Bench(FINE)
    found = bench.analysis(replace(FINE, **{field: factor * getattr(FINE, field)}), seed=11)
    assert disagreements(found, bench.expected(FINE)) == noticed, found


def test_the_expected_peak_is_that_of_counted_electrons() -> None:
    """The normal charge against NumPy's Poisson counts, at the smallest capacity, where they differ most.

    400000 pairs give a variance to sqrt(2/400000) = 0.22 %, at heavier tails 0.4 %: five of it are 2 %, and
    another 1 % is for Poisson's skewness of 0.03. The peak lies between the first and the third level.
    """
    levels = np.array([0.88, 0.92, 0.96, 1.0]) * limit_e(QUIET)
    random = np.random.default_rng(3)
    counted = []
    for photo_e in levels:
        gain, offset = random.standard_normal((2, 400_000))
        mean_e = photo_e * (1 + QUIET.prnu * gain)
        pair = random.poisson(mean_e, (2, 400_000)) + QUIET.dsnu_e * offset
        pair = np.minimum(pair + QUIET.read_noise_e * random.standard_normal((2, 400_000)), limit_e(QUIET))
        counted.append(np.mean(np.diff(pair, axis=0) ** 2) / 2)
    expected = temporal_variance_e2(QUIET, levels, 0 * levels)
    assert counted == pytest.approx(expected, rel=0.03)
    assert int(np.argmax(counted)) == 1
    assert levels[0] < Bench(QUIET).saturation_e(QUIET) < levels[2]
