"""``python -m blurnoise_eval.cli``."""

import sys

from blurnoise_eval.cli import main
from blurnoise_eval.system.interrupts import in_order

sys.exit(in_order(main, own_process=True))
