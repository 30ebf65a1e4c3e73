"""Small faults put into the sources one at a time: does a test fail? ``python tests/mutation_sample.py --help``

tests/data/mutations.yaml has the faults: a file, a text that it has once, what replaces it, and the tests that are
run. One that survives has a reason there; any other ends this with 1.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).parents[1]
COPIED = ("blurnoise", "eval", "models", "tests", "pyproject.toml")
LONGEST_S = 300


def main():
    """Run the faults that are named, or all. Returns 1 where one survives without a reason, or is caught with one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="of faults (default: all)")
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    given = parser.parse_args()
    every = yaml.safe_load((ROOT / "tests" / "data" / "mutations.yaml").read_text(encoding="utf-8"))
    some = {name: every[name] for name in given.names or every}
    wrong = [f"{name}: {fault}" for name, each in some.items() if (fault := misplaced(each))]
    if wrong:
        print("\n".join(wrong))
        return 1
    surprises = 0
    with ThreadPoolExecutor(given.workers) as pool:
        for (name, each), survived in zip(some.items(), pool.map(survives, some.values()), strict=True):
            reason = each.get("survives", "")
            surprises += survived != bool(reason)
            found = "survives" if survived else "caught"
            print(f"{name}: {found}{f' ({reason})' if reason else ''}", flush=True)
    print(f"{len(some)} faults, {surprises} not as expected")
    return int(surprises > 0)


def misplaced(fault):
    """Why a fault cannot be put into the sources; "" where it can."""
    count = (ROOT / fault["file"]).read_text(encoding="utf-8").count(fault["old"])
    return "" if count == 1 else f"{fault['file']} has {fault['old']!r} {count} times; must be once"


def survives(fault):
    """Whether all tests pass with the fault, in a copy of sources and tests."""
    with tempfile.TemporaryDirectory() as folder:
        for name in COPIED:
            source, ignored = ROOT / name, shutil.ignore_patterns("__pycache__")
            if source.is_dir():
                shutil.copytree(source, Path(folder, name), ignore=ignored)
            else:
                shutil.copy(source, folder)
        file = Path(folder, fault["file"])
        text = file.read_text(encoding="utf-8")
        file.write_text(text.replace(fault["old"], fault["new"]), encoding="utf-8")
        return run_tests(Path(folder), fault["tests"].split()) == 0


def run_tests(tree, tests):
    """0 where all pass, 1 where one fails or takes far too long. Raises ``RuntimeError`` where none can be run."""
    parts = [tree, tree / "eval", tree / "models"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, parts)), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    with tempfile.TemporaryFile() as said:  # a pipe would end with the last process of a test that failed
        pipes: Any = {"stdout": said, "stderr": subprocess.STDOUT}
        try:
            done = subprocess.run(command, cwd=tree, env=environment, timeout=LONGEST_S, check=False, **pipes)
        except subprocess.TimeoutExpired:  # with some faults a loop has no end
            return 1
        if done.returncode > 1:
            said.seek(0)
            raise RuntimeError(said.read().decode(errors="replace")[-2000:])
        return done.returncode


if __name__ == "__main__":
    sys.exit(main())
