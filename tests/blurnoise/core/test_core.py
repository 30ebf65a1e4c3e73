"""Seeds and draws, threads, documents and files, and fields checked against their annotations."""

import math
import os
import subprocess
import sys
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pytest
import torch
from annotated_types import Ge, Le, Len
from blurnoise_eval.plan.trajectory_spec import TrajectorySpec

from blurnoise._core import rng
from blurnoise._core.checks import shown
from blurnoise._core.fields import Characters, Figure, Text, check_fields
from blurnoise._core.files import read_document, read_samples
from blurnoise._core.threads import side_by_side


def test_generator_gives_one_seed_per_item():
    first = rng.item_seeds(torch.Generator().manual_seed(9), 4)
    assert len(set(first)) == 4
    assert first[:2] == rng.item_seeds(torch.Generator().manual_seed(9), 2)
    for given in ([3, 4], torch.tensor([3, 4]), [np.uint8(3), np.int64(4)]):
        assert rng.item_seeds(given, 2) == [3, 4]
    for bad in ([1, 2, 3], 1, [0.5, 1.0], ["a", "b"], [-1, 2], [True, 1], [2**63, 1], 10**5000, {}):
        with pytest.raises((TypeError, ValueError), match=r"generator|one per item") as error:
            rng.item_seeds(bad, 2)
        assert len(str(error.value)) < 250


def test_normal_and_counts_of_a_seed_are_apart():
    """Of n = 240 000: mean, variance and correlation within 5 standard errors."""
    like = torch.empty(1, 1, 400, 600)
    normal, counts = (
        rng.standard_normal([4], like).flatten(),
        rng.poisson(torch.full_like(like, 12.0), [4]).flatten(),
    )
    assert float(normal.mean()) == pytest.approx(0, abs=5 / 240_000**0.5)
    assert float(normal.var()) == pytest.approx(1, abs=5 * (2 / 240_000) ** 0.5)
    assert float(counts.mean()) == pytest.approx(12, abs=5 * (12 / 240_000) ** 0.5)
    assert abs(float(torch.corrcoef(torch.stack([counts, normal]))[0, 1])) < 5 / 240_000**0.5


@pytest.mark.parametrize(
    ("mean", "distance"), [(0.0, 0.0), (0.1, 1e-5), (9.99, 2e-5), (10.0, 0.003), (100.0, 3e-4)]
)
def test_counts_of_a_normal_follow_poissons_law(mean, distance):
    """Equally likely z, a million of them: the counts' frequencies against the probabilities themselves."""
    z = torch.special.ndtri((torch.arange(1_000_000, dtype=torch.float64) + 0.5) / 1_000_000)
    counts = rng.poisson_of_normal(torch.full_like(z, mean), z).long()
    assert float(counts.double().var()) == pytest.approx(mean, rel=1e-4)
    k = torch.arange(int(counts.max()) + 30, dtype=torch.float64)
    chances = torch.exp(k * math.log(mean) - mean - torch.lgamma(k + 1)) if mean else (k == 0).double()
    frequencies = torch.bincount(counts, minlength=len(k)).double() / len(z)
    assert float((frequencies - chances).abs().sum() / 2) <= distance
    if mean:  # a mean 10 % off would be noticed
        wrong = rng.poisson_of_normal(torch.full_like(z, 1.1 * mean), z).long()
        off = torch.bincount(wrong, minlength=len(k)).double()[: len(k)] / len(z)
        assert float((off - chances).abs().sum() / 2) > 3 * distance


def test_jobs_do_run_side_by_side():
    """Two jobs that wait for each other end only if both run at once."""
    meeting = threading.Barrier(2, timeout=20)
    side_by_side(lambda _: meeting.wait(), range(2), 2)


def test_a_jobs_jobs_run_in_turn():
    done: list[tuple[int, int]] = []
    side_by_side(lambda i: side_by_side(lambda j: done.append((i, j)), range(4), 2), range(4), 2)
    assert sorted(done) == [(i, j) for i in range(4) for j in range(4)]


def test_the_first_error_is_raised_after_all_have_ended():
    done: list[int] = []

    def work(job):
        if job == 1:
            raise ValueError("job 1")
        done.append(job)

    with pytest.raises(ValueError, match="job 1"):
        side_by_side(work, range(6), 2)
    assert sorted(done) == [0, 2, 3, 4, 5]


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")
def test_a_forked_process_has_threads_of_its_own():
    code = (
        "import os\n"
        "from blurnoise._core.threads import side_by_side\n"
        "side_by_side(lambda job: None, range(4), 2)\n"
        "if os.fork() == 0:\n"
        "    side_by_side(lambda job: None, range(4), 2)\n"
        "    os._exit(7)\n"
        "print(os.waitstatus_to_exitcode(os.wait()[1]))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.strip() == "7"


@pytest.mark.parametrize(
    ("name", "text", "fault"),
    [
        pytest.param("a.yaml", "[" * 100_000, "nested too deeply", marks=pytest.mark.slow),
        ("a.yaml", "a: " * 100_000, "mapping values are not allowed here"),
        ("a.yaml", "a: " + "1" * 5000, "integer string conversion"),
        ("a.yaml", "a: &own [1, {b: *own}]", "own: must not stand within &own"),
        ("a.yaml", "&own {<<: *own}", "own: must not stand within &own"),
        ("a.yaml", "x" * (1 << 20) + "x", "larger than 1048576 bytes"),
        ("a.json", '{"a": ' * 100_000, "nested too deeply"),
        ("a.json", "1" * 5000, "integer string conversion"),
    ],
)
def test_hostile_documents_are_refused_in_a_line(tmp_path, name, text, fault):
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=fault) as caught:
        read_document(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


def test_values_are_shown_short_whatever_they_hold():
    bomb: list[object] = ["ha"]
    for _ in range(40):
        bomb = [bomb] * 9
    itself: list[object] = []
    itself.append(itself)
    for value in (bomb, itself, "x" * 10**6, 10**400, {"a": bomb}, ["\n" * 50] * 50):
        text = shown(value)
        assert "\n" not in text
        assert len(text) <= 120
    assert [shown(value) for value in ("1e4", [1], -1.0, None)] == ["'1e4'", "[1]", "-1.0", "None"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="has no pipes")
def test_pipes_devices_and_other_bytes_are_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    ways = (
        read_document,
        lambda path: read_samples(path, 1, "nm"),
        lambda path: TrajectorySpec.parse(str(path)),
    )
    for read in ways:
        for path in (tmp_path / "pipe", Path("/dev/zero")):
            with pytest.raises(OSError, match="device or pipe"):
                read(path)
    (tmp_path / "a.csv").write_bytes(b"1,2\n\xff")
    with pytest.raises(ValueError, match=r"a\.csv: not UTF-8 text \(byte 4\)"):
        TrajectorySpec.parse(str(tmp_path / "a.csv"))


@dataclass(frozen=True)
class Record:
    name: Text = "a"
    share: Annotated[float, Ge(0), Le(1)] = 0.5
    level: Annotated[Figure, Ge(0)] = 0.0
    count: Annotated[int, Ge(1)] = 1
    on: bool = False
    colour: Literal["rgb", "bgr"] = "rgb"
    pair: Annotated[tuple[float, float] | None, "must be two numbers"] = None
    names: Annotated[tuple[Characters, ...], Len(1)] = ("x",)
    shares: tuple[Annotated[float, Ge(0), Le(1)], ...] = ()
    records: tuple["Record", ...] = ()
    notes: Mapping[str, Text] = field(default_factory=dict)

    def __post_init__(self):
        check_fields(self)


def test_lists_and_numpys_numbers_become_plain():
    record = Record(share=np.float32(0.5), count=np.int64(3), level=2, pair=[1, np.float64(2)], names=["a"])  # type: ignore[arg-type]
    assert (record.share, record.count, record.level) == (0.5, 3, 2.0)
    assert [type(value) for value in (record.share, record.count, record.level)] == [float, int, float]
    assert (record.pair, record.names) == ((1.0, 2.0), ("a",))
    assert {type(value) for value in record.pair or ()} == {float}


RANGE = "must be finite and >= 0 and <= 1"


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        ({"name": 3}, TypeError, "name = 3: must be text"),
        ({"name": "\ud800"}, ValueError, r"name = '\ud800': must be text, without halves of characters"),
        ({"share": float("nan")}, ValueError, f"share = nan: {RANGE}"),
        ({"share": 10**400}, ValueError, f"share = 1{'0' * 17}...{'0' * 19}: {RANGE}"),
        ({"count": True}, TypeError, "count = True: must be an integer"),
        ({"on": 1}, TypeError, "on = 1: must be true or false"),
        ({"colour": ["rgb"]}, ValueError, "colour = ['rgb']: must be one of 'rgb', 'bgr'"),
        ({"pair": [1, "x"]}, TypeError, "pair = [1, 'x']: must be two numbers"),
        ({"names": []}, ValueError, "names = []: must not be empty"),
        ({"names": ["a", 5]}, TypeError, "names = 5: must be text"),
        ({"records": (0.1,)}, TypeError, "records = 0.1: must be a Record"),
        ({"notes": {"a": 5}}, TypeError, "notes.a = 5: must be text"),
        ({"notes": {7: "x"}}, TypeError, "notes.7 = 7: must be text"),
    ],
)  # fmt: skip
def test_faults_are_one_line(change, kind, message):
    with pytest.raises((TypeError, ValueError)) as caught:
        Record(**change)
    assert issubclass(caught.type, kind)
    assert str(caught.value) == message
