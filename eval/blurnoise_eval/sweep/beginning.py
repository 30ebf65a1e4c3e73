"""The beginning of a run: a folder that is new, and in which nothing is ever answered, is gone again."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.system.files import RUN_FILE, RUN_PICTURES


@contextmanager
def begun_or_gone(folder: Path) -> Iterator[None]:
    """Where the body fails before a cell is finished or a picture is skipped, the folder is left as it was.

    Only files of runs are removed: others may have come to the folder meanwhile.
    """
    made = [each for each in (folder, *folder.parents) if not each.exists()]
    files = [RUN_FILE + ending for ending in ("", "-wal", "-shm", "-journal")]
    new = [folder / name for name in (*files, *RUN_PICTURES, "coco") if not (folder / name).exists()]
    try:
        yield
    except BaseException:
        if folder / RUN_FILE in new and not _has_begun(folder):
            for each in new:
                shutil.rmtree(each, ignore_errors=True)  # leaves a file and a link
                with suppress(OSError):
                    each.unlink()
            with suppress(OSError):  # missing, or not empty
                for each in made:
                    each.rmdir()
        raise


def _has_begun(folder: Path) -> bool:
    try:
        with Store(folder) as store:
            return queries.has_begun(store)
    except StoreError:  # no file, or another process has it
        return (folder / RUN_FILE).is_file()
