"""`python -m guard_api.cli` is the `guard` command."""

from guard_api.cli.main import main

main()
