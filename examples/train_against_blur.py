"""Train with RandomExposure: a small network that tells stop signs from other things, with and without it.

Both see the same 400 pictures, clean; the second through a camera in another light and motion each time. Judged is
what both make of 200 others, clean, and dark and blurred.
"""

import torch
from torch import Tensor, nn

from blurnoise import AutoExposure, Camera, Exposure, RandomExposure, charts, expose_pictures
from blurnoise.camera.colour import srgb_from_linear

SIDE = 48


def pictures(count: int, seed: int) -> tuple[Tensor, Tensor]:
    """Signs on a noisy ground, or the same in pieces: alike in colour, so that shape has to tell."""
    draw = torch.Generator().manual_seed(seed)
    made, is_sign = [], torch.arange(count) % 2
    for sign in is_sign.tolist():
        size = float(20 + 20 * torch.rand(1, generator=draw))
        light = charts.stop_sign(size, height_px=SIDE, width_px=SIDE)[0]
        if not sign:
            tiles = (
                light.unfold(1, 12, 12).unfold(2, 12, 12).flatten(1, 2)[:, torch.randperm(16, generator=draw)]
            )
            light = tiles.unflatten(1, (4, 4)).permute(0, 1, 3, 2, 4).reshape(3, SIDE, SIDE)
        shift = torch.randint(-4, 5, (2,), generator=draw).tolist()
        made.append(light.roll(shift, (1, 2)) * (0.5 + 0.5 * torch.rand(1, generator=draw)))
    return srgb_from_linear(torch.stack(made)).float(), is_sign.float()


def trained(augment: nn.Module, seen: Tensor, is_sign: Tensor) -> nn.Module:
    """A network after ten rounds through the pictures."""
    torch.manual_seed(0)
    steps = [(3, 16), (16, 32), (32, 32)]
    layers = [nn.Sequential(nn.Conv2d(i, o, 3, 2, 1), nn.BatchNorm2d(o), nn.ReLU()) for i, o in steps]
    network = nn.Sequential(*layers, nn.Flatten(), nn.Linear(32 * 36, 1))
    optimiser = torch.optim.AdamW(network.parameters(), 3e-3)
    for _ in range(10):
        for batch in torch.randperm(len(seen)).split(50):
            loss = nn.functional.binary_cross_entropy_with_logits(
                network(augment(seen[batch]))[:, 0], is_sign[batch]
            )
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
    return network.eval()


train, test = pictures(400, seed=1), pictures(200, seed=2)
dark_and_blurred = Exposure(  # 15 px of blur, and hardly any light
    Camera.preset("imx250"),
    exposure_s=0.02,
    illuminance_lux=0.3,
    velocity_px_s=(750.0, 0.0),
    gain_db=AutoExposure(),
)
hard = expose_pictures(test[0], dark_and_blurred)
expose = RandomExposure(
    exposure_s=(0.002, 0.03), illuminance_lux=(0.2, 100.0), speed_px_s=(0.0, 800.0), gain_db="auto", p=0.7
)
for name, augment in (("clean pictures alone", nn.Identity()), ("RandomExposure", expose)):
    network = trained(augment, *train)
    with torch.no_grad():
        right = [((network(each)[:, 0] > 0) == (test[1] > 0)).float().mean() for each in (test[0], hard)]
    print(
        f"trained on {name}: right in {right[0]:.0%} of clean pictures, {right[1]:.0%} of dark and blurred ones"
    )
