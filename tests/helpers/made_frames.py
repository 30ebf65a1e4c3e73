"""Frames of cameras that are made up, as the simulator takes them, and files that hold them."""

import json
import math

import numpy as np
import torch
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from blurnoise import Camera
from blurnoise.camera.lens import Lens
from blurnoise.camera.sensor import Sensor
from blurnoise.sensor.readout import read_out

LONGEST_S = 0.1


def drawn_camera(seed):
    """Read noise 0.5 to 20 e-, gain 0.05 to 5 DN/e-, 10 to 16 bits; a well that may or may not fill the converter."""
    random = np.random.default_rng(seed)
    bits = int(random.integers(10, 17))
    read_e, gain = (10 ** random.uniform(*np.log10(ends)) for ends in ((0.5, 20), (0.05, 5)))
    black = math.ceil(6 * gain * read_e + random.uniform(0, 20)) + float(random.choice([0, 0.3, 0.5]))
    range_e = (2**bits - 1 - black) / gain
    return Camera(
        f"drawn from {seed}",
        Lens(f_number=2.0, transmission=1.0),
        Sensor(
            pixel_pitch_um=3.0,
            quantum_efficiency=0.6,
            full_well_e=max(50.0, min(range_e * random.uniform(0.8, 1.3), 3e5)),
            system_gain_dn_per_e=gain,
            read_noise_e=read_e,
            dark_current_e_s=10 ** random.uniform(-1, 2.5),
            prnu=random.uniform(0.002, 0.02),
            dsnu_e=read_e * random.uniform(0.1, 1.0),
            black_level_dn=black,
            bit_depth=bits,
        ),
    )


CAMERA = drawn_camera(2).with_figures(
    full_well_e=9000.0, system_gain_dn_per_e=0.4, read_noise_e=4.0, prnu=0.01, dsnu_e=2.0, black_level_dn=20.0,
    bit_depth=12,
)  # fmt: skip
"""12 bits; noise in the dark of 1.6 DN, so that rounding adds 1/12."""
LOUDER = CAMERA.with_figures(read_noise_e=6.0, prnu=0.005, dsnu_e=1.0, black_level_dn=60.0)


def from_photons(photons, camera, **taken):
    """Digital numbers of mean photons per pixel, (B, C, H, W)."""
    return read_out(photons, camera, white_e=camera.sensor.quantum_efficiency, **taken)


def exposed(camera, seed, *, size, levels=8, frames=2, top=0.9):
    """Planes (H, W) uint16 by (kind, exposure_s), the brightest flat ones at ``top`` of saturation."""
    pattern = camera.sensor.fixed_pattern((1, *size), seed)
    generator = torch.Generator().manual_seed(seed)
    found = {}
    for exposure_s in np.linspace(LONGEST_S / levels, LONGEST_S, levels):
        for kind in ("dark", "flat"):
            photons = photons_s(camera, top) * exposure_s * (kind == "flat")
            dn = from_photons(
                torch.full((frames, 1, *size), photons),
                camera,
                exposure_s=float(exposure_s),
                temperature_c=camera.sensor.dark_reference_c,
                fixed_pattern=pattern,
                generator=generator,
            )
            found[kind, float(exposure_s)] = [each.numpy().astype(np.uint16) for each in dn[:, 0]]
    return found


def photons_s(camera, top=0.9):
    """Photons per pixel and second of the flat light."""
    return top * camera.sensor.saturation_e / float(camera.sensor.quantum_efficiency) / LONGEST_S


def save(folder, planes):
    """As NPY files named by what they are."""
    folder.mkdir(exist_ok=True)
    for (kind, exposure_s), each in planes.items():
        for number, plane in enumerate(each):
            np.save(folder / f"{kind}_{1e3 * exposure_s:.4f}ms_{number}.npy", plane)
    return folder


def write_dng(path, plane, tags):
    """An uncompressed DNG of one plane, (H, W) uint16; tags: number -> (TIFF's type, value), beside the usual."""
    directory = ImageFileDirectory_v2(b"II*\0\0\0\0\0")
    height, width = plane.shape
    usual = {
        256: (4, width), 257: (4, height), 258: (3, 16), 259: (3, 1), 262: (3, 32803), 273: (4, 0), 277: (3, 1),
        278: (4, height), 279: (4, plane.nbytes), 33421: (3, (2, 2)), 33422: (1, b"\0\1\1\2"),
        50706: (1, b"\1\4\0\0"),
    }  # fmt: skip
    for number, (kind, value) in sorted({**usual, **tags}.items()):
        directory.tagtype[number] = kind
        directory[number] = value
    # Pillow adds the directory's end to the strip's place
    path.write_bytes(b"II*\0\x08\0\0\0" + directory.tobytes(8) + plane.astype("<u2").tobytes())


def write_fits(path, numbers, **header):
    """A FITS file of (H, W) or (N, H, W) uint16 as BZERO shifts them; header: more keywords, or others."""
    sides = {f"NAXIS{axis}": side for axis, side in enumerate(numbers.shape[::-1], 1)}
    cards = {"SIMPLE": "T", "BITPIX": 16, "NAXIS": numbers.ndim, **sides, "BZERO": 32768, "BSCALE": 1}
    lines = [f"{name:8}= {value!s:>20} / made up" for name, value in {**cards, **header}.items()] + ["END"]
    text = "".join(line.ljust(80) for line in lines).encode()
    data = (numbers.astype(np.int32) - 32768).astype(">i2").tobytes()
    path.write_bytes(
        b"".join(
            part + b"\0" * (-len(part) % 2880) for part in (text.ljust(-(-len(text) // 2880) * 2880), data)
        )
    )


def write_tuning(path, **changes):
    """A module whose picture has 200 electrons of green on average, at 1000 lux, 10 ms, gain 2; K 0.25 at 10 bits."""
    slope, black = 4.0, 4096
    algorithms = {
        "rpi.black_level": {"black_level": black},
        "rpi.lux": {"reference_shutter_speed": 10000, "reference_gain": 2.0, "reference_aperture": 1.0,
                    "reference_lux": 1000, "reference_Y": black + 2 * slope**2 * 200},
        "rpi.noise": {"reference_constant": 0, "reference_slope": slope},
        "rpi.awb": {"ct_curve": [4000.0, 0.7, 0.5, 6000.0, 0.5, 0.7]},
        "rpi.ccm": {"ccms": [{"ct": 3000, "ccm": [3, -1, -1, -1, 3, -1, -1, -1, 3]},
                             {"ct": 4700, "ccm": [1.8, -0.5, -0.3, -0.4, 1.7, -0.3, -0.1, -0.6, 1.7]}]},
        "rpi.alsc": {"luminance_lut": [1.25] * 192},
        "rpi.contrast": {"gamma_curve": [0, 0, 32768, 49152, 65535, 65535]},
    }  # fmt: skip
    listed = [{name: of} for name, of in (algorithms | changes).items() if of is not None]
    path.write_text(json.dumps({"version": 2.0, "algorithms": listed}))
    return path
