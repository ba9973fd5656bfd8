"""``python -m mograft``: the command line."""

import sys

from mograft.cli import main

sys.exit(main())
