"""The gallery: a picture of every light effect, sensor stage and picture step, each by the command beside it.

Made when the guide is built. It is refused where a table has an entry that no picture here shows.
"""

from __future__ import annotations

import contextlib
import html
import io
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from blurnoise_eval.cli import main, run_alone
from blurnoise_eval.scenes import scenes
from mkdocs.structure.files import File, Files

from blurnoise.light.effects import EFFECTS
from blurnoise.picture.steps import STEPS
from blurnoise.sensor.stages import STAGES

SCENE = "scenes/000001.png"
SIGN = "84,141,155,156"  # of that scene, px: left, top, width, height


class Shown(NamedTuple):
    """A picture: the table's entry that it shows, how large the effect is here, options, and files."""

    entry: str
    about: str
    options: str
    camera: str = ""
    scene: str = SCENE
    settings: str = ""


GALLERY = {
    "Light": (
        Shown("headlamps", "an unlit road: the sign, 8 m ahead, returns the light of low beam",
              "--lux 1 --gain 24 --object 150,77,112,104 --headlamp low --distance-m 8 --sheeting XI",
              scene="scenes/000003.png"),
        Shown("pulsed lamp", "LEDs of 90 Hz, lit a tenth of the time: 5 ms have missed them",
              "--lux 200 --exposure-ms 5",
              settings="emitters: lamps.pgm:8\npwm: 90,0.1,0.5\npwm_mask: lamps.pgm"),
        Shown("motion between captures", "three captures of a moving scene: ghosts",
              "--lux 1000 --dx 1500 --hdr 16,256"),
        Shown("distortion", "barrel distortion of a wide lens", "--lux 200",
              "hfov_deg: 90\nlens: {distortion: {model: opencv, coefficients: [-0.35, 0.08, 0, 0, 0]}}"),
        Shown("objects", "the sign moves 30 px, its background stands",
              f"--lux 200 --object {SIGN} --moves targets --dx 3000"),
        Shown("lateral colour", "red 1.5 % larger than green, blue 1.5 % smaller", "--lux 200",
              "lens: {lateral_red: 0.015, lateral_blue: -0.015}"),
        Shown("defocus", "a disc of 3 px radius", "--lux 200", "defocus_radius_px: 3"),
        Shown("diffraction", "f/22 with pixels of 3.45 µm, green light", "--lux 30000 --f-number 22",
              "diffraction_wavelength_um: 0.55"),
        Shown("measured MTF", "a lens measured: half the contrast at 0.1 cycles/px", "--lux 200",
              "lens: {mtf: {csv: mtf.csv, unit: cycles/px}}"),
        Shown("motion", "1500 px/s to the right for 10 ms: 15 px", "--lux 200 --dx 1500"),
        Shown("motion variation", "driving at 50 km/h: a blur for every place on the road",
              "--lux 200 --ego-kmh 50 --exposure-ms 20", scene="scenes/000003.png",
              settings="vehicle: {lens: rectilinear, hfov_deg: 60}"),
        Shown("rolling shutter", "rows of the whole sensor 20 µs apart, 1500 px/s to the right",
              "--lux 1500 --dx 1500 --exposure-ms 1", settings="line_time_us: 20"),
        Shown("veiling glare", "tail lamps 1000 times as bright as painted, a dirty windscreen",
              "--lux 100", "lens: {veil_share: 0.03, halo_share: 0.07}", settings="emitters: lamps.pgm:1000"),
        Shown("vignetting", "cos⁴ of the field angle, 90° wide", "--lux 200",
              "hfov_deg: 90\nlens: {falloff_power: 4}"),
    ),
    "Sensor": (
        Shown("spectral integration", "one plane of light behind the sensor's own curve", "--lux 200",
              settings="cfa: mono"),
        Shown("PRNU", "pixels differ by 10 % in sensitivity", "--lux 200", "prnu: 0.1"),
        Shown("row gain noise", "rows that vary by 10 %, over 20 rows", "--lux 200",
              "row_gain_noise: 0.1\nrow_gain_rows: 20"),
        Shown("dark current", "a hot sensor: 85 °C", "--lux 20 --exposure-ms 30 --temperature-c 85 --gain 9",
              "dark_current_e_s: 100"),
        Shown("photon transfer", "bright light at a tenth of its shot noise, here after 24 dB", "--lux 12 --gain 24",
              "photon_transfer: [[0.01, 1.0], [0.04, 0.01]]"),
        Shown("shot noise", "50 electrons of white, hardly any other noise", "--lux 1 --gain auto"),
        Shown("full well", "a well of 1500 e⁻ ends below white", "--lux 40 --gain 15", "full_well_e: 1500"),
        Shown("read noise", "20 e⁻ where white is 250 e⁻", "--lux 5 --gain auto", "read_noise_e: 20"),
        Shown("row noise", "rows of 10 e⁻, others in each frame", "--lux 5 --gain auto", "row_noise_e: 10"),
        Shown("column noise", "columns of 10 e⁻, others in each frame", "--lux 5 --gain auto", "column_noise_e: 10"),
        Shown("noise of even and odd columns", "10 e⁻, others in each row and frame", "--lux 5 --gain auto",
              "parity_noise_e: 10"),
        Shown("DSNU", "offsets of 20 e⁻ that stay from frame to frame", "--lux 5 --gain auto", "dsnu_e: 20"),
        Shown("gain", "12 dB: brighter, and no less noisy", "--lux 40 --gain 12"),
        Shown("black level drift", "an offset of 40 DN in each frame, another in the next", "--lux 200",
              "black_level_drift_dn: 40"),
        Shown("quantisation", "a converter of 4 bits", "--lux 200",
              "bit_depth: 4\nsystem_gain_dn_per_e: 0.0014\nblack_level_dn: 0"),
        Shown("limits", "four times the light that fills the converter", "--lux 1000"),
    ),
    "Picture": (
        Shown("fusion", "the light of 'limits', two captures fused", "--lux 1000 --hdr 16"),
        Shown("black level", "an offset of a third of the range leaves less for light", "--lux 150",
              "black_level_dn: 1365"),
        Shown("white balance", "a Bayer camera under a light bulb, gains of daylight",
              "--lux 250", "base: imx250c\nwhite_balance: [1.4, 1.0, 1.6]", settings="illuminant: planck:2856"),
        Shown("demosaic", "a Bayer mosaic, bilinear", "--lux 400", "base: imx250c\ndemosaic: bilinear"),
        Shown("colour matrix", "more saturated colours, more noise", "--lux 100 --gain 12",
              "base: imx250c\nccm: [[1.9, -0.6, -0.3], [-0.5, 1.9, -0.4], [-0.3, -0.7, 2.0]]"),
        Shown("digital gain", "36 dB: 24 before the converter, 12 behind it", "--lux 2 --gain 36"),
        Shown("tone", "a filmic curve in place of sRGB's", "--lux 200", "tone: filmic"),
        Shown("noise reduction", "24 dB: noise of luma and chroma filtered by 25 and 40 DN", "--lux 12 --gain 24",
              "base: imx250c\nnoise_reduction: [{luma_sigma_dn: 25, chroma_sigma_dn: 40}]"),
        Shown("local tone", "CLAHE: shadows and highlights each get contrast of their own", "--lux 100",
              "local_tone: {clip_limit: 3}"),
        Shown("sharpening", "three times the detail finer than 1 px", "--lux 200", "sharpening: [{strength: 3}]"),
        Shown("JPEG", "quality 10", "--lux 200", "jpeg_quality: 10"),
    ),
    "Beyond the tables": (
        Shown("shake", "held by hand, 12 px", "--lux 200 --trajectory shake:12"),
        Shown("vibration", "3 px at 80 Hz, up and down", "--lux 200 --trajectory sine:3,80,90"),
        Shown("lamps", "tail lamps eight times as bright as painted", "--lux 100",
              settings="emitters: lamps.pgm:8"),
    ),
}  # fmt: skip
MTF = b"frequency,mtf\n0,1\n0.05,0.78\n0.1,0.5\n0.2,0.2\n0.5,0.02\n"
LAMPS = ((279, 302, 40, 75), (279, 302, 256, 283))  # of that scene, px: top, bottom, left, right


def on_files(files: Files, *, config: Any) -> None:
    """The page and its pictures."""
    named = {shown.entry for part in GALLERY.values() for shown in part}
    lacking = [each.name for table in (EFFECTS, STAGES, STEPS) for each in table if each.name not in named]
    if lacking:
        raise ValueError(f"docs/hooks/gallery.py: shows nothing of {', '.join(lacking)}")
    for name, content in pictures().items():
        files.append(File.generated(config, f"gallery/{name}", content=content))
    files.append(File.generated(config, "gallery.md", content="\n".join(_page())))


def commands() -> dict[str, str]:
    """The command of every picture by its file, the scene's first."""
    made = {"scene.png": "python -m blurnoise_eval.scenes -o scenes --count 4"}
    for shown in (each for part in GALLERY.values() for each in part):
        camera = f" --camera {_word(shown)}.yaml" if shown.camera else ""
        made[f"{_word(shown)}.png"] = (
            f"blurnoise simulate {shown.scene} -o {_word(shown)}.png {shown.options}{camera}"
            + (f" --scene {_word(shown)}-scene.yaml" if shown.settings else "")
        )
    return made


def given() -> dict[str, bytes]:
    """The files that the commands name beside the scene."""
    mask = bytearray(320 * 320)
    for top, bottom, left, right in LAMPS:
        for row in range(top, bottom):
            mask[row * 320 + left : row * 320 + right] = b"\xff" * (right - left)
    every = (each for part in GALLERY.values() for each in part if each.camera)
    cameras = {f"{_word(each)}.yaml": _based(each.camera).encode() for each in every}
    every = (each for part in GALLERY.values() for each in part if each.settings)
    cameras |= {f"{_word(each)}-scene.yaml": f"{each.settings}\n".encode() for each in every}
    return {"mtf.csv": MTF, "lamps.pgm": b"P5 320 320 255\n" + mask, **cameras}


@cache  # 'mkdocs serve' builds again and again
def pictures() -> dict[str, bytes]:
    """Every picture as its command made it. Raises ``RuntimeError`` naming a command that fails."""
    found = {}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for name, content in given().items():
            Path(name).write_bytes(content)
        for name, command in commands().items():
            told = io.StringIO()
            with contextlib.redirect_stdout(told), contextlib.redirect_stderr(told):
                words = command.split()
                code = main(words[1:]) if words[0] == "blurnoise" else run_alone(scenes, "scenes", words[3:])
            if code:
                raise RuntimeError(f"{command}: {told.getvalue()}")
            found[name] = Path(SCENE if name == "scene.png" else name).read_bytes()
    return found


def _page() -> Iterator[str]:
    yield "# Gallery of effects"
    yield ""
    yield "What each effect looks like, exaggerated so that it shows. Every picture was made by the command below it"
    yield "when this page was built, from the scene that comes first, with 10 ms unless it says otherwise."
    for title, part in GALLERY.items():
        yield f'\n## {title}\n\n<div class="gallery">'
        if title == "Light":
            yield _figure(
                "scene.png", "the scene", "as rendered, before any camera", commands()["scene.png"], ""
            )
        for each in part:
            name = f"{_word(each)}.png"
            camera = f"# {_word(each)}.yaml\n{_based(each.camera)}" if each.camera else ""
            if each.settings:
                camera += f"# {_word(each)}-scene.yaml\n{each.settings}\n"
            yield _figure(name, each.entry, each.about, commands()[name], camera)
        yield "</div>"


def _figure(name: str, title: str, about: str, command: str, camera: str) -> str:
    code = html.escape(command)
    more = f"<pre><code>{html.escape(camera)}</code></pre>" if camera else ""
    shown = f"{html.escape(title)}: {html.escape(about)}"
    return (
        f'<figure><img src="gallery/{name}" alt="{shown}" width="320" height="320" loading="lazy">'
        f"<figcaption><strong>{html.escape(title)}</strong>: {html.escape(about)}</figcaption>"
        f"<pre><code>{code}</code></pre>{more}</figure>"
    )


def _word(shown: Shown) -> str:
    return shown.entry.replace(" ", "-").lower()


def _based(camera: str) -> str:
    return camera if camera.startswith("base:") else f"base: imx250\n{camera}"
