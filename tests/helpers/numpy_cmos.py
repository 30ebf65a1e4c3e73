"""Frames of a CMOS camera by NumPy alone, which knows nothing of the simulator, as files with their frames.csv."""

from dataclasses import dataclass

import numpy as np

TIME_S = 0.02  # exposure that fills the range


@dataclass(frozen=True)
class Cmos:
    """Figures in electrons unless DN is said. row_gain: of independent rows; hot: share of hot pixels.

    sag: share of the range from which the signal bends to it, 1 never. wander_dn: of the black level, by frame.
    least_dn: what is below becomes it.
    """

    bits: int = 12
    gain: float = 0.4
    read: float = 4.0
    row: float = 0.0
    row_gain: float = 0.0
    prnu: float = 0.007
    dsnu: float = 2.0
    dsnu_column: float = 0.0
    hot: float = 0.0
    black_dn: float = 60.0
    sag: float = 1.0
    wander_dn: float = 0.0
    least_dn: float = 0.0
    size: tuple[int, int] = (160, 200)

    @property
    def range_e(self) -> float:
        """Signal at which the converter clips."""
        return (2**self.bits - 1 - self.black_dn) / self.gain


def save(folder, cmos, shares, *, seed=0, frames=2):
    """Two frames of each share of the range, dark and flat. Photons per pixel are twice the electrons."""
    random = np.random.default_rng(seed)
    height, width = cmos.size
    response = 1 + cmos.prnu * random.standard_normal(cmos.size)
    offset = cmos.dsnu * random.standard_normal(cmos.size) + cmos.dsnu_column * random.standard_normal(
        (1, width)
    )
    offset += np.where(random.random(cmos.size) < cmos.hot, random.exponential(200.0, cmos.size), 0.0)
    folder.mkdir(exist_ok=True)
    lines = ["file,kind,exposure_s,photons_per_px"]
    for step, share in enumerate(shares):
        for kind in ("dark", "flat"):
            light = share * response * (kind == "flat")
            beyond = (light - cmos.sag) / max(1 - cmos.sag, 1e-9)
            bent = np.where(beyond > 0, cmos.sag + (1 - cmos.sag) * np.tanh(beyond), light)
            slope = np.where(beyond > 0, 1 / np.cosh(np.clip(beyond, 0, 50)), 1.0)
            for number in range(frames):
                signal = cmos.range_e * bent
                signal = signal + slope * np.sqrt(signal) * random.standard_normal(cmos.size)
                signal *= 1 + cmos.row_gain * random.standard_normal((height, 1))
                noise = cmos.read * random.standard_normal(cmos.size) + cmos.row * random.standard_normal(
                    (height, 1)
                )
                dn = cmos.black_dn + cmos.gain * (signal + noise + offset)
                dn = np.rint(dn + cmos.wander_dn * random.standard_normal()).clip(
                    cmos.least_dn, 2**cmos.bits - 1
                )
                name = f"{kind}_{step}_{number}.npy"
                np.save(folder / name, dn.astype(np.uint8 if cmos.bits == 8 else np.uint16))
                photons = 2 * share * cmos.range_e if kind == "flat" else ""
                lines.append(f"{name},{kind},{TIME_S * share:.6f},{photons}")
    (folder / "frames.csv").write_text("\n".join(lines))
    return folder
