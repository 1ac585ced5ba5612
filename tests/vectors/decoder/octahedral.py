"""Normals."""

import math


def octahedral(u, v, top):
    """The unit vector of a normal's code; `top` is the largest code of an axis."""
    a, b = min(u, top) / top * 2 - 1, min(v, top) / top * 2 - 1
    c = 1 - abs(a) - abs(b)
    if c < 0:
        a = a + c if a >= 0 else a - c
        b = b + c if b >= 0 else b - c
    length = math.sqrt(a * a + b * b + c * c)
    return [a / length, b / length, c / length]
