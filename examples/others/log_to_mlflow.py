"""Log a run to MLflow: the exposure to use for each light with its score, and the page.

  blurnoise sweep -o run
  python examples/others/log_to_mlflow.py run --experiment night

Each model of the run becomes a run of MLflow. Its metrics have the light as their step, in hundredths of a lux:
MLflow draws the scores of several models over the light in one chart.
"""

import argparse
import csv
import json
from pathlib import Path

import mlflow

SCORES = ("score", "score_low", "score_high", "exposure_s", "saturated_share")

if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path)
    parser.add_argument("--experiment", default="blurnoise")
    options = parser.parse_args()

    mlflow.set_experiment(options.experiment)
    summary = json.loads((options.run / "summary.json").read_text())
    with (options.run / "recommendations.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for model in dict.fromkeys(row["model"] for row in rows):
        with mlflow.start_run(run_name=model):
            mlflow.log_params({"criterion": summary["criterion"]["text"], "cells": summary["cells"]})
            for row in rows:
                if row["model"] != model or row["scope"] == "condition":
                    continue
                where = "" if row["scope"] == "all" else " at a light"
                step = 0 if row["scope"] == "all" else round(100 * float(row["illuminance_lux"]))
                known = {f"{name}{where}": float(row[name]) for name in SCORES if row[name]}
                mlflow.log_metrics(known, step=step)
            mlflow.log_artifact(options.run / "recommendations.csv")
            mlflow.log_artifact(options.run / "report.html")
