"""`python -m sysid.cli`."""

import sys

from sysid.cli.verbs import main

sys.exit(main())
