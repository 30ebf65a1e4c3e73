"""Trajectories from the text of an option: a shake, a vibration, or a file."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from blurnoise._core.checks import in_range, limited, shown
from blurnoise._core.files import read_text
from blurnoise.camera import Camera
from blurnoise.motion.trajectory import Trajectory, from_text, path_duration_s, shake

_NUMBERS = {"shake": (1,), "sine": (2, 3)}


@dataclass(frozen=True)
class TrajectorySpec:
    """A trajectory from the text of an option, with the content of its file. Raises ``ValueError``."""

    text: str
    content: str | None = None

    def __post_init__(self) -> None:
        if self.content is not None:
            from_text(self.content, self.text, focal_px=1.0)
            return
        kind, numbers = self._parts
        if len(numbers) not in _NUMBERS.get(kind, ()):
            must = "must be FILE.csv, shake:PX or sine:PX,HZ[,DEG], such as sine:3,80"
            raise ValueError(f"trajectory = {shown(self.text)}: {must}")
        in_range(f"trajectory = {self.text!r}: px", numbers[0], 0.0, 1e4)
        if len(numbers) > 1:
            limited(f"trajectory = {self.text!r}: frequency", numbers[1], "frequency_hz")

    @classmethod
    def parse(cls, text: str) -> TrajectorySpec:
        """Of an option's text; a file is read now. Raises ``ValueError`` or ``OSError``."""
        if text.partition(":")[0] in _NUMBERS or not text or Path(text).is_dir():
            return cls(text)
        try:
            return cls(text, read_text(Path(text)))
        except ValueError as error:
            raise ValueError(f"trajectory = {error}") from None

    @property
    def _parts(self) -> tuple[str, list[float]]:
        kind, _, numbers = self.text.partition(":")
        try:
            return kind, [float(part) for part in numbers.split(",")]
        except ValueError:
            return kind, []

    @property
    def identity(self) -> str:
        """Equal for equal trajectories: of a file its name without folders, and a digest of its content."""
        if self.content is None:
            return self.text
        digest = hashlib.blake2b(self.content.encode("utf-8", "backslashreplace"), digest_size=8).hexdigest()
        return f"{Path(self.text).name} {digest}"

    def of(self, camera: Camera, size: tuple[int, int], exposure_s: float, seed: int) -> Trajectory:
        """For pictures (H, W), a seed, and exposures up to ``exposure_s``, to which the extent of a shake refers."""
        if self.content is not None:
            focal_px = camera.field.focal_px[0] * camera.field.per_sensor_px(size)
            return from_text(self.content, self.text, focal_px=focal_px)
        kind, (extent_px, *numbers) = self._parts
        span_s = path_duration_s(camera, exposure_s)
        if kind == "shake":
            return shake(seed, extent_px, exposure_s, duration_s=span_s)
        return Trajectory.sinusoid(extent_px, numbers[0], span_s, direction_deg=[*numbers, 0.0][1])
