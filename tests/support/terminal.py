"""Output of a command without its progress."""


def results(out: str) -> str:
    """Standard output without the lines that say what a command is doing: those end in dots."""
    return "".join(line for line in out.splitlines(keepends=True) if not line.endswith(" ...\n"))
