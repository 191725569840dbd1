"""`python -m inscrutable`: the same as the command `inscrutable`."""

import sys

from inscrutable.cli import main

if __name__ == "__main__":
    sys.exit(main())
