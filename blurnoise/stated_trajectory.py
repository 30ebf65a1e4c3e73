"""A trajectory as options state it: a file's, a hand's shake, a vibration.

``FILE.csv``: places or rates of rotation over time, see :func:`blurnoise.camera_shake.from_csv`. ``shake:PX``: a
hand's, whose longer side is so many px. ``sine:PX,HZ`` and if wished ``,DEG``: amplitude, frequency and direction,
counter-clockwise as displayed.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from blurnoise import camera_shake
from blurnoise._core.checks import in_range, shown
from blurnoise._core.files import read_text
from blurnoise._core.limits import limited
from blurnoise.camera import Camera
from blurnoise.trajectory import Trajectory

_FORMS = "must be FILE.csv, shake:PX or sine:PX,HZ[,DEG], such as sine:3,80"
_KINDS = {"shake": (1,), "sine": (2, 3)}


@dataclass(frozen=True)
class StatedTrajectory:
    """What was stated, and of a file its content, so that it is the same wherever it is used.

    Raises ``ValueError`` for another text; :meth:`parse`, which reads the file, ``OSError`` too.
    """

    text: str
    content: str | None = None

    def __post_init__(self) -> None:
        if self.content is not None:
            camera_shake.from_text(self.content, self.text, focal_px=1.0)
            return
        kind, numbers = self._parts
        if len(numbers) not in _KINDS.get(kind, ()):
            raise ValueError(f"trajectory = {shown(self.text)}: {_FORMS}")
        in_range(f"trajectory = {self.text!r}: px", numbers[0], 0.0, 1e4)
        if len(numbers) > 1:
            limited(f"trajectory = {self.text!r}: frequency", numbers[1], "frequency_hz")

    @classmethod
    def parse(cls, text: str) -> StatedTrajectory:
        """Of an option's text; a file is read now."""
        kind, colon, _ = text.partition(":")
        if colon and kind in _KINDS:
            return cls(text)
        if not text or Path(text).is_dir():
            raise ValueError(f"trajectory = {shown(text)}: {_FORMS}")
        try:
            content = read_text(Path(text))
        except ValueError as error:
            raise ValueError(f"trajectory = {error}") from None
        return cls(text, content)

    @property
    def _parts(self) -> tuple[str, list[float]]:
        kind, _, numbers = self.text.partition(":")
        try:
            return kind, [float(part) for part in numbers.split(",")]
        except ValueError:
            return kind, []

    @property
    def identity(self) -> str:
        """Equal for equal trajectories: of a file its name without folders, and a digest of what it says."""
        if self.content is None:
            return self.text
        digest = hashlib.blake2b(self.content.encode("utf-8", "backslashreplace"), digest_size=8).hexdigest()
        return f"{Path(self.text).name} {digest}"

    def of(self, camera: Camera, size: tuple[int, int], exposure_s: float, seed: int) -> Trajectory:
        """That of pictures (H, W), for exposures up to ``exposure_s``, of which a shake's extent is, and a seed's."""
        if self.content is not None:
            focal_px = camera.field.focal_px[0] * camera.field.per_sensor_px(size)
            return camera_shake.from_text(self.content, self.text, focal_px=focal_px)
        kind, numbers = self._parts
        span_s = camera_shake.path_duration_s(camera, exposure_s)
        if kind == "shake":
            return camera_shake.shake(seed, numbers[0], exposure_s, duration_s=span_s)
        direction_deg = numbers[2] if len(numbers) == 3 else 0.0
        return Trajectory.sinusoid(numbers[0], numbers[1], span_s, direction_deg=direction_deg)
