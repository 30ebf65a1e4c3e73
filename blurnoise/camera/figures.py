"""Figures of the camera that light effects and sensor stages depend on, as pages show them."""

from typing import NamedTuple


class CameraFigure(NamedTuple):
    """A number that an effect or a stage lists in its ``figures``.

    name: the field of :class:`~blurnoise.camera.camera.Camera`; ``LIMITS`` has its range. unit: the field's. span:
    usual values, in this unit, from where to where a slider goes.
    """

    name: str
    title: str
    unit: str
    span: tuple[float, float]


FIGURES: tuple[CameraFigure, ...] = (
    CameraFigure("diffraction_wavelength_um", "Diffraction at", "µm", (0.0, 1.0)),
    CameraFigure("row_time_s", "Rolling shutter", "s", (0.0, 100e-6)),
    CameraFigure("prnu", "PRNU", "", (0.0, 0.05)),
    CameraFigure("prnu_row", "PRNU of rows", "", (0.0, 0.05)),
    CameraFigure("prnu_column", "PRNU of columns", "", (0.0, 0.05)),
    CameraFigure("dark_current_e_s", "Dark current", "e-/s", (0.0, 1000.0)),
    CameraFigure("read_noise_e", "Read noise", "e-", (0.0, 50.0)),
    CameraFigure("row_noise_e", "Row noise", "e-", (0.0, 50.0)),
    CameraFigure("column_noise_e", "Column noise", "e-", (0.0, 50.0)),
    CameraFigure("dsnu_e", "DSNU", "e-", (0.0, 50.0)),
    CameraFigure("dsnu_row_e", "DSNU of rows", "e-", (0.0, 50.0)),
    CameraFigure("dsnu_column_e", "DSNU of columns", "e-", (0.0, 50.0)),
    CameraFigure("black_level_drift_dn", "Black level drift", "DN", (0.0, 50.0)),
)
"""All of them that are no axes of sweeps, which have title, unit and span in the table of axes."""
