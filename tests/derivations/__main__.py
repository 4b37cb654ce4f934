"""Derive everything and say how far the files in tests/data are from it; exit status 1 where that is too far."""

import sys

from . import bicycle_linear, chaplygin_sleigh, moore_bicycles, space_robot
from .comparison import differences, read

LIMIT = 1e-12

if __name__ == "__main__":
    far = False
    for module in (space_robot, chaplygin_sleigh, bicycle_linear, moore_bicycles):
        name = module.__name__.rpartition(".")[2]
        data = read(name)
        found = list(differences(module.derived(data), data))
        where, worst = max(found, key=lambda each: each[1])
        far |= worst > LIMIT
        print(f"{name}.json: {len(found)} arrays, the worst {worst:.1e} off ({where})", flush=True)
    sys.exit(far)
