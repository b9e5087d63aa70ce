"""``python -m yawid``."""

import sys

from yawid.cli import main

sys.exit(main())
