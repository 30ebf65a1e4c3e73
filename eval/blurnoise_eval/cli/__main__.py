"""``python -m blurnoise_eval.cli``."""

import sys

from blurnoise_eval.cli import main

sys.exit(main())
