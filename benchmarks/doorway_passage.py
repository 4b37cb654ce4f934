"""Share of drawn doorways that no controller can pass."""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks.doorway_circle import CLEARANCE, passage
from benchmarks.drawn_scenes import unrestricted_doorways


def main() -> None:
    """Print the shares of draws that cannot be passed, and that cannot be passed with the clearance."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=200)
    count = parser.parse_args().draws
    found = np.array([passage(*each) for each in unrestricted_doorways(count)])
    print(f"{count} draws: no motion without contact in {np.mean(found <= 0):.0%}")
    print(f"no motion with {CLEARANCE} m clearance in {np.mean(found < CLEARANCE):.0%}")


if __name__ == "__main__":
    main()
