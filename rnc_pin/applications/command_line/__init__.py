"""Command line: commands, messages and tables in the terminal."""
