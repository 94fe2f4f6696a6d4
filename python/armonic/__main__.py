"""`python -m armonic` is the command `armonic`."""

import sys

from armonic.cli import main

if __name__ == "__main__":
    sys.exit(main())
