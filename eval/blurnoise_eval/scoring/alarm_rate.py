"""A rate of false alarms, and the confidence that a detector must show to stay within it.

Domain: false alarms per picture, confidences in [0, 1].
"""

from __future__ import annotations

import numpy as np

from blurnoise_eval.scoring.judged import Judged


def confidence_at(judged: Judged, rate: float) -> float:
    """The confidence above which the pictures have at most ``rate`` false alarms each; 0 where all have no more.

    What was found is matched with the truth by COCO's rule, highest confidence first, so what stands below the
    confidence changes nothing above it. Crowds give no alarms. A detector that drops its weaker answers itself may
    stay below the rate.
    """
    alarms = judged.alarms_from(0.0)
    if alarms is None:
        return 0.0
    wrong = np.sort(alarms.scores[~alarms.right])[::-1]
    allowed = int(np.floor(rate * alarms.pictures.sum() + 1e-9))
    return float(wrong[allowed]) if len(wrong) > allowed else 0.0
