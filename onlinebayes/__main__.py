"""``python -m onlinebayes``: the command line, for where its script is not on the path."""

import sys

from onlinebayes.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
