"""A device "card" of PyTorch whose tensors lie in main memory and obey a real accelerator's rules.

They mix with tensors of no other device (but for numbers and indices), and NumPy and OpenCV do not see them. So code
that makes a constant on the CPU fails here as it would on CUDA, and what it computes can be compared.

Run as a script: for each of some calls, the device of its result, how far that is from the CPU's, and how often the
call waited for values of the card, as JSON.
"""

from __future__ import annotations

import json
from collections.abc import Callable

import torch
from torch.utils import _pytree as tree
from torch.utils.backend_registration import _setup_privateuseone_for_python_backend

import blurnoise
from blurnoise import RandomExposure
from blurnoise._core import rng
from blurnoise.camera.camera import PRESETS, Camera

# As on CUDA: copies cross, an index may stay behind, and a number is pulled to the host.
CROSSES = {"aten::_to_copy", "aten::copy_", "aten::_local_scalar_dense", "aten::index", "aten::index_put_"}


class Card(torch.Tensor):
    """A tensor on the card; ``raw`` has its values."""

    @staticmethod
    def __new__(cls, raw):
        return torch.Tensor._make_wrapper_subclass(
            cls,
            raw.shape,
            strides=raw.stride(),
            storage_offset=raw.storage_offset(),
            dtype=raw.dtype,
            device="card:0",
        )

    def __init__(self, raw):
        self.raw = raw

    # What PyTorch does not hand on to a device of Python's.

    def new_tensor(self, values, dtype=None):
        return Card(torch.tensor(values, dtype=dtype or self.dtype))

    def __getitem__(self, at):
        return super().__getitem__(torch.tensor(at) if isinstance(at, list) else at)

    def __setitem__(self, at, values):
        self.raw[at] = values.raw if isinstance(values, Card) else values

    def untyped_storage(self):
        return self.raw.untyped_storage()

    def tolist(self):
        return self.cpu().tolist()

    @classmethod
    def __torch_dispatch__(cls, op, types, args=(), kwargs=None):
        return compute(op, *args, **(kwargs or {}))


waits = [0]
"""How often values were pulled from the card so far."""


def leaves(device, cards):
    """Whether a copy to this device leaves the card."""
    return bool(cards) and device is not None and torch.device(device).type != "card"


def compute(op, *args, **kwargs):
    """An operation on the card's tensors, by the CPU."""
    given, name = tree.tree_leaves((args, kwargs)), op._schema.name
    cards = [each for each in given if isinstance(each, Card)]
    others = [
        each for each in given if isinstance(each, torch.Tensor) and each.dim() and not isinstance(each, Card)
    ]
    if cards and others and name not in CROSSES:
        raise RuntimeError(f"{name}: expected all tensors on one device, found card:0 and cpu")
    device, known = kwargs.get("device"), {id(card.raw): card for card in cards}
    waits[0] += name == "aten::_local_scalar_dense" or (name == "aten::_to_copy" and leaves(device, cards))

    def below(each):
        if isinstance(each, torch.device) and each.type == "card":
            return torch.device("cpu")
        return each.raw if isinstance(each, Card) else each

    def above(each):
        if not isinstance(each, torch.Tensor) or (device is not None and torch.device(device).type != "card"):
            return each
        return known[id(each)] if id(each) in known else Card(each)

    args_below, kwargs_below = tree.tree_map(below, (args, kwargs))
    found = op(*args_below, **kwargs_below)
    if name == "aten::copy_":
        return args[0]
    return found if name == "aten::_local_scalar_dense" else tree.tree_map(above, found)


PICTURES = torch.rand(2, 3, 32, 32, generator=torch.Generator().manual_seed(1))
MOVED = {"exposure_s": 0.005, "illuminance_lux": 50.0, "velocity_px_s": (900.0, 0.0), "generator": [1, 2]}
Put = Callable[[torch.Tensor], torch.Tensor]
CALLS: dict[str, Callable[[Put], torch.Tensor]] = {
    "motion_blur": lambda put: blurnoise.motion_blur(put(PICTURES), put(torch.tensor([[9.0, 3.0], [0.0, 0.0]]))),
    "numbers on the device": lambda put: blurnoise.simulate(
        put(PICTURES), Camera.preset("imx250c"), exposure_s=put(torch.tensor([0.005, 0.01])),
        illuminance_lux=put(torch.tensor([5.0, 50.0])), generator=[1, 2],
    ),
    "headlamps": lambda put: blurnoise.simulate(
        put(PICTURES), Camera.preset("imx250c"), headlamp_lux=put(torch.full((2, 1, 32, 32), 3.0)), **MOVED
    ),
    "RandomExposure": lambda put: torch.manual_seed(3) and RandomExposure(
        exposure_s=(0.001, 0.06), illuminance_lux=(5.0, 500.0), speed_px_s=(0.0, 1000.0), p=0.5
    )(put(PICTURES)),
}  # fmt: skip


def of_preset(name: str) -> Callable[[Put], torch.Tensor]:
    """Digital numbers, and of one capture also what they are developed to, in thousandths."""
    camera = Camera.preset(name)
    pictures = PICTURES[:, :1] if name.endswith("m") else PICTURES

    def call(put):
        dn = blurnoise.simulate(put(pictures), camera, **MOVED)
        if len(camera.sensor.captures) > 1:
            return dn
        # of the same numbers: a difference of one in the dark is many thousandths
        picture = blurnoise.develop(put(blurnoise.simulate(pictures, camera, **MOVED)), camera)
        return torch.cat([dn.flatten(), 1e3 * picture.flatten()])

    return call


def main() -> None:
    """Print the results of all calls."""
    _setup_privateuseone_for_python_backend("card")
    library = torch.library.Library("_", "IMPL")
    library.fallback(lambda op, *args, **kwargs: compute(op, *args, **kwargs), "PrivateUse1")
    of_device = rng._generator
    rng._generator = lambda seed, stream, device: of_device(seed, stream, torch.device("cpu"))
    results = {}
    for name, call in {**CALLS, **{preset: of_preset(preset) for preset in PRESETS}}.items():
        try:
            here, before = call(lambda tensor: tensor), waits[0]
            there = call(lambda tensor: tensor.to("card"))
            waited = waits[0] - before
            differs = float((there.cpu() - here).abs().max())
            results[name] = {"device": there.device.type, "differs": differs, "waited": waited}
        except Exception as error:
            results[name] = {"error": f"{type(error).__name__}: {error}"}
    print(json.dumps(results))


if __name__ == "__main__":
    main()
