"""Profile surface: which points change, and by how much."""

from .body import Reader
from .numbers import fold_sign, must, sig, unfold_sign
from .prediction import FrameChanges
from .range_coder import Decisions, Mixed, Number, Slots
from .values import varint_bytes


def changes_plain(state, section):
    """The changes of a frame."""
    reader = Reader(section.plain(), "changes")
    quantum = reader.number(1)
    bitmap = int.from_bytes(reader.take((state.layout.blocks + 7) // 8), "little")
    slots = []
    for block in [block for block in range(sig(bitmap)) if bitmap >> block & 1]:
        mask = reader.number(8)
        must(mask, "changes")
        slots += [64 * block + bit for bit in range(64) if mask >> bit & 1]
    must(len(slots) == section.records, "changes")
    levels = [unfold_sign(reader.varint()) for _ in slots]
    must(reader.at == len(reader.data), "changes")
    check_slots(state, slots)
    frame = FrameChanges(state, quantum)
    levels = dict(zip(slots, levels))
    for block in filter(lambda block: state.present[block], range(state.layout.blocks)):
        here = range(64 * block, 64 * block + 64)
        frame.follow(block, {slot: levels[slot] for slot in here if slot in levels})
    frame.finish()
    return frame


def check_slots(state, slots):
    """Points that change must exist, in blocks that were there before the frame."""
    for slot in slots:
        block = slot // 64
        must(block < state.layout.blocks and state.present[block], "changes")
        must(slot % 64 < state.layout.block_len(block), "changes")


def half(v):
    if v < 4:
        return v
    e = sig(v) - 1
    return 2 * e + (v >> e - 1 & 1)


def age_class(age):
    return 0 if age == 0 else 1 if age == 1 else 2 if age <= 3 else 3 if age <= 7 else 4 if age <= 20 else 5


def parent_context(mean, spread):
    """What the parents of a point did, as one of 45 numbers."""
    size = sum(abs(mean) >= least for least in (1, 3, 6, 11))
    apart = sum(spread >= least for least in (1, 5, 10, 20))
    return (4 - size if mean < 0 else 4 + size) * 5 + apart


class ChangeModel:
    def __init__(self):
        self.groups = Slots(12, 8192)
        self.blocks = Mixed([512, 130, 64], 8, 8192)
        self.points = Mixed([1296, 768, 2304, 3072, 810], 36, 13107)
        self.signs = Mixed([153, 289, 768, 51, 405], 1, 32768)
        self.sizes = Mixed([1728, 1296, 144, 6144], 12, 26214)
        self.large = Number()

    def parts(self):
        return [self.groups, self.blocks, self.points, self.signs, self.sizes, *self.large.parts()]

    def words(self):
        return [word for part in self.parts() for word in part.words()]

    def set_words(self, words):
        for part in self.parts():
            part.set_words(words)

    def section(self, state, section):
        bits = Decisions(section.block)
        frame = FrameChanges(state, bits.plain(8))
        changes = frame.levels
        blocks, before = state.layout.blocks, 0
        for first in range(0, blocks, 16):
            group = range(first, min(first + 16, blocks))
            if not any(state.present[block] for block in group):
                before = 0
                continue
            active = sum(
                1
                for block in group
                if any(state.is_recent(slot) for slot in range(64 * block, 64 * block + 64))
            )
            before = self.groups.code(bits, sig(active) * 2 + before)
            past = [0] * 8
            for block in filter(lambda block: state.present[block], group):
                if before:
                    past = self.block(bits, state, block, past, frame)
                    must(len(changes) <= section.records, "changes")
                else:
                    frame.follow(block)
        must(len(changes) == section.records, "changes")
        bits.finish()
        levels = sum(varint_bytes(fold_sign(level)) for level in changes.values())
        named = len({slot // 64 for slot in changes})
        must(1 + (blocks + 7) // 8 + 8 * named + levels == section.raw, "plain")
        frame.finish()
        return frame

    def block(self, bits, state, block, past, frame):
        def recent(which):
            return sum(1 for slot in range(64 * which, 64 * which + 64) if state.is_recent(slot))

        layout = state.layout
        own = recent(block)
        following = recent(block + 1) if block + 1 < layout.blocks else 0
        prior = sum(1 for slot in range(64 * block - 64, 64 * block) if slot in frame.levels)
        at = [
            (sig(own) * 8 + sig(prior)) * 8 + sig(following),
            own * 2 + (prior != 0),
            min(sig(frame.moved_parents(block)), 7) * 8 + sig(own),
        ]
        if not self.blocks.code(bits, sig(own), at):
            frame.follow(block)
            return [0] * 8
        instance = layout.owners[block]
        if block == layout.first_blocks[instance]:
            past = [0] * 8
        for slot in range(64 * block, 64 * block + layout.block_len(block)):
            told = frame.told(slot)
            value = frame.predicted(slot, told[0])
            level = self.point(bits, state, instance, slot, past, value, parent_context(*told))
            frame.set(slot, value, level or None)
            past = [level] + past[:7]
        return past

    def point(self, bits, state, instance, slot, past, value, parents):
        layout = state.layout
        start, end = layout.slots_of(instance)
        sides = [slot + d for d in (-4, -3, -2, -1, 1, 2, 3, 4)]
        last_block = layout.first_blocks[instance + 1]
        counted = [side for side in sides if start <= side < 64 * last_block]
        recent = sum(1 for side in counted if state.is_recent(side))
        darker = sum(1 for side in counted if state.is_recent(side) and state.last[side] < 0)
        now = sum(1 for level in past if level)
        few = (0, 1, 2, 3, 4, 4, 5, 5, 5)[now]
        near = sum(state.faded(side) for side in sides if start <= side < end) // 8
        own = state.faded(slot)
        age, period, last = state.age[slot], state.period[slot], state.last[slot]
        nearest = 2 if slot == start else int(past[0] != 0)
        if period == 255:
            rhythm = 15
        else:
            rhythm = 14 if age == 255 else min((age + 1) * 4 // (period + 1), 13)
        at = [
            (now * 9 + recent) * 16 + rhythm,
            value * 3 + nearest,
            (half(own) * 16 + half(near)) * 9 + now,
            instance % 256 * 12 + few * 2 + (age == 0),
            (parents * 6 + few) * 3 + nearest,
        ]
        if not self.points.code(bits, few * 6 + age_class(age), at):
            return 0
        if value in (0, 255):
            negative = int(value == 255)
        else:
            balance = 8 + now - 2 * sum(1 for level in past if level < 0)
            trend = 8 + recent - 2 * darker
            way, near_way = ((n > 0) - (n < 0) + 1 for n in (last, past[0]))
            at = [
                balance * 9 + way * 3 + near_way,
                balance * 17 + trend,
                value * 3 + way,
                trend * 3 + way,
                (parents * 3 + near_way) * 3 + way,
            ]
            negative = self.signs.code(bits, 0, at)
        usual = min(sig(2 * sum(abs(level) for level in past) // now), 11) if now else 0
        fresh = min(abs(last), 11) if age == 0 else 0
        size = 0
        while size < 12:
            at = [
                (usual * 12 + size) * 12 + sig(abs(last)),
                (usual * 12 + size) * 9 + sig(own),
                size * 12 + fresh,
                (value * 2 + negative) * 12 + size,
            ]
            if not self.sizes.code(bits, size, at):
                break
            size += 1
        else:
            size += self.large.code(bits)
        must(size < 255, "changes")
        return -1 - size if negative else 1 + size
