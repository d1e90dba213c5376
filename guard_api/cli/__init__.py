"""The `guard` command: one file per sub-command."""
