"""The range coder: the interval, probabilities that learn, numbers, mixed decisions."""

from .numbers import MASK32, clamp, must, unfold_sign

SQUASH = [
    22, 36, 60, 98, 162, 267, 439, 720, 1179, 1921, 3108, 4971, 7812, 11955, 17625, 24743, 32768, 40793, 47911, 53581,
    57724, 60565, 62428, 63615, 64357, 64816, 65097, 65269, 65374, 65438, 65476, 65500, 65514,
]  # fmt: skip


def squash(x):
    y = x + 2048
    k, f = y >> 7, y & 127
    return (SQUASH[k] * (128 - f) + SQUASH[k + 1] * f + 64) >> 7


def make_stretch():
    table, x = [], -2047
    for i in range(4096):
        while x < 2047 and squash(x) < 16 * i + 8:
            x += 1
        table.append(x)
    return table


STRETCH = make_stretch()
STEPS = [655360 // (10 * m + 16) for m in range(256)]
FIRST_WEIGHT = {2: 46341, 3: 37837, 4: 32768, 5: 29309}


class Decisions:
    """The reader of a block by the range coder."""

    def __init__(self, block):
        self.block, self.taken = block, 0
        self.low, self.high, self.code = 0, MASK32, 0
        for _ in range(4):
            self.shift()

    def shift(self):
        byte = self.block[self.taken] if self.taken < len(self.block) else 0
        self.taken += 1
        # Nothing good comes any more; without this, a bad count could keep us here for long.
        must(self.taken <= len(self.block) + 64, "range")
        self.code = (self.code << 8 | byte) & MASK32

    def bit(self, one):
        cut = self.low + ((self.high - self.low) * one >> 16)
        yes = self.code <= cut
        if yes:
            self.high = cut
        else:
            self.low = cut + 1
        while (self.low ^ self.high) >> 24 == 0:
            self.low = self.low << 8 & MASK32
            self.high = (self.high << 8 | 255) & MASK32
            self.shift()
        return int(yes)

    def plain(self, count):
        value = 0
        for _ in range(count):
            value = value << 1 | self.bit(32768)
        return value

    def finish(self):
        must(len(self.block) <= self.taken <= len(self.block) + 4, "range")


class Slots:
    """A table of slots: [p, uses] each, flat."""

    def __init__(self, count, one):
        self.p, self.uses = [one << 6] * count, [0] * count

    def learn(self, at, yes):
        p, uses = self.p[at], self.uses[at]
        target = (1 << 22) - 1 if yes else 0
        self.p[at] = p + ((target - p) * STEPS[uses] >> 16)
        self.uses[at] = min(uses + 1, 255)

    def code(self, bits, at):
        yes = bits.bit(clamp(self.p[at] >> 6, 32, 65504))
        self.learn(at, yes)
        return yes

    def words(self):
        return [p << 10 | uses for p, uses in zip(self.p, self.uses)]

    def set_words(self, words):
        for at in range(len(self.p)):
            word = next(words)
            must(word & 1023 <= 255, "context")
            self.p[at], self.uses[at] = word >> 10, word & 1023


class Number:
    def __init__(self):
        self.more, self.second = Slots(32, 32768), Slots(32, 32768)

    def code(self, bits):
        k = 0
        while k < 31 and self.more.code(bits, k):
            k += 1
        if k < 2:
            return k
        top = 2 | self.second.code(bits, k)
        return top << k - 2 | bits.plain(k - 2)

    def signed(self, bits):
        return unfold_sign(self.code(bits))

    def parts(self):
        return [self.more, self.second]


class Mixed:
    def __init__(self, sizes, situations, one):
        self.tables = [Slots(size, one) for size in sizes]
        self.weights = [[FIRST_WEIGHT[len(sizes)]] * len(sizes) for _ in range(situations)]

    def code(self, bits, situation, at):
        w = self.weights[situation]
        x = [STRETCH[table.p[index] >> 10] for table, index in zip(self.tables, at)]
        total = sum(weight * opinion for weight, opinion in zip(w, x))
        mixed = squash(clamp(total >> 16, -2047, 2047))
        yes = bits.bit(clamp(mixed, 32, 65504))
        miss = (65536 if yes else 0) - mixed
        for j, opinion in enumerate(x):
            w[j] = clamp(w[j] + (opinion * miss * 5 + 32768 >> 16), -(1 << 20), 1 << 20)
        for table, index in zip(self.tables, at):
            table.learn(index, yes)
        return yes

    def words(self):
        slots = [word for table in self.tables for word in table.words()]
        return slots + [weight & MASK32 for row in self.weights for weight in row]

    def set_words(self, words):
        for table in self.tables:
            table.set_words(words)
        for row in self.weights:
            for j in range(len(row)):
                word = next(words)
                row[j] = word - (1 << 32) if word >> 31 else word
                must(abs(row[j]) <= 1 << 20, "context")
