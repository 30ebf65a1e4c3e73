"""``python -m blurnoise_eval.maps``: which image-quality metric tells how a run's detectors do."""

from __future__ import annotations

import sys
from typing import Annotated

from typer import Option

from blurnoise_eval.cli import given, run_alone
from blurnoise_eval.cli._options import Cluster, Folder, Json, Keep, RunRead, Score, Threads, Threshold
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say, say_json, say_wrapped, show


def maps(
    run: RunRead,
    *,
    keep: Keep = None,
    threshold: Threshold = None,
    score: Score = None,
    cluster: Cluster = None,
    repeats: Annotated[int, Option(metavar="N", help="noise fields per chart")] = 1,
    threads: Threads = None,
    output: Folder,
    as_json: Json = False,
) -> None:
    """Which image-quality metric ranks a run's conditions as its detectors do, over light and motion blur together,
    and which misleads: charts exposed by the run's camera under the run's conditions, beside the run's scores.

      python -m blurnoise_eval.maps run -o maps
      python -m blurnoise_eval.maps run -o maps --score ap50 --keep 0.8

    Writes DIR/maps.csv (model, score, group, metric: rank correlation with its interval over pictures, share of
    nodes told, what an increasing curve explains in light and in blur held out), DIR/predictor.json (a closed form of
    six coefficients that needs no picture, with its error and its range), DIR/nodes.csv and DIR/figures. No detector
    runs; a condition takes about 0.1 s.
    """
    workers = given.threads(threads)
    from blurnoise._core.checks import integer
    from blurnoise_eval.answers.clusters import cluster_of
    from blurnoise_eval.grid.conditions import MOST_REPEATS
    from blurnoise_eval.maps import figures
    from blurnoise_eval.maps.maps import maps_of, sentences, summary, tables, write
    from blurnoise_eval.maps.nodes import nodes_of
    from blurnoise_eval.store.schema import CONDITIONS
    from blurnoise_eval.store.store import Store
    from blurnoise_eval.sweep.score_tables import criterion_of
    from blurnoise_eval.system.working_folder import output_folder, read_run

    integer("repeats", repeats, 1, MOST_REPEATS)
    cluster_of("", cluster)
    with read_run(run) as read, Store(read.path) as store:
        criterion = criterion_of(store, threshold, keep, score)
        nodes = nodes_of(store)
        options = {"cluster": cluster, "repeats": repeats, "threads": workers}
        with ProgressBar("maps", len(nodes) + store.count_different(*CONDITIONS, "model")) as advance:
            found = maps_of(store, nodes, criterion, progress=advance, **options)
    with output_folder(output) as folder:
        folder.path.mkdir(parents=True, exist_ok=True)
        files = list(map(folder.told, write(found, folder.path)))
        drawn = list(map(folder.told, figures.write(found, folder.path / "figures")))
    if as_json:
        say_json({"output": str(output), **summary(found), "files": files, "figures": drawn})
        return
    for sentence in sentences(found):
        say_wrapped(sentence)
    show(*tables(found))
    say("told: share of nodes; in brackets 95 % over pictures, none below 8 of them")
    say(f"open {output / 'figures'}, {files[0]}")


if __name__ == "__main__":
    sys.exit(run_alone(maps, "python -m blurnoise_eval.maps", sys.argv[1:]))
