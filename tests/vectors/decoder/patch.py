"""Profile surface: the newest AO of points, for clients that missed frames."""

from .body import RANGE, Reader
from .numbers import clamp, must, sig, toward_zero
from .prediction import told_by_parents
from .range_coder import Decisions, Mixed, Number, Slots
from .values import varint_bytes


def patch_section(state, section, frame):
    """Gives the named points their bytes."""
    if section.coder == RANGE:
        PatchModel().section(state, section, frame)
    else:
        patch_plain(state, section, frame)


def check_back(back, state, frame):
    must(back <= frame and state.frame >= frame - back, "order")


class Runs:
    """Runs of blocks that became present after the base frame."""

    def __init__(self, layout):
        self.layout, self.runs, self.end = layout, [], 0

    def add(self, first, count):
        must(count > 0 and first >= self.end and first + count <= self.layout.blocks, "patch")
        self.runs.append((first, count))
        self.end = first + count

    def blocks(self):
        return [block for first, count in self.runs for block in range(first, first + count)]

    def claim(self, state):
        for block in self.blocks():
            state.present[block] = True

    def check_whole(self, named):
        """All points of the blocks must be named."""
        for block in self.blocks():
            points = range(64 * block, 64 * block + self.layout.block_len(block))
            must(all(slot in named for slot in points), "patch")

    def plain_bytes(self):
        runs = sum(varint_bytes(first) + varint_bytes(count) for first, count in self.runs)
        return varint_bytes(len(self.runs)) + runs


def patch_plain(state, section, frame):
    layout = state.layout
    reader = Reader(section.plain(), "patch")
    back = reader.varint()
    runs = Runs(layout)
    for _ in range(reader.varint()):
        runs.add(reader.varint(), reader.varint())
    bitmap = reader.take((layout.blocks + 7) // 8)
    named = [block for block in range(8 * len(bitmap)) if bitmap[block // 8] >> block % 8 & 1]
    slots = []
    for block in named:
        mask = reader.number(8)
        must(mask, "patch")
        slots += [64 * block + place for place in range(64) if mask >> place & 1]
    must(len(slots) == section.records, "patch")
    new = reader.take(section.records)
    must(reader.at == len(reader.data), "patch")
    check_back(back, state, frame)
    runs.claim(state)
    runs.check_whole(set(slots))
    for slot, byte in zip(slots, new):
        block = slot // 64
        must(block < layout.blocks and state.present[block], "patch")
        must(slot % 64 < layout.block_len(block), "patch")
        state.values[slot] = byte


class PatchModel:
    def __init__(self):
        self.numbers = Number()
        self.groups, self.blocks = Slots(2, 32768), Slots(8, 32768)
        self.points = Mixed([256, 9], 1, 16384)
        self.classes = Mixed([72, 648, 256, 264], 8, 32768)
        self.ways = Mixed([32, 32, 66, 64], 8, 32768)
        self.seconds = Slots(9, 32768)
        self.last, self.before, self.ways_before = 255, (0, 0), 0

    def section(self, state, section, frame):
        bits = Decisions(section.block)
        back = self.numbers.code(bits)
        check_back(back, state, frame)
        runs = self.runs(bits, state.layout, section.records)
        runs.claim(state)
        named = self.which(bits, state)
        for slot in sorted(named):
            guess, spread = surroundings(state, named, slot)
            state.values[slot] = self.byte(bits, guess, spread)
        bits.finish()
        must(len(named) == section.records, "patch")
        runs.check_whole(named)
        blocks = len({slot // 64 for slot in named})
        raw = varint_bytes(back) + runs.plain_bytes() + (state.layout.blocks + 7) // 8 + 8 * blocks + len(named)
        must(raw == section.raw, "plain")

    def runs(self, bits, layout, records):
        runs, count = Runs(layout), self.numbers.code(bits)
        must(count <= records, "patch")
        for _ in range(count):
            first = runs.end + self.numbers.code(bits)
            runs.add(first, self.numbers.code(bits))
        return runs

    def which(self, bits, state):
        layout, named, before = state.layout, set(), 0
        for start in range(0, layout.blocks, 16):
            here = [block for block in range(start, min(start + 16, layout.blocks)) if state.present[block]]
            if not here:
                continue
            before = self.groups.code(bits, before)
            for block in here if before else []:
                prior = sum(1 for slot in range(64 * block - 64, 64 * block) if slot in named)
                if not self.blocks.code(bits, sig(prior)):
                    continue
                for slot in range(64 * block, 64 * block + layout.block_len(block)):
                    eight = [slot - 1 - n in named for n in range(8)]
                    pattern = sum(1 << n for n in range(8) if eight[n])
                    if self.points.code(bits, 0, [pattern, sum(eight)]):
                        named.add(slot)
        return named

    def byte(self, bits, guess, spread):
        lean = clamp(16 + toward_zero(self.last - guess, 8), 0, 32)
        c1, c2 = self.before
        number = 0
        while number < 8:
            at = [
                sig(spread) * 8 + number,
                (c1 * 9 + c2) * 8 + number,
                guess // 8 * 8 + number,
                lean * 8 + number,
            ]
            if not self.classes.code(bits, number, at):
                break
            number += 1
        self.before = (number, c1)
        self.last = guess
        if number:
            below = self.is_below(bits, guess, number, lean)
            difference = 1
            if number >= 2:
                difference = 2 | self.seconds.code(bits, number)
                difference = difference << number - 2 | bits.plain(number - 2)
            self.ways_before = (self.ways_before << 1 | below) & 63
            self.last = (guess - difference if below else guess + difference) & 255
        return self.last

    def is_below(self, bits, guess, number, lean):
        if guess in (0, 255):
            return int(guess == 255)
        past = self.ways_before
        at = [guess // 8, (number - 1) * 4 + (past & 3), lean * 2 + (past & 1), past]
        return self.ways.code(bits, number - 1, at)


def surroundings(state, named, slot):
    """Guess and spread."""
    layout, block = state.layout, slot // 64
    instance = layout.owners[block]
    start = 64 * block
    if block > layout.first_blocks[instance] and state.present[block - 1]:
        start -= 64
    end = 64 * block + layout.block_len(block)
    seen = []
    for distance, weight in ((1, 6), (2, 3), (3, 2)):
        if slot - distance >= start:
            seen.append((state.values[slot - distance], weight))
        if slot + distance < end and slot + distance not in named:
            seen.append((state.values[slot + distance], weight))
    told = told_by_parents(state, slot)
    if told:
        seen.append((told[0], 12))
    if not seen:
        return 255, 255
    total = sum(weight for _, weight in seen)
    near = [byte for byte, _ in seen]
    return (sum(byte * weight for byte, weight in seen) + total // 2) // total, max(near) - min(near)
