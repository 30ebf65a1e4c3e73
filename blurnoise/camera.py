"""Cameras in EMVA 1288 terms, and presets whose every figure says where it comes from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import lru_cache

import torch
from torch import Tensor

from blurnoise import rng
from blurnoise.checks import in_range, non_negative, positive
from blurnoise.spectra import Curve, Spectrum
from blurnoise.transfer import Optics


@dataclass(frozen=True)
class Camera:
    """A camera: lens, pixel, converter (EMVA 1288 release 4, linear model).

    pixel_pitch_um: square pixel. f_number: working f-number N. transmission: lens and atmosphere, 0-1.
    quantum_efficiency: electrons per photon, a number over 400-700 nm or a :class:`Curve`, IR-cut and colour
    filter included; all channels of a colour picture share it, as after a white balance.
    full_well_e: saturation capacity. system_gain_dn_per_e: K. read_noise_e: rms, temporal, in the dark.
    dark_current_e_s: at dark_reference_c, doubling every dark_doubling_c. prnu: fraction. dsnu_e: rms.
    black_level_dn: offset before rounding. bit_depth: of the converter.
    defocus_radius_px: of the lens's disc. defocus_counts_pixel: blur by the disc's areas in the pixels, as
    ``fspecial('disk', r)`` does, which counts the pixel's own aperture twice; for comparisons only.
    width_px, height_px, hfov_deg: the picture's size and the horizontal field of view.
    sources: field name -> where its figure comes from.

    Raises ``ValueError`` or ``TypeError`` naming the field and what is allowed.
    """

    name: str
    pixel_pitch_um: float
    f_number: float
    transmission: float
    quantum_efficiency: Spectrum
    full_well_e: float
    system_gain_dn_per_e: float
    read_noise_e: float
    dark_current_e_s: float = 0.0
    dark_reference_c: float = 20.0
    dark_doubling_c: float = 8.0
    prnu: float = 0.0
    dsnu_e: float = 0.0
    black_level_dn: float = 0.0
    bit_depth: int = 12
    defocus_radius_px: float = 0.0
    defocus_counts_pixel: bool = False
    width_px: int = 1920
    height_px: int = 1080
    hfov_deg: float = 60.0
    sources: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("pixel_pitch_um", "f_number", "full_well_e", "system_gain_dn_per_e", "dark_doubling_c"):
            positive(name, getattr(self, name))
        for name in ("read_noise_e", "dark_current_e_s", "prnu", "dsnu_e", "defocus_radius_px"):
            non_negative(name, getattr(self, name))
        in_range("transmission", self.transmission, 0.0, 1.0)
        in_range("dark_reference_c", self.dark_reference_c, -273.15, 300.0)
        in_range("hfov_deg", self.hfov_deg, 1e-3, 360.0)
        if not isinstance(self.quantum_efficiency, Curve):
            in_range("quantum_efficiency", self.quantum_efficiency, 0.0, 1.0)
        for name, low, high in (("bit_depth", 1, 16), ("width_px", 1, 1 << 20), ("height_px", 1, 1 << 20)):
            if not isinstance(getattr(self, name), int):
                raise TypeError(f"{name} = {getattr(self, name)!r}: must be an integer")
            in_range(name, getattr(self, name), low, high)
        in_range("black_level_dn", self.black_level_dn, 0.0, self.full_scale_dn - 1)

    @property
    def full_scale_dn(self) -> int:
        """Highest digital number, 2^bit_depth - 1."""
        return int(2**self.bit_depth) - 1

    @property
    def clip_dn(self) -> float:
        """Highest digital number a pixel can give: full scale, or the full well's if that is lower."""
        return min(
            self.full_scale_dn,
            round(self.full_well_e * self.system_gain_dn_per_e + self.black_level_dn),
        )

    @property
    def saturation_e(self) -> float:
        """Electrons at which the signal clips: the full well, or the converter's limit if that is lower."""
        return min(self.full_well_e, (self.full_scale_dn - self.black_level_dn) / self.system_gain_dn_per_e)

    @property
    def optics(self) -> Optics:
        """The lens's blur that acts through its transfer function."""
        return Optics(defocus_radius_px=0.0 if self.defocus_counts_pixel else self.defocus_radius_px)

    def fixed_pattern(self, shape: tuple[int, ...], seed: int) -> tuple[Tensor, Tensor]:
        """The camera's fixed pattern: (gain, offset_e), float32 on the CPU, both of ``shape`` (C, H, W).

        gain is 1 + prnu N(0, 1) and multiplies the photo signal; offset_e is dsnu_e N(0, 1). The same
        camera, shape and seed give the same pattern in every frame.
        """
        return _fixed_pattern(self.prnu, self.dsnu_e, tuple(shape), seed)

    @classmethod
    def preset(cls, name: str) -> Camera:
        """A camera by name; see ``PRESETS`` for the names and ``camera.sources`` for where figures are from.

        Raises ``ValueError`` that lists the names for an unknown one.
        """
        if name not in PRESETS:
            raise ValueError(f"camera = {name!r}: unknown; presets are {', '.join(sorted(PRESETS))}")
        return PRESETS[name]

    def to_dict(self) -> dict[str, object]:
        """Plain values for JSON, sources included."""
        values: dict[str, object] = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        values["sources"] = dict(self.sources)
        if isinstance(self.quantum_efficiency, Curve):
            curve = self.quantum_efficiency
            values["quantum_efficiency"] = {
                "wavelengths_nm": list(curve.wavelengths_nm),
                "values": list(curve.values),
            }
        return values


@lru_cache(maxsize=4)
def _fixed_pattern(prnu: float, dsnu_e: float, shape: tuple[int, ...], seed: int) -> tuple[Tensor, Tensor]:
    like = torch.empty(1, *shape)
    gain = 1.0 + prnu * rng.standard_normal([seed], like, "prnu")[0]
    offset_e = dsnu_e * rng.standard_normal([seed], like, "dsnu")[0]
    return gain, offset_e


_MVFOX = "manual of the mvBlueFOX3 cameras, EMVA 1288 figures of the model with this sensor"
_NO_FIGURE = "no public figure found, left at 0"
_LENS = "assumed: the lens is the user's choice; f/1.4 without loss, as in Lin et al. 2024"
_OF_SNR = "derived: 10^(SNRmax/10) of the "
_OF_DR = "derived: saturation / 10^(DR/20) - 0.5, of the "


def _from_emva(
    name: str,
    *,
    pixel_pitch_um: float,
    snr_max_db: float,
    dynamic_range_db: float,
    size_px: tuple[int, int],
    quantum_efficiency: Spectrum,
    qe_source: str,
    source: str,
) -> Camera:
    """A camera from the figures an EMVA 1288 data sheet quotes; what it does not quote is assumed and said."""
    full_well_e = float(round(10 ** (snr_max_db / 10)))
    read_noise_e = round(full_well_e / 10 ** (dynamic_range_db / 20) - 0.5, 2)
    snr_dr = f"{source} ({snr_max_db} dB, {dynamic_range_db} dB)"
    return _with_black_level(
        name,
        pixel_pitch_um=pixel_pitch_um,
        full_well_e=full_well_e,
        read_noise_e=read_noise_e,
        size_px=size_px,
        quantum_efficiency=quantum_efficiency,
        sources={
            "pixel_pitch_um": f"quoted: {source}",
            "full_well_e": _OF_SNR + snr_dr,
            "read_noise_e": _OF_DR + snr_dr,
            "quantum_efficiency": qe_source,
            "bit_depth": f"quoted: {source}",
            "width_px": f"quoted: {source}",
            "height_px": f"quoted: {source}",
        },
    )


def _with_black_level(
    name: str,
    *,
    pixel_pitch_um: float,
    full_well_e: float,
    read_noise_e: float,
    size_px: tuple[int, int],
    quantum_efficiency: Spectrum,
    sources: Mapping[str, str],
    f_number: float = 1.4,
) -> Camera:
    """A 12-bit camera whose gain puts the full well at full scale, above a black level of six read noises."""
    full_scale_dn = 4095
    per_electron = full_scale_dn / (full_well_e + 6 * read_noise_e)
    black_level_dn = float(round(6 * read_noise_e * per_electron))
    width_px, height_px = size_px
    return Camera(
        name=name,
        pixel_pitch_um=pixel_pitch_um,
        f_number=f_number,
        transmission=1.0,
        quantum_efficiency=quantum_efficiency,
        full_well_e=full_well_e,
        system_gain_dn_per_e=(full_scale_dn - black_level_dn) / full_well_e,
        read_noise_e=read_noise_e,
        black_level_dn=black_level_dn,
        bit_depth=12,
        width_px=width_px,
        height_px=height_px,
        sources={
            "f_number": _LENS,
            "transmission": _LENS,
            "system_gain_dn_per_e": "chosen: the full well is full scale",
            "black_level_dn": "chosen: six times the read noise, so that the dark is not clipped",
            "dark_current_e_s": _NO_FIGURE,
            "prnu": _NO_FIGURE,
            "dsnu_e": _NO_FIGURE,
            "dark_reference_c": "assumed; without effect while the dark current is 0",
            "dark_doubling_c": "assumed; without effect while the dark current is 0",
            "defocus_radius_px": "assumed: in focus",
            "hfov_deg": "assumed: the lens is the user's choice",
            **sources,
        },
    )


_BLACKFLY_QE = Curve((470.0, 525.0, 630.0, 800.0), (0.50, 0.60, 0.48, 0.25))
_BLACKFLY = "blackfly.json of Kitware's nrtk 1.1.0"
_QE_ASSUMED = f"assumed: no public figure found; that of the 3.45 um Blackfly in {_BLACKFLY}"
_MT9M034 = "manual of the mvBlueFOX3-1012d, EMVA 1288 figures"
_AR0132AT = "onsemi data sheet AR0132AT/D rev. 9, table 1"
_SAME_ARRAY = "derived from the MT9M034, whose data sheet has the same table 1 (same pixel array)"
_SMALLER = "assumed: no public figure found; the MT9M034's, the well scaled by the pixel's area"
_LIN = "Lin et al., Sensors 2024, 24, 5135"
# The paper's tool counts 5774.616 quanta at 50 lux, 30 ms, f/1.4, 3.45 um (green AR0237 channel behind an
# IR-cut filter, Planck 5500 K, 400-650 nm); D55 over 400-700 nm and Q = 1 give 24 421.8 here.
_LIN_QE = 5774.616 / 24421.8
_LIN_GAIN = 5.88

PRESETS: Mapping[str, Camera] = {
    camera.name: camera
    for camera in (
        _from_emva(
            "imx250",
            pixel_pitch_um=3.45,
            snr_max_db=40.3,
            dynamic_range_db=71.2,
            size_px=(2464, 2056),
            quantum_efficiency=_BLACKFLY_QE,
            qe_source=_QE_ASSUMED,
            source=_MVFOX,
        ),
        _from_emva(
            "imx249",
            pixel_pitch_um=5.86,
            snr_max_db=45.1,
            dynamic_range_db=73.0,
            size_px=(1936, 1216),
            quantum_efficiency=_BLACKFLY_QE,
            qe_source=_QE_ASSUMED,
            source=_MVFOX,
        ),
        _from_emva(
            "mt9m034",
            pixel_pitch_um=3.75,
            snr_max_db=37.7,
            dynamic_range_db=63.4,
            size_px=(1280, 960),
            quantum_efficiency=_BLACKFLY_QE,
            qe_source=_QE_ASSUMED,
            source=_MT9M034,
        ),
        _with_black_level(
            "blackfly",
            pixel_pitch_um=3.45,
            full_well_e=11105.0,
            read_noise_e=2.45,
            size_px=(2448, 2048),
            quantum_efficiency=_BLACKFLY_QE,
            f_number=2.743,
            sources={
                "pixel_pitch_um": f"quoted: {_BLACKFLY}",
                "full_well_e": f"quoted: {_BLACKFLY} (max_n)",
                "bit_depth": f"quoted: {_BLACKFLY}",
                "quantum_efficiency": f"quoted: {_BLACKFLY}; linear between its four wavelengths, 0 outside",
                "f_number": f"derived: focal length over aperture, {_BLACKFLY}",
                "read_noise_e": "assumed: no public figure found; that of the IMX250, the same pitch and well",
                "width_px": "assumed: that of the IMX250",
                "height_px": "assumed: that of the IMX250",
            },
        ),
        _with_black_level(
            "ar0132at",
            pixel_pitch_um=3.75,
            full_well_e=5890.0,
            read_noise_e=3.48,
            size_px=(1280, 960),
            quantum_efficiency=_BLACKFLY_QE,
            sources={
                "pixel_pitch_um": f"quoted: {_AR0132AT}",
                "bit_depth": f"quoted: {_AR0132AT}",
                "width_px": f"quoted: {_AR0132AT}",
                "height_px": f"quoted: {_AR0132AT}",
                "full_well_e": f"{_SAME_ARRAY}; its own 43.9 dB is no EMVA figure",
                "read_noise_e": _SAME_ARRAY,
                "quantum_efficiency": _QE_ASSUMED,
            },
        ),
        _with_black_level(
            "ar0237",
            pixel_pitch_um=3.0,
            full_well_e=3770.0,
            read_noise_e=3.48,
            size_px=(1928, 1088),
            quantum_efficiency=round(_LIN_QE, 4),
            sources={
                "pixel_pitch_um": "quoted: onsemi data sheet AR0237CS/D rev. 4",
                "width_px": "quoted: onsemi data sheet AR0237CS/D rev. 4",
                "height_px": "quoted: onsemi data sheet AR0237CS/D rev. 4",
                "quantum_efficiency": "derived: mean of its green channel behind an IR-cut filter, " + _LIN,
                "full_well_e": _SMALLER,
                "read_noise_e": _SMALLER,
                "bit_depth": "assumed: 12, linear mode",
            },
        ),
        Camera(
            name="lin2024",
            pixel_pitch_um=3.45,
            f_number=1.4,
            transmission=1.0,
            quantum_efficiency=_LIN_QE / _LIN_GAIN,
            full_well_e=11038.0,
            system_gain_dn_per_e=_LIN_GAIN,
            read_noise_e=2.44,
            bit_depth=12,
            defocus_radius_px=1.0,
            defocus_counts_pixel=True,
            width_px=4096,
            height_px=2160,
            hfov_deg=99.32,
            sources={
                "quantum_efficiency": "effective: the tool divides its quanta by the sensitivity of 5.88 before "
                "it draws shot noise and multiplies by it after, so one quantum is one DN and white at 50 lux "
                "fills 12 bits at 21.3 ms; 5774.616 quanta at 50 lux and 30 ms are 982.1 electrons here",
                "system_gain_dn_per_e": "quoted: the tool's sensitivity, which its EMVA source gives in e-/DN",
                "full_well_e": f"quoted: {_LIN}; never reached, since the converter is full at 696 e-",
                "read_noise_e": f"quoted: {_LIN} (its dark noise)",
                "black_level_dn": f"quoted: {_LIN} (baseline 0)",
                "bit_depth": f"quoted: {_LIN}",
                "pixel_pitch_um": f"quoted: {_LIN}",
                "f_number": f"quoted: {_LIN}",
                "transmission": f"quoted: {_LIN}",
                "defocus_radius_px": f"quoted: {_LIN} (fspecial disk of radius 1)",
                "width_px": f"quoted: {_LIN}, road scenes",
                "height_px": "assumed: 4096 x 2160",
                "hfov_deg": f"quoted: {_LIN}, as its Table 2 needs (printed as 99)",
                "dark_current_e_s": "the tool has none",
                "dark_reference_c": "without effect: no dark current",
                "dark_doubling_c": "without effect: no dark current",
                "prnu": "the tool has none",
                "dsnu_e": "the tool has none",
            },
        ),
    )
}
"""Cameras by name. Every figure's source starts with quoted, derived, chosen, assumed or effective."""
