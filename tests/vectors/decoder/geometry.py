"""Profile surface: the points of sets."""

from .body import Reader
from .levels import level_ends, level_spans
from .numbers import MASK32, clamp, f32_bits, hash_fold, must, sig, toward_zero
from .range_coder import Decisions, Number, Slots


def curve_place(node):
    x, y, z = node
    for level in range(20, 0, -1):
        b = 1 << level
        if x & b:
            x ^= b - 1
        if y & b:
            x ^= b - 1
        else:
            d = (x ^ y) & (b - 1)
            x, y = x ^ d, y ^ d
        if z & b:
            x ^= b - 1
        else:
            d = (x ^ z) & (b - 1)
            x, z = x ^ d, z ^ d
    y ^= x
    z ^= y
    t = 0
    for level in range(20, 0, -1):
        if z >> level & 1:
            t ^= (1 << level) - 1
    place = 0
    for level in range(20, -1, -1):
        for axis in (x ^ t, y ^ t, z ^ t):
            place = place << 1 | axis >> level & 1
    return place


def order_key(point):
    """The order of the points of one level."""
    return curve_place(point[:3]), point[3], point[4]


def is_in_order(entry, points):
    return points == in_order(entry, points)


def in_order(entry, points):
    """The points of a set; those of each level may be in any order."""
    return [point for span in level_spans(entry) for point in sorted(points[span], key=order_key)]


def digest_of(entry, points):
    digest = hash_fold(0, [entry["normal_bits"], f32_bits(entry["step"]), len(points), entry["charts"]])
    digest = hash_fold(digest, [f32_bits(axis) for axis in entry["origin"]])
    digest = hash_fold(digest, level_ends(entry))
    for point in points:
        digest = hash_fold(digest, list(point))
    return digest


def finish_set(entry, points):
    must(f"{digest_of(entry, points):016x}" == entry["digest"], "geometry")
    return points


def differences(reader, count):
    """Numbers of 24 bits, each told by its difference from the one before."""
    planes = [reader.take(count) for _ in range(3)]
    value = 0
    for low, middle, high in zip(*planes):
        value = (value + (low | middle << 8 | high << 16)) & 0xFFFFFF
        yield value


def geometry_plain(layout, section):
    """[(set, points)]; a point is (x, y, z, code, chart)."""
    sets, total = [], 0
    reader = Reader(section.plain(), "geometry")
    while reader.at < len(reader.data):
        index = reader.number(4)
        must(index < len(layout.sets), "geometry")
        entry = layout.sets[index]
        count, bits = entry["points"], entry["normal_bits"]
        total += count
        must(total <= section.records, "geometry")
        axes = [list(differences(reader, count)) for _ in range(3)]
        for axis, largest in zip(axes, entry["extent"]):
            must(all(value <= largest for value in axis), "geometry")
        codes = [low | high << 8 for low, high in zip(reader.take(count), reader.take(count))]
        must(all(code < 1 << 2 * bits for code in codes), "geometry")
        charts = list(differences(reader, count))
        must(all(chart < entry["charts"] for chart in charts), "geometry")
        points = list(zip(*axes, codes, charts))
        must(is_in_order(entry, points), "geometry")
        sets.append((index, finish_set(entry, points)))
    must(total == section.records, "geometry")
    return sets


def steepest(direction):
    sizes = [abs(axis) for axis in direction]
    return sizes.index(max(sizes))


def distance(a, b):
    return max(abs(p - q) for p, q in zip(a, b))


class RecentPoint:
    def __init__(self, node, code, chart, bits):
        self.node, self.code, self.chart = node, code, chart
        top = (1 << bits) - 1
        a, b = 2 * (code & top) - top, 2 * (code >> bits) - top
        c = top - abs(a) - abs(b)
        if c < 0:
            a = a + c if a >= 0 else a - c
            b = b + c if b >= 0 else b - c
        self.direction = (a, b, c)
        self.steep = steepest(self.direction)

    def plane(self, s, place):
        d = self.direction
        others = [axis for axis in range(3) if axis != s]
        fall = sum(d[axis] * (place[axis] - self.node[axis]) for axis in others)
        return self.node[s] - clamp(toward_zero(fall, d[s]), -(1 << 24), 1 << 24)

    def misfit(self, node):
        return abs(self.plane(self.steep, node) - node[self.steep])


class GeometryModel:
    def __init__(self):
        self.sets = Number()
        self.empty = [Slots(272, 32768), Slots(272, 32768)]
        self.share, self.plane = Slots(256, 32768), Slots(136, 32768)
        self.same = [Slots(8, 32768), Slots(4, 32768)]
        self.turn = [Number(), Number()]
        self.was_same = 1
        self.charts, self.jump = Slots(24, 32768), Number()
        self.was_alike = 1
        self.recent = []

    def section(self, layout, section):
        bits = Decisions(section.block)
        sets, total, following = [], 0, 0
        for _ in range(self.sets.code(bits)):
            index = (following + self.sets.signed(bits)) & MASK32
            must(index < len(layout.sets), "geometry")
            entry = layout.sets[index]
            total += entry["points"]
            must(total <= section.records, "geometry")
            points = in_order(entry, self.points(bits, entry))
            sets.append((index, finish_set(entry, points)))
            following = (index + 1) & MASK32
        must(total == section.records, "geometry")
        bits.finish()
        must(sum(4 + 14 * len(points) for _, points in sets) == section.raw, "plain")
        return sets

    def points(self, bits, entry):
        self.recent = []
        found = []
        for span in level_spans(entry):
            found += self.level(bits, entry, span.stop - span.start)
        return found

    def level(self, bits, entry, count):
        found = []
        boxes = [((0, 0, 0), tuple(sig(axis) for axis in entry["extent"]), count)]
        while boxes:
            low, size, count = boxes.pop()
            if count == 0:
                continue
            if count == 1 or size == (0, 0, 0):
                for _ in range(count):
                    found.append(self.point(bits, entry, low, size))
                continue
            axis = size.index(max(size))
            lower_count = self.lower_count(bits, axis, size[axis], count)
            half = tuple(s - (a == axis) for a, s in enumerate(size))
            upper = tuple(c + ((1 << half[axis]) if a == axis else 0) for a, c in enumerate(low))
            boxes.append((upper, half, count - lower_count))
            boxes.append((low, half, lower_count))
        return found

    def lower_count(self, bits, axis, size, count):
        across = int(bool(self.recent) and self.recent[-1].steep == axis)
        at = (min(count, 16) * 2 + across) * 8 + min(size, 7)
        if self.empty[0].code(bits, at):
            return 0
        if self.empty[1].code(bits, at):
            return count
        width = sig(count - 2)
        first = min(width, 3)
        node = 1
        for _ in range(first):
            node = 2 * node + self.share.code(bits, min(width, 31) * 8 + node)
        number = (node - (1 << first)) << (width - first) | bits.plain(width - first)
        must(number + 1 < count, "geometry")
        return number + 1

    def point(self, bits, entry, low, size):
        centre = [low[axis] + (1 << size[axis]) // 2 for axis in range(3)]
        near = min(self.recent, key=lambda point: distance(point.node, centre), default=None)
        s = near.steep if near else 0
        node = list(low)
        for axis in ((s + 1) % 3, (s + 2) % 3):
            node[axis] += bits.plain(size[axis])
        plane = near.plane(s, node) if near else centre[s]
        for h in range(size[s] - 1, -1, -1):
            m = node[s] + (1 << h)
            above = 8 + clamp(((plane - m) * 8 + 4) // (1 << h + 1), -8, 8)
            if self.plane.code(bits, above * 8 + min(h, 7)):
                node[s] = m
        must(all(node[axis] <= entry["extent"][axis] for axis in range(3)), "geometry")
        width = entry["normal_bits"]
        code, how, like = self.normal(bits, width, node)
        chart = self.chart(bits, entry["charts"], node, how, like) if entry["charts"] > 1 else 0
        self.recent = (self.recent + [RecentPoint(tuple(node), code, chart, width)])[-16:]
        return (*node, code, chart)

    def normal(self, bits, width, node):
        """The code; 0, 1 or 2 for how it was told; the candidate that tells most about the chart, or None."""

        def best(points):
            return min(points, key=lambda point: distance(point.node, node) + 4 * point.misfit(node), default=None)

        newest = self.recent[::-1]
        first = best(newest)
        second = first and best([point for point in newest if point.code != first.code])
        if first:
            self.was_same = self.same[0].code(bits, self.was_same * 4 + min(sig(first.misfit(node)), 3))
            if self.was_same:
                return first.code, 0, first
        if second and self.same[1].code(bits, min(sig(second.misfit(node)), 3)):
            return second.code, 1, second
        base, top = first.code if first else 0, (1 << width) - 1
        u = (base & top) + self.turn[0].signed(bits)
        v = (base >> width) + self.turn[1].signed(bits)
        must(0 <= u <= top and 0 <= v <= top, "geometry")
        return u | v << width, 2, first

    def chart(self, bits, charts, node, how, like):
        guess, misfit = (like.chart, like.misfit(node)) if like else (0, 0)
        at = (how * 4 + min(sig(misfit), 3)) * 2 + self.was_alike
        self.was_alike = self.charts.code(bits, at)
        chart = guess if self.was_alike else guess + self.jump.signed(bits)
        must(0 <= chart < charts, "geometry")
        return chart
