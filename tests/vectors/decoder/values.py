"""Profile surface: AO of blocks that come."""

from .body import Reader
from .numbers import MASK32, must, sig
from .range_coder import Decisions, Mixed, Number


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


def values_plain(state, section):
    reader = Reader(section.plain(), "values")
    arrivals = Arrivals(state, section.records)
    for _ in range(reader.varint()):
        arrivals.run(reader.varint(), reader.varint())
    arrivals.end()
    rest = reader.rest()
    must(len(rest) == section.records, "values")
    at = 0
    for block in arrivals.blocks:
        count = state.layout.block_len(block)
        state.values[64 * block : 64 * block + count] = rest[at : at + count]
        state.present[block] = True
        at += count


class ValueModel:
    def __init__(self):
        self.numbers = Number()
        self.bytes = Mixed([64 * 256, 64 * 256, 129 * 4 * 256, 16 * 256], 32, 32768)

    def section(self, state, section):
        bits = Decisions(section.block)
        arrivals = Arrivals(state, section.records)
        end, runs = 0, self.numbers.code(bits)
        raw = varint_bytes(runs) + section.records
        for _ in range(runs):
            first = (end + self.numbers.signed(bits)) & MASK32
            count = self.numbers.code(bits)
            arrivals.run(first, count)
            end = first + count
            raw += varint_bytes(first) + varint_bytes(count)
        arrivals.end()
        for block in arrivals.blocks:
            self.block(bits, state, block)
            state.present[block] = True
        bits.finish()
        must(raw == section.raw, "plain")

    def block(self, bits, state, block):
        layout, values = state.layout, state.values
        instance = layout.owners[block]
        start = layout.first_blocks[instance]
        past = [255] * 8
        if block > start and state.present[block - 1]:
            past = [values[64 * block - 1 - n] for n in range(8)]
        twin = layout.twin(instance)
        if twin is not None:
            twin = layout.first_blocks[twin] + block - start
            twin = twin if state.present[twin] else None
        alike = 0
        for at in range(layout.block_len(block)):
            other = None if twin is None else values[64 * twin + at]
            value = self.byte(bits, past, other, alike)
            values[64 * block + at] = value
            past = [value] + past[:7]
            alike = min(alike + 1, 3) if value == other else 0

    def byte(self, bits, past, twin, alike):
        mean = (2 * past[0] + past[1] + past[2]) // 16
        rough = sig(sum(abs(past[j] - past[j + 1]) for j in range(4)))
        t = 128 if twin is None else twin // 2
        opened = 2 * (past[0] == 255) + (past[1] == 255)
        node = 1
        for depth in range(8):
            at = [
                mean * 256 + node,
                past[0] // 4 * 256 + node,
                (t * 4 + alike) * 256 + node,
                rough * 256 + node,
            ]
            node = 2 * node + self.bytes.code(bits, 4 * depth + opened, at)
        return node & 255
