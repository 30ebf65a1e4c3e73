"""Every pair of motions, and all at once, against each pixel's mean over its row's window of what passes it."""

import motion_oracle
import pytest
import torch
from motion_oracle import MOTIONS, Combination


def allowed_dn(of):
    """A flow is one for the whole exposure, which a zoom is not quite; a reset exposes rows 2.6 times as long."""
    return (1.3 if of.reset else 0.6) if "flow" in of.motions else 0.3


@pytest.mark.parametrize(
    "of", motion_oracle.combinations_of(2), ids=lambda of: " and ".join(m for m in MOTIONS if m in of.motions)
)
def test_pairs(of):
    expected = motion_oracle.truth(of, 128)
    assert motion_oracle.error_dn(motion_oracle.found(of, torch.float32), expected) < allowed_dn(of)
    assert motion_oracle.error_dn(motion_oracle.STREET, expected) > 2


@pytest.mark.slow
@pytest.mark.parametrize("readout", ["rolling", "global reset"])
@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
def test_all_at_once(readout, kind):
    """To 2 DN, and far from what each alone left out would be."""
    of = Combination(frozenset({"path", "flow", "objects", readout}))
    expected = motion_oracle.truth(of, 128)
    error_dn = motion_oracle.error_dn(motion_oracle.found(of, kind), expected)
    assert error_dn < 2
    for missing in of.motions:
        without = Combination(of.motions - {missing})
        assert motion_oracle.error_dn(motion_oracle.found(without, kind), expected) > 2 * error_dn


def test_gradients_pass_all_at_once():
    of = Combination(frozenset({"path", "flow", "objects", "rolling"}))
    light = torch.from_numpy(motion_oracle.STREET)[None].requires_grad_()
    motion_oracle.exposed(of, light).square().mean().backward()
    assert light.grad is not None
    assert float(light.grad.abs().max()) > 0
    flow = of.flow().requires_grad_()
    motion_oracle.exposed(of, light.detach(), flow).square().mean().backward()
    assert flow.grad is not None
    assert float(flow.grad.abs().max()) > 0
