"""Brackets of a stop sign beside shade and a bright sky, made by NumPy alone: its own curve and noise."""

import numpy as np
from blurnoise_eval import datasets
from PIL import Image

EXIF = 0x8769
TIMES = tuple(2.0**stops for stops in range(-8, -1))
WIDE = tuple(2.0**stops for stops in range(-17, 3))
"""From where nothing is found to where everything is white."""


def sign_light():
    """Linear light (320, 320, 3) over four decades, with a stop sign in the middle: white is 1, the sky up to 30."""
    coded = datasets.rendered_signs((90,), count=1).pictures[0].load().astype(float) / 255
    light = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4) + 0.002
    rise = np.geomspace(1.0, 30.0, 90)[::-1, None, None]
    light[:90] *= rise
    light[:, :60] *= np.geomspace(0.05, 1.0, 60)[None, :, None]
    return light


def shoulder(light):
    """A camera's curve: a toe, a shoulder, white at 250; 3.4 stops between the values 16 and 128."""
    value = np.clip(light, 0, 1) ** (1 / 1.9)
    return 250 / 255 * (0.7 * value + 0.3 * (3 * value**2 - 2 * value**3))


def shots(light, times=TIMES, curve=shoulder, noise=2.5e-4, white_s=1 / 32, seed=1):
    """Pictures of 8 bits; white clips from ``white_s`` on. noise: of read-out, of white, beside the shot
    noise of 10 000 electrons."""
    random, pictures = np.random.default_rng(seed), []
    for time in times:
        exposed = light * time / white_s
        exposed = exposed + random.normal(size=light.shape) * np.sqrt(noise**2 + 1e-4 * exposed)
        pictures.append(np.rint(255 * curve(exposed)).astype(np.uint8))
    return pictures


def save(folder, pictures, times=TIMES, *, suffix=".png", stated=True, **columns):
    """Pictures and their frames.csv; columns: further ones, a value for each. stated=False: EXIF in place of it."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [",".join(["file", "exposure_s", *columns])]
    for number, (picture, time) in enumerate(zip(pictures, times, strict=True)):
        name = f"{number}{suffix}"
        exif = Image.Exif()
        exif.get_ifd(EXIF)[33434] = time
        options = {} if stated else {"exif": exif}
        options |= {"quality": 95, "subsampling": 0} if suffix == ".jpg" else {}
        Image.fromarray(picture).save(folder / name, **options)
        rows.append(",".join(map(str, [name, time, *(values[number] for values in columns.values())])))
    if stated:
        (folder / "frames.csv").write_text("\n".join(rows))
    return folder
