"""Blur by paths: against brute force, the full grid and straight motion; in the chain, picture by picture."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
import torch
from blurs import optical_blur
from brute_force import accelerated_path, exposed, photograph, rms_dn
from path_oracle import polyline_grid, straight_path

from blurnoise import Camera, ExposedScene, Exposure, Trajectory, plan, simulate
from blurnoise.blur import convolution, fourier
from blurnoise.blur.convolution import path_blur
from blurnoise.blur.path_otf import spread_in
from blurnoise.motion.trajectory import Polyline, shake
from blurnoise.optics.transfer import Optics

CAMERA = Camera.preset("imx250")
VIBRATION = Trajectory.sinusoid(4.0, 80.0, 0.05, direction_deg=30.0, phase_rad=0.5)
START = accelerated_path((300.0, 100.0), (4e4, 1e4), 0.05)
SHAKE = shake(3, 12.0, 0.01, duration_s=0.05)


def picture(height: int = 61, width: int = 95, channels: int = 1) -> torch.Tensor:
    return torch.from_numpy(photograph(height, width, channels=channels))


@pytest.mark.parametrize("path", [VIBRATION, START, SHAKE], ids=["vibration", "start", "shake"])
def test_brute_force(path: Trajectory) -> None:
    """256 Lanczos sub-exposures; 0.08 DN apart near half a cycle per px, where a path is led into its alias."""
    light = picture()
    origin = path.origin_px(0.01)

    def places(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x, y = (np.interp(times, path.time_s, along) for along in (path.x_px, path.y_px))
        return x - origin[0], y - origin[1]

    brute = exposed(light.numpy(), places, 0.01, 256)
    blurred = path_blur(light, path.seen(0.01), border="circular").numpy()
    assert rms_dn(blurred, brute) < 0.1
    assert rms_dn(light.numpy(), brute) > 2.0
    reverse = path_blur(light, turned(path.seen(0.01)), border="circular").numpy()
    assert rms_dn(reverse, brute) > (0.5 if path is START else 0.1)


def turned(path: Polyline) -> Polyline:
    return Polyline(tuple(-x for x in path.x_px), tuple(-y for y in path.y_px), path.shares)


@pytest.mark.parametrize("border", ["reflect", "replicate", "circular", "constant"])
@pytest.mark.parametrize("moved", [(9.0, -5.0), (5.0, 0.0), (0.0, 3.0), (90.0, 20.0)])
def test_two_knots_are_straight_motion(border: Any, moved: tuple[float, float]) -> None:
    """To what a small grid leaves out: 1e-4 RMS of white noise."""
    light = torch.rand(1, 2, 61, 95, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    x, y = moved
    seen = straight_path((100 * x, 100 * y), 0.01).seen(0.01)
    straight = convolution.motion_blur(light, moved, method="transfer", border=border)
    off = path_blur(light, seen, border=border) - straight
    assert float(off.square().mean().sqrt()) < 1e-4
    knots = torch.tensor([[-x / 2, -y / 2], [x / 2, y / 2]], dtype=torch.float64)
    torch.testing.assert_close(path_blur(light, knots, border=border), path_blur(light, seen, border=border))
    torch.testing.assert_close(
        path_blur(light.float(), seen, border=border).double(),
        path_blur(light, seen, border=border),
        rtol=0,
        atol=2e-6,
    )


@pytest.mark.parametrize(("side", "error"), [(32, 8e-4), (48, 2.7e-4), (64, 1.4e-4), (96, 5e-5)])
def test_small_grids(side: int, error: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half the RMS of what a grid of ``side`` changes of the transfer function, of shakes of 20 px; without the
    lead into the alias 1e-2."""
    monkeypatch.setattr(fourier, "fast_length", lambda length: side)

    def along(knots: Any, shares: Any, fx: Any, fy: Any) -> Any:
        return polyline_grid(fx, fy, knots, shares)

    def off() -> float:
        squares = []
        for seed in range(4):
            path = shake(seed, 20.0, 0.01).seen(0.01)
            knots, shares, large = path.knots, np.array(path.shares), (160, 160)
            knots = knots - (knots.max(1) + knots.min(1))[:, None] / 2  # as much to either side
            fy, fx = fourier.frequencies(large)
            full = fourier.joined(partial(along, knots, shares), fx, fy, large)
            tile = spread_in(large, torch.from_numpy(knots), torch.from_numpy(shares))
            squares.append((np.abs(np.fft.rfft2(tile.numpy()) - full) ** 2).mean())
        return float(np.sqrt(np.mean(squares))) / 2

    assert off() < 1.5 * error
    monkeypatch.setattr(fourier, "joined", lambda motion, fx, fy, lengths: motion(fx, fy))
    assert off() > 3e-3


def test_lens_shares_the_transform() -> None:
    light, optics = picture(), Optics(defocus_radius_px=1.5, diffraction_lambda_n_px=0.6)
    seen = SHAKE.seen(0.01)
    twice = optical_blur(path_blur(light, seen, border="circular"), optics, border="circular")
    torch.testing.assert_close(path_blur(light, seen, optics, border="circular"), twice, rtol=0, atol=1e-9)


def test_path_of_no_duration_is_at_rest() -> None:
    light, optics = picture(), Optics(defocus_radius_px=1.5)
    seen = path_blur(light, SHAKE.seen(0.0), optics)
    torch.testing.assert_close(seen, optical_blur(light, optics), rtol=0, atol=1e-9)


def test_too_short_to_be_seen_and_too_large_to_hold() -> None:
    light = picture()
    assert path_blur(light, straight_path((0.5, 0.0), 0.1).seen(0.01)) is light
    far = Trajectory((-1.0, 1.0), (0.0, 9e4), (0.0, 9e4)).seen(2.0)
    with pytest.raises(ValueError, match=r"path over .* border 'replicate' needs a plane"):
        path_blur(light, far, border="replicate")


def test_paths_much_longer_than_the_picture() -> None:
    """They are summed on its own period, not on a grid as large as they are."""
    light = torch.rand(1, 3, 48, 64, generator=torch.Generator().manual_seed(1))
    path = shake(0, 5000.0, 0.01).seen(0.01)
    seen = path_blur(light, path)
    whole = torch.from_numpy(np.pad(light.numpy(), ((0, 0), (0, 0), (0, 46), (0, 62)), mode="reflect"))
    fy, fx = fourier.frequencies((94, 126))
    response = fourier.joined(
        lambda fx, fy: polyline_grid(fx, fy, path.knots, np.array(path.shares)), fx, fy, (94, 126)
    )
    expected = np.fft.irfft2(np.fft.rfft2(whole.numpy()) * response, s=(94, 126))[..., :48, :64]
    np.testing.assert_allclose(seen.numpy(), expected, atol=1e-5)


def test_gradients_of_picture_and_knots() -> None:
    light = picture(13, 17).requires_grad_()
    knots = torch.tensor([[-1.5, 0.4], [0.3, -1.0], [1.8, 0.9]], dtype=torch.float64, requires_grad=True)
    weights = torch.rand(1, 1, 13, 17, dtype=torch.float64, generator=torch.Generator().manual_seed(2))

    def seen(light: torch.Tensor, knots: torch.Tensor) -> torch.Tensor:
        return (path_blur(light, knots) * weights).sum()

    assert torch.autograd.gradcheck(seen, (light, knots), fast_mode=True)
    (of_knots,) = torch.autograd.grad(seen(light, knots), knots)
    assert float(of_knots.abs().min()) > 1e-6


def test_every_picture_has_its_own_and_depends_on_no_other() -> None:
    """Bits of a batch are those one by one, with a lens too; where there is no path those of straight motion."""
    light = torch.rand(3, 3, 41, 67, generator=torch.Generator().manual_seed(3))
    paths = [VIBRATION, SHAKE, None]
    taken: dict[str, Any] = {
        "exposure_s": [0.01, 0.02, 0.004],
        "velocity_px_s": [(100.0, 0.0), (50.0, 50.0), (900.0, -300.0)],
        "generator": [1, 2, 3],
    }
    camera = Camera.from_dict({"base": "imx250", "name": "soft", "defocus_radius_px": 1.2})
    for taker in (CAMERA, camera):
        together = simulate(light, taker, illuminance_lux=100.0, trajectory=paths, **taken)
        straight = simulate(light, taker, illuminance_lux=100.0, **taken)
        assert torch.equal(together[2], straight[2])
        assert not torch.equal(together[0], straight[0])
        for item, path in enumerate(paths):
            own = {name: value[item : item + 1] for name, value in taken.items()}
            alone = simulate(light[item : item + 1], taker, illuminance_lux=100.0, trajectory=path, **own)
            assert torch.equal(together[item : item + 1], alone)


def test_frames_of_8_and_16_bits_are_what_simulate_develops() -> None:
    """A sweep's frames and simulate's, of one path; pictures of 16 bits differ from those of 8 by their rounding."""
    codes = (photograph(41, 67, channels=3)[0].transpose(1, 2, 0) * 65535).round().astype(np.uint16)
    exposures = [Exposure(CAMERA, 0.01, 100.0, trajectory=path, seed=4) for path in (VIBRATION, None, SHAKE)]
    frames = {}
    for depth, stored in ((16, codes), (8, (codes / 257).round().astype(np.uint8))):
        scene = ExposedScene.of_picture(stored)
        frames[depth] = [frame.picture for frame in scene.frames(exposures)]
        light = torch.from_numpy((stored / np.iinfo(stored.dtype).max).astype(np.float32))
        dn = simulate(
            light.permute(2, 0, 1)[None].contiguous(),
            CAMERA,
            exposure_s=0.01,
            illuminance_lux=100.0,
            trajectory=VIBRATION,
            generator=[4],
        )
        from blurnoise import develop

        seen = develop(dn, CAMERA)[0].permute(1, 2, 0).numpy() * 255
        assert np.abs(seen - frames[depth][0]).max() <= 1.0  # 8-bit rounding
    assert 0 < np.abs(frames[8][0].astype(float) - frames[16][0]).mean() < 1.0
    assert np.abs(frames[8][0].astype(float) - frames[8][1]).mean() > 3.0


def test_plan_names_the_path_and_leaves_out_what_is_short() -> None:
    lit = {"exposure_s": 0.01, "illuminance_lux": 100.0}
    told = {stage.name: stage for stage in plan(CAMERA, trajectory=VIBRATION, **lit).stages}["motion"]
    assert told.kept
    assert "segments over 6.92x3.99 px" in told.how
    short = Trajectory.sinusoid(0.01, 80.0, 0.05)
    assert "motion" in plan(CAMERA, trajectory=short, **lit).without
    assert "motion" not in plan(CAMERA, trajectory=short, displacement_px=(5.0, 0.0), **lit).without


def test_boxes_stay_and_sweep_what_the_path_covers() -> None:
    box = torch.tensor([[10.0, 12.0, 20.0, 25.0]])
    taken = Exposure(CAMERA, 0.01, 100.0, trajectory=VIBRATION)
    assert torch.equal(taken.move_boxes(box), box)
    left, top, right, bottom = VIBRATION.seen(0.01).box
    torch.testing.assert_close(taken.sweep_boxes(box), box + torch.tensor([left, top, right, bottom]))
    assert right - left > 6
    still = Exposure(CAMERA, 0.01, 100.0, velocity_px_s=(800.0, 0.0))
    torch.testing.assert_close(still.sweep_boxes(box), box + torch.tensor([-4.0, 0.0, 4.0, 0.0]))


@pytest.mark.parametrize(
    ("trajectory", "error", "words"),
    [
        ("left", TypeError, "trajectory = .left.: must be a blurnoise.Trajectory"),
        (3, TypeError, "trajectory = 3: must be a blurnoise.Trajectory"),
        ([None], ValueError, "trajectory: got 1 for a batch of 2"),
        (straight_path((1.0, 0.0), 0.001), ValueError, "must hold the exposure, -0.005 to 0.005 s"),
    ],
)
def test_what_is_no_trajectory(trajectory: Any, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        simulate(
            torch.rand(2, 1, 5, 7), CAMERA, exposure_s=0.01, illuminance_lux=100.0, trajectory=trajectory
        )
