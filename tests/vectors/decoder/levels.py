"""Profile surface: the levels of the points of a set."""

import math

from .numbers import MASK32, MASK64, f32

MOST_LEVELS = 12


def level_ends(entry):
    """The number of points in each level and all coarser ones, for all levels but the last."""
    return entry["level_ends"][: entry["levels"] - 1]


def level_spans(entry):
    """Where the points of each level are in the list of the set, as slices."""
    ends = [0, *level_ends(entry), entry["points"]]
    return [slice(start, end) for start, end in zip(ends, ends[1:])]


def count_levels(points):
    levels = 1
    while levels < MOST_LEVELS and points >> levels + 6:
        levels += 1
    return levels


def shuffle(i):
    i = (i ^ i >> 16) * 0x85EBCA6B & MASK32
    i = (i ^ i >> 13) * 0xC2B2AE35 & MASK32
    return i ^ i >> 16


def finest_distance(entry):
    """The distance that points of the last level would keep, in nodes."""
    return f32(entry["kernel_radius"]) / f32(entry["step"]) * (5 / 9)


def spacing_square(finest, above):
    """The square of the distance, in nodes, that points of a level keep if it is `above` levels above the last."""
    return finest * finest * 2.0**above


def own_squares(points, finest):
    """For each chart, the square of a third of its width, in nodes."""
    charts = {}
    for point in points:
        charts.setdefault(point[4], []).append(point[:3])
    squares = {}
    for chart, nodes in charts.items():
        extents = [max(axis) - min(axis) for axis in zip(*nodes)]
        width = len(nodes) * 1.43 * finest * finest / (math.sqrt(sum(e * e for e in extents)) + finest)
        squares[chart] = (width / 3) * (width / 3)
    return squares


def least_square(own, most):
    """The square of the distance that points of a chart keep where others keep that of `most`."""
    return min(int(min(max(own, most / 8), most)), MASK64)


def assign(entry, points):
    """The number of levels, and the level of each point; the points are ordered as if there were no levels."""
    count = count_levels(len(points))
    last = count - 1
    if last == 0:
        return count, [0] * len(points)
    finest = finest_distance(entry)
    own = own_squares(points, finest)
    levels = [last] * len(points)
    left = sorted(range(len(points)), key=shuffle)
    taken = []
    for level in range(last):
        most = spacing_square(finest, last - level)
        least = {chart: least_square(square, most) for chart, square in own.items()}
        for index in left[:]:
            if not any(is_near(points[index], points[other], least) for other in taken):
                levels[index] = level
                taken.append(index)
                left.remove(index)
    raise_first(points, taken + left, levels)
    return count, levels


def is_near(a, b, least):
    same_chart = a[4] == b[4]
    return same_chart and sum((p - q) ** 2 for p, q in zip(a[:3], b[:3])) < least[a[4]]


def raise_first(points, taken, levels):
    """Puts the second to eighth point of every chart into coarser levels."""
    ranks = {}
    for index in taken:
        chart = points[index][4]
        rank = ranks.get(chart, 0)
        ranks[chart] = rank + 1
        raised = 0 if rank < 1 else 2 if rank < 3 else 1 if rank < 8 else 0
        levels[index] = max(levels[index] - raised, 0)


def made_anew(entry, points):
    """The level ends and the points of a set that is made of these points, as a client makes shared geometry.

    The points are ordered as if there were no levels.
    """
    count, levels = assign(entry, points)
    order = sorted(range(len(points)), key=lambda index: levels[index])
    ends = [sum(1 for level in levels if level < end) for end in range(1, count)]
    return ends, [points[index] for index in order]
