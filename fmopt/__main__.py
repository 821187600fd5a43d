"""`python -m fmopt`."""

from fmopt.cli import main

main()
