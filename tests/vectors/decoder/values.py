"""Profile surface: AO of blocks that come."""

from .body import Reader
from .numbers import MASK32, clamp, must, sig
from .prediction import NO_VALUE, told_by_parents
from .range_coder import Decisions, Mixed, Number, Slots


class Arrivals:
    """Blocks that come, checked run by run."""

    def __init__(self, state, records):
        self.state, self.records, self.points, self.blocks = state, records, 0, []
        self.seen = set()

    def run(self, first, count):
        layout = self.state.layout
        must(count > 0 and first + count <= layout.blocks, "values")
        for block in range(first, first + count):
            must(not self.state.present[block] and block not in self.seen, "values")
            self.seen.add(block)
            self.blocks.append(block)
            self.points += layout.block_len(block)
        must(self.points <= self.records, "values")

    def end(self):
        must(self.points == self.records, "values")


def varint_bytes(value):
    return max(1, -(-sig(value) // 7))


class Guess:
    """What is known of a point that comes, before its byte is read."""

    def __init__(self, state, slot):
        layout, values, block = state.layout, state.values, slot // 64
        instance = layout.owners[block]
        start = layout.first_blocks[instance]
        first = 64 * block
        if block > start and state.present[block - 1]:
            first -= 64
        past = [values[slot - 1 - n] if slot - 1 - n >= first else None for n in range(3)]
        self.before = past[0]
        self.level = layout.level_of(instance, slot - 64 * start)
        self.twin = None
        twin = layout.twin(instance)
        if twin is not None:
            away = 64 * (layout.first_blocks[twin] - start)
            if state.present[(slot + away) // 64]:
                self.twin = values[slot + away]
        told = told_by_parents(state, slot)
        a, b, c = (byte or 255 for byte in past)
        self.predicted, self.spread = told or ((2 * a + b + c) // 4, None)


def values_plain(state, section):
    """Reads the bytes of blocks that come, each as its difference from the predicted one."""
    reader = Reader(section.plain(), "values")
    must(reader.number(1), "values")
    arrivals = Arrivals(state, section.records)
    for _ in range(reader.varint()):
        arrivals.run(reader.varint(), reader.varint())
    arrivals.end()
    rest = reader.rest()
    must(len(rest) == section.records, "values")
    differences = iter(rest)
    for block in arrivals.blocks:
        for slot in range(64 * block, 64 * block + state.layout.block_len(block)):
            state.values[slot] = (Guess(state, slot).predicted + next(differences)) & 255
        state.present[block] = True


def level_between(byte, predicted, quantum):
    """The whole number of quanta that leads nearest to a byte."""
    size = (abs(byte - predicted) + quantum // 2) // quantum
    return 0 if byte == predicted else -size if byte < predicted else size


class ValueModel:
    """What the range coder learns of the values of a frame."""

    def __init__(self):
        self.numbers, self.large = Number(), Number()
        self.missing = Slots(18, 4096)
        self.levels = Mixed([588, 1008, 5376, 1050], 14, 32768)
        self.past, self.alike = (0, 0), 0

    def section(self, state, section):
        bits = Decisions(section.block)
        quantum = bits.plain(8)
        must(quantum, "values")
        arrivals = Arrivals(state, section.records)
        end, runs = 0, self.numbers.code(bits)
        raw = 1 + varint_bytes(runs) + section.records
        for _ in range(runs):
            first = (end + self.numbers.signed(bits)) & MASK32
            count = self.numbers.code(bits)
            arrivals.run(first, count)
            end = first + count
            raw += varint_bytes(first) + varint_bytes(count)
        arrivals.end()
        for block in arrivals.blocks:
            for slot in range(64 * block, 64 * block + state.layout.block_len(block)):
                state.values[slot] = self.point(bits, quantum, Guess(state, slot))
            state.present[block] = True
        bits.finish()
        must(raw == section.raw, "plain")

    def point(self, bits, quantum, guess):
        """The byte of a point."""
        before, twin = (
            0 if byte is None else 1 if byte == NO_VALUE else 2 for byte in (guess.before, guess.twin)
        )
        at = (before * 3 + twin) * 2 + (guess.spread is not None)
        if self.missing.code(bits, at):
            byte = NO_VALUE
        else:
            level = self.level(bits, quantum, guess)
            self.past = (level, self.past[0])
            byte = clamp(guess.predicted + level * quantum, 1, 255)
        self.alike = min(self.alike + 1, 3) if byte == guess.twin else 0
        return byte

    def level(self, bits, quantum, guess):
        """How many quanta a point with a value is from its prediction."""
        last, before = self.past
        activity = min(sig(abs(last) + abs(before)), 5)
        spread = 6 if guess.spread is None else min(sig(guess.spread // 2), 5)
        twin = clamp(level_between(guess.twin, guess.predicted, quantum), -8, 8) + 8 if guess.twin else 17
        sizes = [min(sig(abs(level)), 4) for level in self.past]
        rows = [
            spread * 6 + activity,
            twin * 4 + self.alike,
            guess.predicted // 8 * 12 + guess.level,
            (sizes[0] * 5 + sizes[1]) * 3 + (last > 0) - (last < 0) + 1,
        ]

        def decide(number):
            return self.levels.code(bits, number, [row * 14 + number for row in rows])

        if not decide(0):
            return 0
        below = int(guess.predicted == 255) if guess.predicted in (1, 255) else decide(1)
        size = 1
        while size <= 12 and decide(1 + size):
            size += 1
        if size > 12:
            size += self.large.code(bits)
        return -size if below else size
