"""`python -m robot.cli`."""

import sys

from robot.cli.verbs import main

sys.exit(main())
