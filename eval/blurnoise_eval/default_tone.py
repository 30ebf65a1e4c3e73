"""The default tone of photographs: the curve of a typical camera, by which they are read, and written again.

A photograph comes from some camera, of which none of fifteen that were measured has sRGB's curve: see
:data:`blurnoise.camera.colour.TYPICAL`, their median. Read and written by one curve, a picture keeps its values where
it keeps its exposure. Rendered pictures are sRGB-coded, and stay so.
"""

from __future__ import annotations

from typing import Literal

from blurnoise.camera import Camera
from blurnoise.camera.colour import PictureTone

NAME: Literal["typical"] = "typical"
_ASSUMED = "assumed, as of the photographs: "
_WORTH = (
    "3.8 stops of light between the values 128 and 16, the median of fifteen measured cameras; four of five have "
    "3.3 to 4.2, worth ± 0.5 stops of exposure in the dark; sRGB would have 5.4"
)


def of_photographs(tone: PictureTone | None, camera: Camera) -> tuple[PictureTone, Camera]:
    """The curve of photographs, and the camera that writes them; None: that of a typical camera for both.

    A camera whose file has a tone of its own keeps it.

    >>> of_photographs(None, Camera.preset("imx250"))[1].isp.tone
    'typical'
    >>> of_photographs("srgb", Camera.preset("imx250"))[1].isp.tone
    'srgb'
    """
    if tone is not None:
        return tone, camera
    stated = camera.sources.get("tone", "")
    if camera.isp.tone != "srgb" or (stated and not stated.startswith("assumed")):
        return NAME, camera
    sources = {**camera.sources, "tone": f"{_ASSUMED}{_WORTH}"}
    return NAME, camera.with_figures(tone=NAME, sources=sources)


def about(camera: Camera, setting: str = "--picture-tone srgb") -> str:
    """A line on what was assumed, and what it is worth. setting: that of sRGB, as typed.

    >>> about(of_photographs(None, Camera.preset("imx250"))[1]).partition(":")[0]
    'tone'
    """
    own = not camera.sources.get("tone", "").startswith(_ASSUMED)
    written = "written by the camera's own" if own else "written again"
    return (
        f"tone: photographs are read by a typical camera's curve and {written} ({_WORTH}). Measure yours: "
        f"blurnoise cameras fit --tone; pictures that are rendered: {setting}"
    )
