"""The figures of the camera presets, each with where it comes from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from blurnoise.colour import behind_generic_filters
from blurnoise.spectra import Curve, Spectrum, cut_short

Figures = Mapping[str, Any]
"""The fields of a camera by name."""

_MVFOX = "manual of the mvBlueFOX3 cameras, EMVA 1288 figures of the model with this sensor"
_NO_FIGURE = "no public figure found, left at 0"
_PREGIUS = "Moravian Instruments, C1+ user manual, p. 15"
_GAIN_OF_PREGIUS = "quoted: 24 dB analogue of the 3.45 um Sony Pregius, " + _PREGIUS
_GAIN_ASSUMED = "assumed: no public gain series found; 24 dB as of Sony's machine-vision sensors"
_GAIN_MAX = "assumed: 0-48 dB, as FLIR's Blackfly S specifies for Sony's sensors"
_POST_OF_PREGIUS = (
    "derived: 3.45 um Sony Pregius, 2.2 e- at 0 dB and 2.0 e- at 24 dB, 2.00 before and 0.92 behind the amplifier, "
    + _PREGIUS
)
_PREGIUS_GAIN = MappingProxyType(
    {"analogue_gain_max_db": _GAIN_OF_PREGIUS, "read_noise_post_share": _POST_OF_PREGIUS}
)
_PREGIUS_POST_SHARE = round((0.92 / 2.2) ** 2, 3)
_NO_SERIES = "assumed: no public gain series found, none behind the amplifier"
_NO_COLOURS = MappingProxyType(
    {
        "cfa": "chosen: no filters; the colours of a picture have a sensor each, as of a camera with three",
        "ccm": "without: no filters",
    }
)
_GLOBAL = MappingProxyType(
    {
        "row_time_s": "without: a global shutter",
        "shutter": "quoted: Sony, Pregius sensors have a global shutter",
        "scan": "without effect: a global shutter",
    }
)
_ROWS_1650 = (
    "derived: 1650 clocks of 74.25 MHz, with 990 lines the 45 frames/s of the data sheet's table 1; "
    "registers 0x300C, 0x300A in Grain Media's sen_mt9m034.c"
)
_ROWS_AR0237 = (
    "assumed: no line length found; 1 / (60 x 1088), "
    "the most at the 60 frames/s that onsemi's data sheet AR0237CS/D states for 1080p"
)
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
    read_noise_post_share: float = 0.0,
    gain_sources: Mapping[str, str] = MappingProxyType({}),
) -> Figures:
    """A camera of the figures an EMVA 1288 data sheet quotes; what it does not quote is assumed and said."""
    full_well_e = float(round(10 ** (snr_max_db / 10)))
    read_noise_e = round(full_well_e / 10 ** (dynamic_range_db / 20) - 0.5, 2)
    snr_dr = f"{source} ({snr_max_db} dB, {dynamic_range_db} dB)"
    return _with_black_level(
        name,
        pixel_pitch_um=pixel_pitch_um,
        full_well_e=full_well_e,
        read_noise_e=read_noise_e,
        read_noise_post_share=read_noise_post_share,
        size_px=size_px,
        quantum_efficiency=quantum_efficiency,
        sources={
            **gain_sources,
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
    read_noise_post_share: float = 0.0,
) -> Figures:
    """A 12-bit camera whose gain puts the full well at full scale, above a black level of six read noises."""
    full_scale_dn = 4095
    per_electron = full_scale_dn / (full_well_e + 6 * read_noise_e)
    black_level_dn = float(round(6 * read_noise_e * per_electron))
    width_px, height_px = size_px
    return {
        "name": name,
        "pixel_pitch_um": pixel_pitch_um,
        "f_number": f_number,
        "transmission": 1.0,
        "quantum_efficiency": quantum_efficiency,
        "full_well_e": full_well_e,
        "system_gain_dn_per_e": (full_scale_dn - black_level_dn) / full_well_e,
        "read_noise_e": read_noise_e,
        "read_noise_post_share": read_noise_post_share,
        "analogue_gain_max_db": 24.0,
        "gain_max_db": 48.0,
        "black_level_dn": black_level_dn,
        "bit_depth": 12,
        "width_px": width_px,
        "height_px": height_px,
        "sources": {
            "f_number": _LENS,
            "transmission": _LENS,
            "system_gain_dn_per_e": "chosen: the full well is full scale",
            "black_level_dn": "chosen: six times the read noise, so that the dark is not clipped",
            "read_noise_post_share": _NO_SERIES,
            "analogue_gain_max_db": _GAIN_ASSUMED,
            "gain_max_db": _GAIN_MAX,
            "conversion_gains": "assumed: one conversion gain",
            "captures": "chosen: one exposure",
            "dark_current_e_s": _NO_FIGURE,
            "prnu": _NO_FIGURE,
            "dsnu_e": _NO_FIGURE,
            "dark_reference_c": "assumed; without effect while the dark current is 0",
            "dark_doubling_c": "assumed; without effect while the dark current is 0",
            "defocus_radius_px": "assumed: in focus",
            "diffraction_wavelength_um": "without: a picture has been through a lens already",
            "hfov_deg": "assumed: the lens is the user's choice",
            **_NO_COLOURS,
            **_GLOBAL,
            "lens": "assumed: the same over the field; the lens is the user's choice",
            **sources,
        },
    }


_BLACKFLY_QE = Curve((470.0, 525.0, 630.0, 800.0), (0.50, 0.60, 0.48, 0.25))
_BLACKFLY = "blackfly.json of Kitware's nrtk 1.1.0"
# Neither held nor extrapolated below 470 nm: the table has no figure there, monochrome sensors hold or rise and
# those behind colour filters fall, and what users have computed with these cameras stays; so the gap is marked.
_MARKED = f"marked, no figure found below 470 nm: {cut_short(_BLACKFLY_QE)}"
_QE_ASSUMED = f"assumed: no public figure found; that of the 3.45 um Blackfly in {_BLACKFLY}; {_MARKED}"
_MT9M034 = "manual of the mvBlueFOX3-1012d, EMVA 1288 figures"
_AR0132AT = "onsemi data sheet AR0132AT/D rev. 9, table 1"
_SAME_ARRAY = "derived from the MT9M034, whose data sheet has the same table 1 (same pixel array)"
_SMALLER = "assumed: no public figure found; the MT9M034's, the well scaled by the pixel's area"
_LIN = "Lin et al., Sensors 2024, 24, 5135"
# The paper's tool counts 5774.616 quanta at 50 lux, 30 ms, f/1.4, 3.45 um (green AR0237 channel behind an
# IR-cut filter, Planck 5500 K, 400-650 nm); D55 over 400-700 nm and Q = 1 give 24 421.8 here.
_LIN_QE = 5774.616 / 24421.8
_LIN_GAIN = 5.88


def _with_mosaic(base: Figures, name: str) -> Figures:
    """A camera behind generic filters in a Bayer pattern."""
    sources = {
        "cfa": "assumed: the usual pattern",
        "quantum_efficiency": "assumed: the sensor's own, 0.50 held below 470 nm, behind the generic filters of "
        "blurnoise.colour.behind_generic_filters",
        "ccm": "assumed: that of the AR0231 in openpilot, system/camerad/sensors (MIT), daylight",
    }
    return {
        **base,
        "name": name,
        "cfa": "RGGB",
        "quantum_efficiency": replace(behind_generic_filters(base["quantum_efficiency"]), clear=None),
        "ccm": _AR0231_CCM,
        "sources": {**base["sources"], **sources},
    }


def _monochrome(base: Figures, name: str) -> Figures:
    """A camera without colour filters, which makes one grey plane of all colours."""
    sources = {"cfa": "chosen: no filters, one plane of light", "ccm": "without: no colours"}
    return {**base, "name": name, "cfa": "mono", "sources": {**base["sources"], **sources}}


def _rolling(base: Figures, row_time_s: float, source: str) -> Figures:
    """With an electronic rolling shutter."""
    sources = {
        "row_time_s": source,
        "shutter": "quoted: electronic rolling shutter, the sensor's data sheet, table 1",
        "scan": "assumed: mounted upright; upside down it is 'up'",
    }
    return {**base, "row_time_s": row_time_s, "shutter": "rolling", "sources": {**base["sources"], **sources}}


_AR0231_CCM = (
    (1.3671875, -0.0546875, -0.3125),
    (-0.53125, 1.4609375, 0.0703125),
    (-0.578125, -0.25, 1.828125),
)
_IMX250 = _from_emva(
    "imx250",
    pixel_pitch_um=3.45,
    snr_max_db=40.3,
    dynamic_range_db=71.2,
    size_px=(2464, 2056),
    quantum_efficiency=_BLACKFLY_QE,
    qe_source=_QE_ASSUMED,
    source=_MVFOX,
    read_noise_post_share=_PREGIUS_POST_SHARE,
    gain_sources=_PREGIUS_GAIN,
)
FIGURES: tuple[Figures, ...] = (
    _IMX250,
    _with_mosaic(_IMX250, "imx250c"),
    _monochrome(_IMX250, "imx250m"),
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
    _rolling(
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
        1650 / 74.25e6,
        _ROWS_1650,
    ),
    _with_black_level(
        "blackfly",
        pixel_pitch_um=3.45,
        full_well_e=11105.0,
        read_noise_e=2.45,
        read_noise_post_share=_PREGIUS_POST_SHARE,
        size_px=(2448, 2048),
        quantum_efficiency=_BLACKFLY_QE,
        f_number=2.743,
        sources={
            "pixel_pitch_um": f"quoted: {_BLACKFLY}",
            "full_well_e": f"quoted: {_BLACKFLY} (max_n)",
            "bit_depth": f"quoted: {_BLACKFLY}",
            "quantum_efficiency": f"quoted: {_BLACKFLY}; linear between its four wavelengths; {_MARKED}",
            **_PREGIUS_GAIN,
            "f_number": f"derived: focal length over aperture, {_BLACKFLY}",
            "read_noise_e": "assumed: no public figure found; that of the IMX250, the same pitch and well",
            "width_px": "assumed: that of the IMX250",
            "height_px": "assumed: that of the IMX250",
        },
    ),
    _rolling(
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
        1650 / 74.25e6,
        _ROWS_1650,
    ),
    _rolling(
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
                "quantum_efficiency": "derived: mean over 400-700 nm of its green channel behind an IR-cut filter, "
                f"{_LIN}; 0 outside the 400-650 nm that its tool counts",
                "full_well_e": _SMALLER,
                "read_noise_e": _SMALLER,
                "bit_depth": "assumed: 12, linear mode",
            },
        ),
        1.53e-5,
        _ROWS_AR0237,
    ),
    {
        "name": "lin2024",
        "pixel_pitch_um": 3.45,
        "f_number": 1.4,
        "transmission": 1.0,
        "quantum_efficiency": _LIN_QE / _LIN_GAIN,
        "full_well_e": 11038.0,
        "system_gain_dn_per_e": _LIN_GAIN,
        "read_noise_e": 2.44,
        "bit_depth": 12,
        "defocus_radius_px": 1.0,
        "defocus_counts_pixel": True,
        "width_px": 4096,
        "height_px": 2160,
        "hfov_deg": 99.32,
        "sources": {
            "quantum_efficiency": "effective: the tool divides its quanta by the sensitivity of 5.88 before "
            "it draws shot noise and multiplies by it after, so one quantum is one DN and white at 50 lux "
            "fills 12 bits at 21.3 ms; 5774.616 quanta at 50 lux and 30 ms are 982.1 electrons here; "
            "0 outside 400-650 nm, as the tool counts, whose number this is",
            "system_gain_dn_per_e": "quoted: the tool's sensitivity, which its EMVA source gives in e-/DN",
            "full_well_e": f"quoted: {_LIN}; never reached, since the converter is full at 696 e-",
            "read_noise_e": f"quoted: {_LIN} (its dark noise)",
            "black_level_dn": f"quoted: {_LIN} (baseline 0)",
            "bit_depth": f"quoted: {_LIN}",
            "pixel_pitch_um": f"quoted: {_LIN}",
            "f_number": f"quoted: {_LIN}",
            "transmission": f"quoted: {_LIN}",
            "defocus_radius_px": f"quoted: {_LIN} (fspecial disk of radius 1)",
            "diffraction_wavelength_um": "the tool has none",
            "width_px": f"quoted: {_LIN}, road scenes",
            "height_px": "assumed: 4096 x 2160",
            "hfov_deg": f"quoted: {_LIN}, as its Table 2 needs (printed as 99)",
            "read_noise_post_share": "the tool has no gain",
            "analogue_gain_max_db": "the tool has no gain",
            "gain_max_db": "assumed: digital; the tool has no gain",
            "conversion_gains": "the tool has no gain",
            "captures": "the tool has one exposure",
            "lens": "the tool has none",
            "row_time_s": "the tool has none",
            "shutter": "the tool exposes all rows together",
            "scan": "without effect: a global shutter",
            "dark_current_e_s": "the tool has none",
            "dark_reference_c": "without effect: no dark current",
            "dark_doubling_c": "without effect: no dark current",
            "prnu": "the tool has none",
            "dsnu_e": "the tool has none",
            **_NO_COLOURS,
        },
    },
)
"""The fields of each preset. Every figure's source starts with quoted, derived, chosen, assumed or effective."""
