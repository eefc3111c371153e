"""`python -m robot.cli`."""

import sys

from robot.cli import main

sys.exit(main())
