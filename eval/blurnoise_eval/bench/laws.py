"""What an augmentation must do: laws of light, noise and motion, tried on each library that is installed.

Domain: pictures (H, W, 3), uint8, or float32 where white is 1. Lengths in px, angles in degrees, times in s.

A library is a record of what can be asked of it; a law asks, and returns what it saw as text. Nothing is judged by
another library: each law has its own truth, such as the length that was ordered.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from blurnoise_eval.system.files import write_records
from blurnoise_eval.system.machine import hardware, versions
from blurnoise_eval.system.terminal import table_lines, width

Picture = NDArray[Any]
_LENGTH_PX, _ANGLES = 21, (0.0, 1.0, 45.0, 90.0)
_SIDE = 97
"""Odd, so that there is a pixel in the middle."""
_SPOT_PX = 2.0
_APART_PX = 12
"""Between points, in px."""


@dataclass(frozen=True)
class Library:
    """What can be asked of a library; None where it has nothing like it.

    noise(picture, seed): uint8 in and out. clip(pictures, seed): frames of one clip. blur(picture, length, angle):
    float32. default_blur(picture, seed): with the library's own ranges. exposed(picture, seconds): uint8 in and out.
    still(picture, seed): uint8, without ordered blur. replayed(small, large, seed): the draws of one size on
    another.
    """

    name: str
    package: str
    noise: Callable[[Picture, int], Picture] | None = None
    clip: Callable[[Sequence[Picture], int], Sequence[Picture]] | None = None
    blur: Callable[[Picture, int, float], Picture] | None = None
    default_blur: Callable[[Picture, int], Picture] | None = None
    exposed: Callable[[Picture, float], Picture] | None = None
    still: Callable[[Picture, int], Picture] | None = None
    replayed: Callable[[Picture, Picture, int], Picture] | None = None


@dataclass(frozen=True)
class Law:
    """A law: what must be true, and what a library is seen to do, None where it cannot be asked."""

    name: str
    seen: Callable[[Library], str | None]


@dataclass(frozen=True)
class Seen:
    """What one library did for one law."""

    law: str
    library: str
    version: str
    seen: str


@dataclass(frozen=True)
class LawTable:
    """A row per law and library, and the machine."""

    rows: list[Seen]
    machine: dict[str, Any]

    def write(self, folder: Path) -> None:
        """Write laws.csv and laws.json; raises ``OSError``."""
        write_records("laws", [asdict(row) for row in self.rows], self.document(), folder)

    def document(self) -> dict[str, Any]:
        """Everything, ready for JSON."""
        return {"machine": self.machine, "rows": [asdict(row) for row in self.rows]}

    def table(self) -> list[str]:
        """A line per law and library."""
        rows = [(row.law, f"{row.library} {row.version}", row.seen) for row in self.rows]
        return list(table_lines(("law", "library", "seen"), rows, (False,) * 3, width()))


def run(only: Sequence[str] = ()) -> LawTable:
    """Try all laws on all libraries that are installed. only: packages; () for all."""
    rows = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of other libraries, on their own futures
        found = [(library, version(library.package)) for library in installed(only)]
        for law in LAWS:
            for library, number in found:
                if (seen := law.seen(library)) is not None:
                    rows.append(Seen(law.name, library.name, number, seen))
    return LawTable(rows, {**hardware(), "versions": versions()})


def _grey(value: int = 128, side: int = _SIDE) -> Picture:
    return np.full((side, side, 3), value, np.uint8)


def _spot() -> Picture:
    """A soft spot in the middle: no pixel grid tells it from one that is moved by a fraction of a pixel."""
    y, x = np.mgrid[:_SIDE, :_SIDE] - _SIDE // 2
    light = np.exp(-(x**2 + y**2) / (2 * _SPOT_PX**2)).astype(np.float32)
    return np.repeat(light[..., None], 3, axis=2)


def _moments(picture: Picture) -> tuple[NDArray[np.float64], float]:
    """The centre (x, y) of a blurred spot, px from the middle, and the length of an even line that blurs it so."""
    light = picture[..., 1].astype(float)
    y, x = np.mgrid[: light.shape[0], : light.shape[1]] - _SIDE // 2
    places = np.stack([x.ravel(), y.ravel()])
    centre = places @ light.ravel() / light.sum()
    away = places - centre[:, None]
    covariance = away * light.ravel() @ away.T / light.sum()
    longest = np.linalg.eigvalsh(covariance)[-1] - _SPOT_PX**2
    return centre, float(np.sqrt(max(12 * longest, 0.0)))


def _mean_kept(library: Library) -> str | None:
    if library.noise is None:
        return None
    means = [
        np.mean([library.noise(_grey(value), seed).mean() for seed in range(5)]) for value in (64, 128, 200)
    ]
    return "64, 128, 200 become " + ", ".join(f"{mean:.1f}" for mean in means)


def _noise_on_grey(library: Library) -> str | None:
    if library.noise is None:
        return None
    return f"standard deviation {np.std(library.noise(_grey(), 0).astype(float), axis=(0, 1)).mean():.1f}"


def _frames_differ(library: Library) -> str | None:
    if library.clip is None:
        return None
    one, two = (frame.astype(float).ravel() for frame in library.clip([_grey(), _grey()], 0))
    if one.std() == 0 or two.std() == 0:
        return "no noise"
    return f"correlation of their noise {abs(np.corrcoef(one, two)[0, 1]):.2f}"


def _brighter(library: Library) -> str | None:
    if library.exposed is None:
        return None
    means = [library.exposed(_grey(64), seconds).mean() for seconds in (0.001, 0.004)]
    return f"mean {means[0]:.0f} with 1 ms, {means[1]:.0f} with 4 ms"


def _length(library: Library) -> str | None:
    if library.blur is None:
        return None
    lengths = [_moments(library.blur(_spot(), _LENGTH_PX, angle))[1] for angle in _ANGLES]
    return ", ".join(f"{length:.1f}" for length in lengths)


def _centre(library: Library) -> str | None:
    if library.default_blur is None:
        return None
    shifts = [float(np.hypot(*_moments(library.default_blur(_spot(), seed))[0])) for seed in range(40)]
    return f"moved by up to {max(shifts):.1f} px"


def _above_white(library: Library) -> str | None:
    if library.blur is None:
        return None
    lit = np.full((_SIDE, _SIDE, 3), 3.0, np.float32)
    try:
        return f"3.0 becomes {library.blur(lit, 9, 0.0)[_SIDE // 2, _SIDE // 2, 1]:.1f}"
    except (ValueError, TypeError) as error:
        return f"{type(error).__name__}"


def _same_seed(library: Library) -> str | None:
    if library.noise is None:
        return None
    one, two, other = (library.noise(_grey(), seed) for seed in (7, 7, 8))
    same, differs = np.array_equal(one, two), not np.array_equal(one, other)
    return "yes" if same and differs else "other bits" if not same else "the same for all seeds"


def _unblurred(library: Library) -> str | None:
    if library.still is None:
        return None
    bright = np.full((_SIDE, _SIDE, 3), 40, np.uint8)
    middle = slice(_APART_PX // 2, _SIDE - _APART_PX // 2, _APART_PX)
    bright[middle, middle] = 200
    seen = np.mean([library.still(bright, seed).astype(float) for seed in range(10)], axis=(0, 3))
    counts = range(-(_APART_PX // 2), _APART_PX // 2 + 1)
    around = np.array(
        [[np.roll(seen, (-y, -x), (0, 1))[middle, middle].mean() for x in counts] for y in counts]
    )
    around -= np.median(around)
    return (
        f"{100 * around[_APART_PX // 2, _APART_PX // 2] / around.sum():.0f} % of a point stays in its pixel"
    )


def _another_size(library: Library) -> str | None:
    if library.replayed is None:
        return None
    try:
        seen = library.replayed(_grey(), _grey(side=2 * _SIDE), 0)
    except (RuntimeError, ValueError) as error:
        return f"{type(error).__name__}: {str(error).splitlines()[0][:60]}"
    return "yes" if seen.shape[0] == 2 * _SIDE else f"returns {seen.shape[0]} px"


LAWS = (
    Law("noise keeps the mean", _mean_kept),
    Law("even grey gets noise", _noise_on_grey),
    Law("frames of a clip have noise of their own", _frames_differ),
    Law("a longer exposure is brighter", _brighter),
    Law(
        f"blur of {_LENGTH_PX} px has this length at {', '.join(f'{a:g}' for a in _ANGLES)} degrees", _length
    ),
    Law("blur leaves an object where its box is", _centre),
    Law("light above white is kept", _above_white),
    Law("the same seed gives the same bits", _same_seed),
    Law("without motion nothing is blurred", _unblurred),
    Law("draws can be replayed on another size", _another_size),
)


def installed(only: Sequence[str]) -> list[Library]:
    """The libraries of this environment that can be imported, ours and Kornia first."""
    makers: list[tuple[str, Callable[[], Library]]] = [
        ("blurnoise", _blurnoise),
        ("kornia", _kornia),
        ("albumentations", partial(_albumentations, "albumentations")),
        ("albumentationsx", partial(_albumentations, "albumentationsx")),
        ("torchvision", _torchvision),
        ("nrtk", _nrtk),
        ("imagecorruptions", _imagecorruptions),
        ("scikit-image", _skimage),
        ("deepinv", _deepinv),
    ]
    found = []
    for package, maker in makers:
        if only and package not in only:
            continue
        try:
            version(package)
            found.append(maker())
        except (PackageNotFoundError, ImportError):
            continue
    return found


def _tensor(picture: Picture) -> torch.Tensor:
    scale = 255.0 if picture.dtype == np.uint8 else 1.0
    return torch.from_numpy(picture.astype(np.float32) / scale).permute(2, 0, 1)[None]


def _array(tensor: torch.Tensor, like: Picture) -> Picture:
    picture = tensor[0].permute(1, 2, 0).numpy()
    return np.clip(picture * 255, 0, 255).round().astype(np.uint8) if like.dtype == np.uint8 else picture


@contextmanager
def _seeded(seed: int) -> Iterator[None]:
    """The global generators of PyTorch and NumPy, from which other libraries draw, and as they were afterwards."""
    before = np.random.get_state()  # noqa: NPY002
    try:
        with torch.random.fork_rng(devices=[]):
            torch.default_generator.manual_seed(seed)
            np.random.set_state(np.random.RandomState(seed).get_state())  # noqa: NPY002
            yield
    finally:
        np.random.set_state(before)  # noqa: NPY002


def _by_tensor(module: Callable[[torch.Tensor], torch.Tensor], picture: Picture, seed: int = 0) -> Picture:
    with _seeded(seed):
        return _array(module(_tensor(picture)), picture)


def _frames(module: Any, frames: Sequence[Picture], seed: int) -> list[Picture]:
    """A clip through Kornia's container of clips, as it is by default."""
    from kornia.augmentation import VideoSequential

    with _seeded(seed):
        seen = VideoSequential(module)(torch.stack([_tensor(frame) for frame in frames], 1))
    return [_array(seen[:, index], frame) for index, frame in enumerate(frames)]


def _replayed(module: Any, small: Picture, large: Picture, seed: int) -> Picture:
    _by_tensor(module, small, seed)
    return _array(module(_tensor(large), params=module._params), large)


def _blurnoise() -> Library:
    from blurnoise import Camera, RandomExposure, motion_blur, photoelectrons

    ours: Any = RandomExposure
    camera = Camera.preset("imx250")
    # In this light white just saturates, so that a picture keeps its brightness.
    lux = camera.sensor.full_well_e / photoelectrons(camera, 1.0, 0.01)
    lit: dict[str, Any] = {"exposure_s": 0.01, "illuminance_lux": lux, "gain_db": 0.0, "p": 1.0}
    noisy, moving = ours(camera, **lit, speed_px_s=0.0), ours(camera, **lit, speed_px_s=(0.0, 2000.0))

    def exposed(picture: Picture, seconds: float) -> Picture:
        return _by_tensor(
            ours("imx250", exposure_s=seconds, illuminance_lux=50.0, gain_db=0.0, p=1.0), picture
        )

    def blur(picture: Picture, length: int, angle: float) -> Picture:
        radians = np.deg2rad(angle)
        shift = torch.tensor([[length * np.cos(radians), -length * np.sin(radians)]], dtype=torch.float32)
        return _array(motion_blur(_tensor(picture), shift), picture)

    return Library(
        "blurnoise", "blurnoise",
        noise=partial(_by_tensor, noisy),
        clip=partial(_frames, noisy),
        blur=blur,
        default_blur=partial(_by_tensor, moving),
        exposed=exposed,
        still=partial(_by_tensor, noisy),
        replayed=partial(_replayed, noisy),
    )  # fmt: skip


def _kornia() -> Library:
    import kornia.augmentation as kornia
    from kornia.filters import motion_blur

    noise = kornia.RandomGaussianNoise(std=0.05, p=1.0)
    blur = kornia.RandomMotionBlur((3, 31), (-180.0, 180.0), (-1.0, 1.0), p=1.0)

    def fixed(picture: Picture, length: int, angle: float) -> Picture:
        return _array(motion_blur(_tensor(picture), length, angle, 0.0), picture)

    return Library(
        "Kornia", "kornia",
        noise=partial(_by_tensor, noise),
        clip=partial(_frames, noise),
        blur=fixed,
        default_blur=partial(_by_tensor, blur),
        still=partial(_by_tensor, noise),
        replayed=partial(_replayed, noise),
    )  # fmt: skip


def _albumentations(package: str) -> Library:
    import albumentations

    def applied(transform: Any, seed: int, **pictures: Any) -> Any:
        return albumentations.Compose([transform], seed=seed)(**pictures)

    def one(transform: Any, picture: Picture, seed: int) -> Picture:
        return np.asarray(applied(transform, seed, image=picture)["image"])

    def blur(picture: Picture, length: int, angle: float) -> Picture:
        ordered = {"angle_range": (angle, angle), "direction_range": (0.0, 0.0), "allow_shifted": False}
        return one(albumentations.MotionBlur((length, length), **ordered, p=1.0), picture, 0)

    noise = albumentations.ShotNoise(p=1.0)
    return Library(
        "albumentations" if package == "albumentations" else "AlbumentationsX", package,
        noise=partial(one, noise),
        clip=lambda frames, seed: applied(noise, seed, images=np.stack(frames))["images"],
        blur=blur,
        default_blur=partial(one, albumentations.MotionBlur((3, 31), p=1.0)),
        still=partial(one, albumentations.ISONoise(p=1.0)),
    )  # fmt: skip


def _torchvision() -> Library:
    from torchvision.transforms import v2

    noise = v2.GaussianNoise(sigma=0.05)

    def clip(frames: Sequence[Picture], seed: int) -> list[Picture]:
        from torchvision.tv_tensors import Video

        with _seeded(seed):
            seen = noise(Video(torch.cat([_tensor(frame) for frame in frames])))
        return [_array(seen[index : index + 1], frame) for index, frame in enumerate(frames)]

    return Library(
        "torchvision", "torchvision",
        noise=partial(_by_tensor, noise), clip=clip, still=partial(_by_tensor, noise),
    )  # fmt: skip


def _nrtk() -> Library:
    from nrtk.impls.perturb_image.optical import PybsmPerturber

    def seen(picture: Picture, seconds: float, seed: int) -> Picture:
        return np.asarray(PybsmPerturber(int_time=seconds, seed=seed)(image=picture, img_gsd=0.02)[0])

    return Library(
        "nrtk's PybsmPerturber", "nrtk",
        noise=lambda picture, seed: seen(picture, 0.03, seed),
        exposed=lambda picture, seconds: seen(picture, seconds, 0),
    )  # fmt: skip


def _imagecorruptions() -> Library:
    from imagecorruptions import corrupt

    def corrupted(name: str, picture: Picture, seed: int) -> Picture:
        with _seeded(seed):
            return np.asarray(corrupt(picture, corruption_name=name, severity=3))

    shot = partial(corrupted, "shot_noise")
    return Library("imagecorruptions", "imagecorruptions", noise=shot, still=shot)


def _skimage() -> Library:
    from skimage.util import random_noise

    def noise(picture: Picture, seed: int) -> Picture:
        return np.asarray(255 * random_noise(picture, mode="poisson", rng=seed)).round().astype(np.uint8)

    return Library("scikit-image's Poisson noise", "scikit-image", noise=noise, still=noise)


def _deepinv() -> Library:
    from deepinv.physics import Blur, PoissonNoise
    from deepinv.physics.generator import MotionBlurGenerator

    def moved(picture: Picture, seed: int) -> Picture:
        kernel = MotionBlurGenerator((31, 31)).step(seed=seed)["filter"]
        return _array(Blur(filter=kernel, padding="replicate")(_tensor(picture)), picture)

    def noisy(picture: Picture, seed: int) -> Picture:
        return _array(PoissonNoise(0.02, rng=torch.Generator().manual_seed(seed))(_tensor(picture)), picture)

    return Library("deepinv", "deepinv", noise=noisy, default_blur=moved, still=noisy)
