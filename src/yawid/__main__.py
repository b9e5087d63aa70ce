"""``python -m yawid``."""

import sys

from yawid.cli.main import main

sys.exit(main())
