"""Exit statuses of the command line."""

DONE, FAILED, USAGE = 0, 1, 2
