"""Threads: each of pytest-xdist's processes has one; with more, those of all wait for each other at every loop.

CI's rules: ``--most-cpu-s`` fails a test whose body takes more CPU time, ``--skips FILE`` one that is skipped for a
reason that no line of the file begins, and ``--note-skipped FILE`` writes what was skipped, for a run with more
packages: ``pytest -m "" @FILE``.
"""

import os
from pathlib import Path

import hypothesis
import pytest

hypothesis.settings.register_profile("untimed", deadline=None)  # nothing is said of a busy machine
hypothesis.settings.load_profile("untimed")

if "PYTEST_XDIST_WORKER" in os.environ:  # PyTorch reads it when it is imported
    os.environ.setdefault("OMP_NUM_THREADS", "1")


def pytest_addoption(parser):
    parser.addoption("--most-cpu-s", type=float, help="fail a test whose body takes more CPU seconds")
    parser.addoption(
        "--skips", metavar="FILE", help="fail a test that is skipped for a reason that is not in FILE"
    )
    parser.addoption("--note-skipped", metavar="FILE", help="write the names of skipped tests, a line each")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    before = sum(os.times()[:4])
    yield
    used, most = sum(os.times()[:4]) - before, item.config.getoption("--most-cpu-s")
    if most is not None and used > most:
        pytest.fail(
            f"{used:.2f} s of CPU time, at most {most:g}: make it cheaper, or mark it slow", pytrace=False
        )


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item):
    report = yield
    return _skips_listed(report, item.config)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    report = yield
    return _skips_listed(report, collector.config)


def _skips_listed(report, config):
    listed = config.getoption("--skips")
    if listed is None or not report.skipped or hasattr(report, "wasxfail"):
        return report
    reason = report.longrepr[2].removeprefix("Skipped: ")
    known = [line for line in Path(listed).read_text(encoding="utf-8").splitlines() if line]
    if not any(reason.startswith(each) for each in known):
        report.outcome, report.longrepr = "failed", f"skipped, for a reason that is not in {listed}: {reason}"
    return report


def pytest_terminal_summary(terminalreporter, config):
    if noted := config.getoption("--note-skipped"):
        names = dict.fromkeys(each.nodeid for each in terminalreporter.stats.get("skipped", ()))
        Path(noted).write_text("".join(f"{name}\n" for name in names), encoding="utf-8")


@pytest.fixture(scope="session", autouse=True)
def account(tmp_path_factory):
    """The folder of the secret by which runs are known as one's own: not that of who tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BLURNOISE_STATE", str(folder := tmp_path_factory.mktemp("account")))
        yield folder


@pytest.fixture(scope="session")
def detector(tmp_path_factory):
    """One small detector for all tests of the harness: of stop signs, exact by construction."""
    from signs_in_memory import matched_detector  # late: it imports PyTorch

    return matched_detector(tmp_path_factory.mktemp("model"))
