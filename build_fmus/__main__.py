"""`python -m build_fmus` is `build-fmus`."""

from build_fmus.cli import main

main()
