"""The camera: lens, sensor and development, presets and files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from blurnoise._core.checks import LIMITS, in_range, known, shown
from blurnoise._core.fields import Text, check_fields
from blurnoise._core.writing import writing
from blurnoise.camera import camera_files, colour
from blurnoise.camera.camera_files import KEYS, RECORD_OF
from blurnoise.camera.isp import Isp
from blurnoise.camera.lens import Field, Lens, farthest_px
from blurnoise.camera.sensor import Sensor
from blurnoise.camera.transfer import Optics


@dataclass(frozen=True)
class Camera:
    """A camera: a lens before a sensor, and the development of its pictures.

    Its figures have one flat set of names, in files, in :meth:`with_figures` and in messages: those of the three
    records' fields. sources: name of a figure in files -> where it comes from. Raises ``ValueError`` or
    ``TypeError`` naming the figure.

    >>> from blurnoise import Camera
    >>> camera = Camera.preset("imx250")
    >>> camera.sensor.pixel_pitch_um, camera.sensor.full_well_e, camera.lens.f_number  # um, electrons
    (3.45, 10715.0, 1.4)
    """

    name: Text
    lens: Annotated[Lens, "must be a Lens"]
    sensor: Annotated[Sensor, "must be a Sensor"]
    isp: Annotated[Isp, "must be an Isp"] = field(default_factory=Isp)
    sources: Mapping[str, Text] = field(default_factory=dict, compare=False, repr=False)

    def __post_init__(self) -> None:
        check_fields(self)
        colour.check_balance(self.sensor.cfa, self.isp.white_balance, self.isp.ccm)
        for name in sorted(self.sources.keys() - {*KEYS}):
            known("sources: field", name, KEYS)
        _ = self.optics  # checks the blur in pixels, which lens and pitch give together
        if self.lens.displaces:
            farthest_px(self.field)  # raises unless the distortion is one to one on this sensor

    def __hash__(self) -> int:
        """Hash of the figures in which cameras mostly differ: caches look cameras up several times a frame."""
        return self._hash

    @cached_property
    def _hash(self) -> int:
        # Not of all figures: hashing curves takes longer than a rare comparison of cameras that differ elsewhere.
        # Not of the name: a process that loads a pickled camera would hash the text differently.
        lens = self.lens
        return hash((lens.f_number, lens.defocus_radius_px, lens.diffraction_wavelength_um, self.sensor))

    @cached_property
    def optics(self) -> Optics:
        """The lens's blur that acts through its transfer function."""
        # Lenses have lengths on the sensor, transfer functions are per pixel: the pitch is between them.
        lens, pitch_um = self.lens, self.sensor.pixel_pitch_um
        return Optics(
            defocus_radius_px=lens.defocus_radius_px,
            diffraction_lambda_n_px=lens.diffraction_wavelength_um * lens.f_number / pitch_um,
            measured=lens.mtf.per_px(pitch_um) if lens.mtf else None,
        )

    @cached_property
    def field(self) -> Field:
        """The lens's field on the sensor."""
        lens, sensor = self.lens, self.sensor
        return Field(
            sensor.width_px,
            sensor.height_px,
            lens.hfov_deg,
            sensor.pixel_pitch_um,
            lens.field_curvature_px,
            lens.lateral_red,
            lens.lateral_blue,
            lens.falloff_power,
            lens.relative_illumination,
            lens.distortion,
        )

    def figure(self, name: str) -> Any:
        """The value of a field of the lens, the sensor or the ISP. Raises ``KeyError`` for another name.

        >>> Camera.preset("imx250").figure("full_well_e")
        10715.0
        """
        return getattr(getattr(self, RECORD_OF[name]), name)

    def with_figures(self, **figures: Any) -> Camera:
        """The camera with other figures, by the names of the records' fields; ``name`` and ``sources``, too.

        A measured ``t_number`` follows the f-number, see :meth:`Lens.changed`.

        >>> from blurnoise import Camera
        >>> faster = Camera.preset("imx250").with_figures(f_number=1.4, read_noise_e=1.0)
        >>> faster.lens.f_number, faster.sensor.read_noise_e
        (1.4, 1.0)
        """
        parts: dict[str, dict[str, Any]] = {"": {}}
        for name, value in figures.items():
            if name not in ("name", "sources"):
                known("figure", name, RECORD_OF)
            parts.setdefault(RECORD_OF.get(name, ""), {})[name] = value
        records: dict[str, Any] = {
            record: self.lens.changed(**own) if record == "lens" else replace(getattr(self, record), **own)
            for record, own in parts.items()
            if record
        }
        return replace(self, **records, **parts[""])

    def at_gain(self, gain_db: float) -> Amplified:
        """The camera at an analogue gain up to ``analogue_gain_max_db``, and the remaining digital gain.

        :meth:`Sensor.amplified` and :meth:`Isp.at_gain` say how its figures follow. Raises ``ValueError`` beyond
        ``gain_max_db``.

        >>> camera, digital_db = Camera.preset("imx250").at_gain(30.0)
        >>> round(camera.sensor.system_gain_dn_per_e, 2), digital_db
        (5.7, 6.0)
        """
        in_range("gain_db", gain_db, LIMITS["gain_db"].low, self.sensor.gain_max_db)
        return _at_gain(self, float(gain_db))

    @classmethod
    def preset(cls, name: str) -> Camera:
        """A camera of ``PRESETS`` by name. Raises ``ValueError`` that lists the names for an unknown one."""
        known("camera", name, sorted(PRESETS))
        return PRESETS[name]

    @classmethod
    def from_dict(
        cls, values: Mapping[str, Any], *, source: str = "given", folder: str | Path = "."
    ) -> Camera:
        """The camera of ``values`` as :meth:`to_dict` gives them; ``base`` names a preset for missing values.

        source: for figures without one in ``values["sources"]``. folder: base of relative paths of tables. Raises
        ``TypeError`` or ``ValueError`` naming the field, its value and what is allowed.

        >>> mine = Camera.from_dict({"name": "mine", "base": "imx250", "read_noise_e": 3.1})
        >>> mine.sensor.read_noise_e, mine.sources["read_noise_e"]
        (3.1, 'given')
        """
        return cls(**camera_files.completed(values, PRESETS, source, Path(folder)))

    @classmethod
    def load(cls, path: str | Path) -> Camera:
        """Load a camera from a .json, .yaml or .yml file; without ``name`` it is named after the file.

        Raises ``TypeError`` or ``ValueError`` naming the file and the invalid field, ``OSError``.
        """
        if not isinstance(path, (str, PathLike)):
            raise TypeError(f"path = {shown(path)}: must be a path")
        path = Path(path)
        try:
            values = camera_files.read(path)
            return cls.from_dict(values, source=f"from {path.name}", folder=path.parent)
        except (TypeError, ValueError) as error:
            raise camera_files.within(str(path), error) from None

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Save the camera to a .json, .yaml or .yml file, atomically.

        overwrite: also replace a file that this did not write, or that was changed since. Raises ``ValueError`` or
        ``OSError``.
        """
        with writing(overwrite=overwrite):
            camera_files.write(Path(path), self.to_dict())

    def to_dict(self) -> dict[str, object]:
        """Plain values for JSON, sources included."""
        return dict(camera_files.plain(camera_files.flat(self)))


class Amplified(NamedTuple):
    """A camera with its figures at an analogue gain, and the remaining digital gain, dB.

    >>> Camera.preset("imx250").at_gain(12.0).digital_db  # all of it before the converter
    0.0
    """

    camera: Camera
    digital_db: float


@lru_cache(maxsize=512)
def _at_gain(camera: Camera, gain_db: float) -> Amplified:
    analogue_db = min(max(gain_db, 0.0), camera.sensor.analogue_gain_max_db)
    if analogue_db == 0:
        return Amplified(camera, gain_db)
    sensor, isp = camera.sensor.amplified(analogue_db), camera.isp.at_gain(gain_db)
    return Amplified(replace(camera, sensor=sensor, isp=isp), gain_db - analogue_db)


PRESETS: dict[str, Camera] = {}
for _name in camera_files.PRESETS:
    PRESETS[_name] = Camera.from_dict(camera_files.preset(_name))
