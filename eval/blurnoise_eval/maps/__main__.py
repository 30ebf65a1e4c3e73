"""``python -m blurnoise_eval.maps``: find image-quality metrics that predict the scores of a run."""

from __future__ import annotations

import sys

from blurnoise_eval.cli import inputs, run_alone
from blurnoise_eval.cli._options import Cluster, Folder, Keep, RunRead, Score, Threads, Threshold
from blurnoise_eval.plan.question import Question
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
    """Find the image-quality metric that ranks the conditions of a run as its detectors do, and metrics that mislead.

      python -m blurnoise_eval.maps run -o maps
      python -m blurnoise_eval.maps run -o maps --score ap50 --keep 0.8

    The metrics are measured on charts, simulated with the camera and under the conditions of the run. Each metric is
    compared with the scores of the run over light and motion blur together. No model is evaluated; a condition takes
    about 0.1 s.

    The command writes DIR/maps.csv (for each model, score, group and metric the rank correlation, its interval over
    pictures, and the share of nodes at which the metric is available), DIR/nodes.csv, and DIR/figures: the score over
    light and motion, and scatter plots of the score against each metric.
    """
    workers = inputs.threads(threads)
    from blurnoise_eval.maps import figures
    from blurnoise_eval.maps.maps import maps_of, sentences, tables, write
    from blurnoise_eval.maps.nodes import nodes_of
    from blurnoise_eval.run.run import Run
    from blurnoise_eval.run.score_tables import criterion_of
    from blurnoise_eval.system.working_folder import check_outputs, output_folder, read_run

    check_outputs(output, "maps.csv", "nodes.csv", "figures/map-*.png", "figures/scatter-*.png")
    with read_run(run) as read, Run.open(read.path) as opened:
        question = Question(threshold=threshold, keep=keep, score=score, cluster=cluster)
        criterion = criterion_of(opened, question)
        nodes = nodes_of(opened)
        with ProgressBar("maps", len(nodes)) as advance:
            found = maps_of(opened.store, nodes, criterion, threads=workers, progress=advance)
    with output_folder(output) as folder:
        folder.path.mkdir(parents=True, exist_ok=True)
        write(found, folder.path)
        figures.write(found, folder.path / "figures")
    for sentence in sentences(found):
        say_wrapped(sentence)
    show(*tables(found))
    say("available: share of nodes; in brackets: 95 % interval over pictures, from 8 pictures on")
    say(f"figures: {output / 'figures'}, table: {output / 'maps.csv'}")


if __name__ == "__main__":
    sys.exit(run_alone(maps, "python -m blurnoise_eval.maps", sys.argv[1:]))
