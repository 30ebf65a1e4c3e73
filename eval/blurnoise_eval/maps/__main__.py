"""``python -m blurnoise_eval.maps``: which image-quality metric tells how a run's detectors do."""

from __future__ import annotations

import sys

from blurnoise_eval.cli import inputs, run_alone
from blurnoise_eval.cli._options import Cluster, Folder, Keep, RunRead, Score, Threads, Threshold
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say, say_wrapped, show


def maps(
    run: RunRead,
    *,
    keep: Keep = None,
    threshold: Threshold = None,
    score: Score = None,
    cluster: Cluster = None,
    threads: Threads = None,
    output: Folder,
) -> None:
    """Which image-quality metric ranks a run's conditions as its detectors do, over light and motion blur together,
    and which misleads: charts exposed by the run's camera under the run's conditions, beside the run's scores.

      python -m blurnoise_eval.maps run -o maps
      python -m blurnoise_eval.maps run -o maps --score ap50 --keep 0.8

    Writes DIR/maps.csv (model, score, group, metric: rank correlation with its interval over pictures, share of
    nodes at which the metric is known), DIR/nodes.csv and DIR/figures: the score over light and motion, and its
    scatter on each metric. No detector runs; a condition takes about 0.1 s.
    """
    workers = inputs.threads(threads)
    from blurnoise_eval.maps import figures
    from blurnoise_eval.maps.maps import maps_of, sentences, tables, write
    from blurnoise_eval.maps.nodes import nodes_of
    from blurnoise_eval.store.store import Store
    from blurnoise_eval.sweep.score_tables import question_of
    from blurnoise_eval.system.working_folder import output_folder, read_run

    with read_run(run) as read, Store(read.path) as store:
        question = question_of(store, threshold, keep, score, cluster)
        nodes = nodes_of(store)
        with ProgressBar("maps", len(nodes)) as advance:
            found = maps_of(store, nodes, *question, threads=workers, progress=advance)
    with output_folder(output) as folder:
        folder.path.mkdir(parents=True, exist_ok=True)
        write(found, folder.path)
        figures.write(found, folder.path / "figures")
    for sentence in sentences(found):
        say_wrapped(sentence)
    show(*tables(found))
    say("known: share of nodes; in brackets 95 % over pictures, none below 8 of them")
    say(f"open {output / 'figures'}, {output / 'maps.csv'}")


if __name__ == "__main__":
    sys.exit(run_alone(maps, "python -m blurnoise_eval.maps", sys.argv[1:]))
