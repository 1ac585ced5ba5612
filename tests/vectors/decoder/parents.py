"""Profile surface: the parents of the points of a set, and what they tell."""

from itertools import product
from math import isqrt

from .levels import finest_distance, level_ends, spacing_square

MOST_PARENTS, MOST_OF_CELL = 4, 16


class Parents:
    """The parents of the points of a set, as (number, weight); for each block, the other blocks with its parents."""

    def __init__(self, entry, points):
        self.of_points = find_parents(entry, points)
        self.blocks = []
        for first in range(0, len(points), 64):
            numbers = {number for parents in self.of_points[first : first + 64] for number, _ in parents}
            self.blocks.append({number // 64 for number in numbers} - {first // 64})


def find_parents(entry, points):
    """For each point of a set, the list of (number, weight) of its parents."""
    ends = [*level_ends(entry), len(points)]
    finest, last = finest_distance(entry), len(ends) - 1
    found = [[] for _ in points[: ends[0]]]
    for coarser, (end, end_of_level) in enumerate(zip(ends, ends[1:])):
        reach = int(spacing_square(finest, last - coarser) * 2.25)
        edge = isqrt(reach) + 1
        cells = cells_of(points[:end], edge)
        for point in points[end:end_of_level]:
            found.append(weighted(nearest(points, point, reach, candidates(cells, edge, point))))
    return found


def cells_of(points, edge):
    """The numbers of the points in each cell of a chart, ascending."""
    cells = {}
    for number, (x, y, z, _, chart) in enumerate(points):
        cells.setdefault((chart, x // edge, y // edge, z // edge), []).append(number)
    return cells


def candidates(cells, edge, point):
    """The points of the 27 cells around a point: the last 16 of each."""
    chart, middle = point[4], [axis // edge for axis in point[:3]]
    for step in product((-1, 0, 1), repeat=3):
        cell = (chart, *(axis + by for axis, by in zip(middle, step)))
        yield from cells.get(cell, ())[-MOST_OF_CELL:]


def nearest(points, point, reach, numbers):
    """Squared distance and number of the four nearest points in reach."""
    near = []
    for number in numbers:
        square = sum((p - q) ** 2 for p, q in zip(points[number][:3], point[:3]))
        if square <= reach:
            near.append((square, number))
    return sorted(near)[:MOST_PARENTS]


def weighted(near):
    """(number, weight) of points that are sorted by distance."""
    far = near[-1][0] if near else 0
    return [(number, weight(square, far)) for square, number in near]


def weight(square, far):
    """The weight of a parent; `far` is the square of the largest distance among the parents."""
    return 1 + 252 * (4 * far - 3 * square) // (4 * far) if far else 253


def mean_and_spread(parents, number_of):
    """Of the numbers that `number_of` has for the parents, None counting as nothing; None if there is none."""
    told = [(number_of(parent), weight) for parent, weight in parents]
    told = [(number, weight) for number, weight in told if number is not None]
    if not told:
        return None
    numbers = [number for number, _ in told]
    total, weights = sum(number * weight for number, weight in told), sum(weight for _, weight in told)
    return (2 * total + weights) // (2 * weights), min(max(numbers) - min(numbers), 255)
