"""`python -m planner.cli`."""

import sys

from planner.cli.verbs import main

sys.exit(main())
