"""Shortest paths of a car with turning radius 1, in closed form.

J. A. Reeds and L. A. Shepp, "Optimal paths for a car that goes both forwards and backwards", Pacific Journal of
Mathematics 145 (1990). A word is a list of segments: curvature (1 left, -1 right, 0 straight) and signed length.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import acos, asin, atan2, cos, hypot, pi, sin, sqrt

Word = list[tuple[int, float]]
LEFT, STRAIGHT, RIGHT = 1, 0, -1


def reeds_shepp_words(x: float, y: float, heading: float) -> list[Word]:
    """Paths with forward and backward segments from the origin to a pose, in turning radii, the shortest first."""
    return sorted(_reeds_shepp_words(x, y, heading), key=word_length)


def word_length(word: Word) -> float:
    """Length of a word, in turning radii."""
    return sum(abs(length) for _, length in word)


def _reeds_shepp_words(x: float, y: float, heading: float) -> Iterator[Word]:
    """All words: nine formulas, with motions in reversed time, reflected, and in reversed order."""
    back = x * cos(heading) + y * sin(heading), x * sin(heading) - y * cos(heading)
    for reversed_order, (a, b) in ((False, (x, y)), (True, back)):
        for backward in (1, -1):
            for side in (1, -1):
                for word in _base_words(backward * a, side * b, backward * side * heading):
                    found = [(side * curvature, backward * length) for curvature, length in word]
                    yield found[::-1] if reversed_order else found


def _base_words(x: float, y: float, heading: float) -> Iterator[Word]:
    """Formulas 8.1 to 8.11 of Reeds and Shepp. Lengths have signs, so that each word ends at the pose."""
    quarter = pi / 2
    same = x - sin(heading), y - 1 + cos(heading)  # the last segment turns left
    other = x + sin(heading), y - 1 - cos(heading)  # it turns right
    u, t = hypot(*same), atan2(same[1], same[0])
    yield [(LEFT, t), (STRAIGHT, u), (LEFT, _turn(heading - t))]  # 8.1
    if u <= 4:
        v = -2 * asin(u / 4)
        s = _turn(t + v / 2 + pi)
        yield [(LEFT, s), (RIGHT, v), (LEFT, _turn(heading - s + v))]  # 8.3 and 8.4
    if u >= 2:
        r = sqrt(u**2 - 4)
        s = _turn(t + atan2(r, -2))
        yield [(LEFT, s), (RIGHT, -quarter), (STRAIGHT, 2 - r), (LEFT, _turn(heading - quarter - s))]  # 8.9
    u, t = hypot(*other), atan2(other[1], other[0])
    if u >= 2:
        r = sqrt(u**2 - 4)
        s = _turn(t + atan2(2, r))
        yield [(LEFT, s), (STRAIGHT, r), (RIGHT, _turn(s - heading))]  # 8.2
        s = atan2(other[0], -other[1])
        yield [(LEFT, s), (RIGHT, -quarter), (STRAIGHT, 2 - u), (RIGHT, _turn(s + quarter - heading))]  # 8.10
        v = 4 - r
        s = _turn(atan2((4 - v) * other[0] - 2 * other[1], -2 * other[0] + (v - 4) * other[1]))
        yield [(LEFT, s), (RIGHT, -quarter), (STRAIGHT, v), (LEFT, -quarter), (RIGHT, _turn(s - heading))]  # 8.11
    if u <= 2:
        yield from _four_arcs(acos((2 + u) / 4), -1, *other, heading)  # 8.7
    if 4 <= u**2 <= 20:
        yield from _four_arcs(-acos((20 - u**2) / 16), 1, *other, heading)  # 8.8


def _four_arcs(u: float, sign: int, xi: float, eta: float, heading: float) -> Iterator[Word]:
    """Words with two middle arcs of equal size: (u, -u) with a cusp between them, or (u, u) with one at either end."""
    v = -u if sign < 0 else u
    delta = u - v
    a, b = sin(u) - sin(delta), cos(u) - cos(delta) - 1
    t = atan2(eta * a - xi * b, xi * a + eta * b)
    yield [(LEFT, t), (RIGHT, u), (LEFT, v), (RIGHT, _turn(t - u + v - heading))]


def _turn(angle: float) -> float:
    """Angle within half a turn."""
    return (angle + pi) % (2 * pi) - pi
