"""The files that README and the guide name, small and made up."""

import json
import shutil

import cv2
import made_brackets
import made_frames
import numpy as np
import torch
from band_readers import LETTERS, band_reader
from blurnoise_eval.datasets import read_picture, write_picture
from blurnoise_models.detector import STOP_SIGN
from blurnoise_models.scenes import write_coco

from blurnoise import Camera, charts
from blurnoise.camera.colour import srgb_from_linear

SIZE_PX = 128
PHOTOS = ("photo-0.png", "photo-1.png", "photo-2.png")  # by their names, either half of --part has some
MODELS = ("yolox_nano", "yolov8n", "fastestdet", "fp32", "int8", "m", "a", "b")


def write_all(folder):
    """Into an empty folder."""
    listing = write_coco(folder, seed=2, count=len(PHOTOS), size_px=SIZE_PX)
    names = [entry["file_name"] for entry in json.loads(listing.read_text())["images"]]
    for into, taken in (("photos", PHOTOS), ("scenes", names), ("bucket/photos", names)):
        (folder / into).mkdir(parents=True)
        for name, called in zip(names, taken, strict=True):
            shutil.copy(folder / name, folder / into / called)
    for into in ("scenes", "bucket"):
        shutil.copy(listing, folder / into / "instances.json")
    for name in MODELS:
        shutil.copy(STOP_SIGN, folder / f"{name}.onnx")
    shutil.copy(STOP_SIGN, folder / "bucket" / "m.onnx")
    _write_pictures(folder, names[1])
    _write_labels(folder, names)
    _write_camera(folder)


def _write_pictures(folder, scene):
    picture = read_picture(folder / scene)
    large = np.tile(picture, (3, 4, 1))  # objects of the guide begin at x = 300
    for name in ("photo.png", "night.png", "street.png"):
        write_picture(folder / name, large)
    (folder / "photo.png").rename(folder / "photo.jpg")  # known by its content
    mask = np.zeros(large.shape, np.uint8)
    mask[40:80, 60:100] = 255
    for name in ("lamps.png", "car.png"):
        write_picture(folder / name, mask)
    (folder / "street.hdr").write_bytes(_radiance(large))
    edge = charts.slanted_edge(100, 100, angle_deg=5.0)
    seen = [
        edge + 0.01 * torch.randn(edge.shape, generator=rng) for rng in (_random(1), _random(2), _random(3))
    ]
    coded = srgb_from_linear(seen[0].clamp(0, 1))[0, 0].mul(255).round().byte().numpy()
    write_picture(folder / "chart.png", coded)
    _write_charts(folder)
    for name, light in zip(("simulated.png", "real.png"), seen[1:], strict=True):
        write_picture(folder / name, (light[0, 0].clamp(0, 1) * 60000 + 64).round().numpy().astype(np.uint16))


def _write_charts(folder):
    star = srgb_from_linear(charts.siemens_star(300.0, height_px=320, width_px=320))
    write_picture(folder / "star.png", star[0, 0].mul(255).round().byte().numpy())
    trap = np.full((100, 160), 220, np.uint8)
    trap[40:60, 70:90] = 30
    write_picture(folder / "trap.png", trap)
    video = cv2.VideoWriter(str(folder / "clip.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 30, (64, 48))
    for level in (200, 20, 20, 120) * 8:
        frame = np.full((48, 64, 3), 20, np.uint8)
        frame[8:32, 8:32] = level
        video.write(frame)
    video.release()


def _random(seed):
    return torch.Generator().manual_seed(seed)


def _radiance(picture):
    """A picture of Radiance's format, shared exponents."""
    exponents = np.full((*picture.shape[:2], 1), 128, np.uint8)
    header = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {picture.shape[0]} +X {picture.shape[1]}\n"
    return header.encode() + np.concatenate([picture, exponents], axis=2).tobytes()


def _write_labels(folder, names):
    (folder / "data.yaml").write_text("val: photos\nnames: [stop sign]\n")
    (folder / "labels.txt").write_text("".join(f"{name}\trgb\n" for name in names))
    (folder / "keys.txt").write_text(LETTERS + "\n")
    band_reader(folder / "rec.onnx")
    for name in PHOTOS:
        (folder / "photos" / name).with_suffix(".txt").write_text("0 0.5 0.5 0.4 0.4\n")


def _write_camera(folder):
    Camera.preset("imx250").with_figures(dark_current_e_s=10.0).save(folder / "mine.yaml")
    (folder / "nir.yaml").write_text(
        "base: imx250m\nquantum_efficiency: {wavelengths_nm: [400, 1000], values: [0.5, 0.1]}\n"
    )
    (folder / "qe.csv").write_text("400,0.4\n550,0.6\n700,0.3\n")
    made_frames.save(folder / "frames", made_frames.exposed(made_frames.drawn_camera(1), 1, size=(64, 80)))
    for name in ("imx219.json", "imx477.json"):
        made_frames.write_tuning(folder / name)
    (folder / "scale.csv").write_text("number,light\n10,0.01\n117,0.18\n243,0.9\n")
    (folder / "bracket").mkdir()
    ramp, rows = np.linspace(0.001, 1, 48 * 64).reshape(48, 64), ["file,exposure_s"]
    for number, stops in enumerate((1, 2, 4)):
        light = torch.from_numpy(np.minimum(1.0, ramp * stops / 2))
        coded = srgb_from_linear(light).mul(255).round().byte().numpy()
        write_picture(folder / "bracket" / f"{number}.png", coded)
        rows.append(f"{number}.png,{stops}e-3")
    (folder / "bracket" / "frames.csv").write_text("\n".join(rows))
    made_brackets.save(folder / "room", made_brackets.shots(made_brackets.sign_light()))
    shutil.copytree(folder / "room", folder / "street")
    (folder / "flats").mkdir()
    noise = np.random.default_rng(1).normal(120, 3, (2, 96, 96))
    for number, picture in enumerate(noise.round().astype(np.uint8)):
        write_picture(folder / "flats" / f"{number}.png", picture)
    (folder / "flats" / "frames.csv").write_text("file,gain_db\n0.png,0\n1.png,0\n")
    levels = {51041: (12, (1e-4, 1e-7)), 50717: (4, 4095), 34855: (3, 400)}
    made_frames.write_dng(folder / "photo.dng", np.zeros((48, 64), np.uint16), levels)
