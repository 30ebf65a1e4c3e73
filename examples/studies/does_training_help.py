"""Does training with RandomExposure help? One network, three augmentations, several seeds, on scenes none has seen.

It trains without photometric augmentation, with Kornia's motion blur and noise, and with RandomExposure. A training
that was stopped goes on where it was. With the default sizes it takes hours; `--pictures 480 --scenes 96` minutes.
"""

import argparse
from pathlib import Path

import pandas
from blurnoise_eval import datasets
from blurnoise_eval.evaluation import evaluate
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_models import arms, training
from blurnoise_models.scenes import write_coco

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("study"))
    for name, usual in (("scenes", 9000), ("pictures", 18_000), ("seeds", 3), ("held-out", 120)):
        parser.add_argument(f"--{name}", type=int, default=usual)
    asked = parser.parse_args()
    recipes = arms.recipes(
        asked.folder / "models", seeds=asked.seeds, scenes=asked.scenes, pictures=asked.pictures
    )
    training.pool(asked.folder / "pool", asked.scenes)
    arms.train_all([each for each in recipes if not each.is_ready()], asked.folder / "pool", processes=2)

    listing = write_coco(asked.folder / "held-out", 2, asked.held_out)  # of a seed that no training has
    plan = SweepPlan(
        {
            "exposure_s": (1e-3, 5e-3, 20e-3, 40e-3),
            "illuminance_lux": (10.0, 50.0, 250.0),
            "velocity_x_px_s": (0.0, 400.0, 1500.0, 3000.0),
        },
        examples=False,
    )
    run = evaluate(
        [each.path for each in recipes],
        datasets.coco(listing, labels=["stop sign"], keep_empty=True),
        plan=plan,
        output=asked.folder / "run",
        refine=False,
    )
    run.report()
    models = pandas.read_csv(asked.folder / "run" / "models.csv")
    models["arm"] = models["model"].str.rpartition("-")[0]
    print(models.groupby("arm")[["p", "mpc", "rpc"]].agg(["mean", "min", "max"]).round(3).to_string())
