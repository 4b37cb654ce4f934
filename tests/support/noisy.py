"""Robot files whose numbers are all a little wrong, as those of programs that write single precision."""

import random
import re

_VALUES = re.compile(r'(\b[a-zA-Z_]+\s*=\s*)(["\'])([-+0-9.eE\s]+)\2')
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def with_noise(text, seed, size=1e-6):
    """The file with every number in it but zeros multiplied by something within ``1 +- size``."""
    generator = random.Random(seed)

    def changed(match):
        value = float(match[0])
        return repr(value * (1 + size * generator.uniform(-1, 1))) if value else match[0]

    def attribute(match):
        return f"{match[1]}{match[2]}{_NUMBER.sub(changed, match[3])}{match[2]}"

    head, mark, body = text.partition("?>")
    if not mark:
        head, body = "", text
    return head + mark + _VALUES.sub(attribute, body)
