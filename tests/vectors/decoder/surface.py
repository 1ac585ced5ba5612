"""Profile surface: layout, state and history."""

from .body import CONTEXT, GEOMETRY, PATCH, RANGE, SURFACE, VALUES, Reader, check_follows
from .changes import ChangeModel, changes_plain
from .geometry import GeometryModel, geometry_plain
from .levels import level_ends
from .numbers import MASK32, MASK64, clamp, must, term
from .parents import Parents
from .patch import patch_section
from .values import ValueModel, values_plain

FADE = [256, 192, 144, 108, 81, 61, 46, 34, 26, 19, 14, 11, 8, 6, 5, 3, 3, 2, 1, 1]


def fade(age):
    return FADE[age] if age < len(FADE) else 0


class SurfaceLayout:
    def __init__(self, layout):
        self.sets, self.members = layout["sets"], layout["members"]
        self.first_blocks, self.owners = [0], []
        for instance, index in enumerate(self.members):
            self.owners += [instance] * ((self.sets[index]["points"] + 63) // 64)
            self.first_blocks.append(len(self.owners))
        self.blocks = len(self.owners)
        latest, self.twins = {}, []
        for instance, index in enumerate(self.members):
            self.twins.append(latest.get(index))
            latest[index] = instance

    def twin(self, instance):
        return self.twins[instance]

    def level_of(self, instance, number):
        """The level of a point of an instance."""
        return sum(1 for end in level_ends(self.sets[self.members[instance]]) if end <= number)

    def slots_of(self, instance):
        start = 64 * self.first_blocks[instance]
        return start, start + self.sets[self.members[instance]]["points"]

    def block_len(self, block):
        return min(64, self.slots_of(self.owners[block])[1] - 64 * block)


class SurfaceState:
    def __init__(self, layout, shared):
        self.layout, self.shared = layout, shared
        self.frame, self.parents = None, {}
        self.clear()

    def clear(self):
        self.geometry = {}
        self.present, self.values = [False] * self.layout.blocks, [0] * 64 * self.layout.blocks
        self.forget()

    def forget(self):
        """History and change model that are fresh."""
        slots = len(self.values)
        self.age, self.period = [255] * slots, [255] * slots
        self.last, self.lively = [0] * slots, [0] * slots
        self.model = ChangeModel()

    def parents_in_set(self, block):
        """The parents in the set of a block; None if its points did not come with a frame."""
        index = self.layout.members[self.layout.owners[block]]
        if index not in self.geometry:
            return None
        if index not in self.parents:
            self.parents[index] = Parents(self.layout.sets[index], self.geometry[index])
        return self.parents[index]

    def parents_of(self, slot):
        """(slot, weight) of the parents of a point."""
        parents = self.parents_in_set(slot // 64)
        if parents is None:
            return []
        start, _ = self.layout.slots_of(self.layout.owners[slot // 64])
        return [(start + number, weight) for number, weight in parents.of_points[slot - start]]

    def parent_blocks(self, block):
        """The other blocks with parents of the points of a block."""
        parents = self.parents_in_set(block)
        if parents is None:
            return []
        first = self.layout.first_blocks[self.layout.owners[block]]
        return [first + other for other in parents.blocks[block - first]]

    def is_recent(self, slot):
        return self.age[slot] == 0

    def faded(self, slot):
        return self.lively[slot] * fade(self.age[slot]) >> 8

    def apply(self, body):
        must(body.profile == SURFACE, "profile")
        check_follows(body, self.frame)
        is_patch = any(section.tag == PATCH for section in body.sections)
        if body.is_key:
            self.clear()
        elif is_patch:
            self.forget()
        before = dict(self.geometry), self.values[:], self.present[:]
        geometry_model, value_model = GeometryModel(), ValueModel()
        changes = {}
        for section in body.sections:
            if section.tag == GEOMETRY:
                by_range = section.coder == RANGE
                sets = (
                    geometry_model.section(self.layout, section)
                    if by_range
                    else geometry_plain(self.layout, section)
                )
                for index, points in sets:
                    must(index not in self.geometry, "geometry")
                    self.geometry[index] = points
            elif section.tag == VALUES:
                value_model.section(self, section) if section.coder == RANGE else values_plain(self, section)
            elif section.tag == CONTEXT:
                self.context(section)
            elif section.tag == PATCH:
                patch_section(self, section, body.frame)
            else:
                changes = self.changes(section, before)
        if not body.is_key and not is_patch:
            self.note(changes)
        must(self.hash() == body.hash, "hash")
        self.frame = body.frame

    def changes(self, section, before):
        """The levels by slot; changes are read and made against what was there before the frame."""
        now = self.geometry, self.values, self.present
        self.geometry, self.values, self.present = before
        frame = (self.model.section if section.coder == RANGE else changes_plain)(self, section)
        self.geometry, self.values, self.present = now
        for block in frame.moved_blocks:
            here = slice(64 * block, 64 * block + 64)
            self.values[here] = frame.values[here]
        return frame.levels

    def note(self, changes):
        before = self.age
        self.age = [min(age + 1, 255) for age in before]
        for slot, level in changes.items():
            b = 255 if before[slot] == 254 else before[slot]
            left = self.lively[slot] * fade(b) >> 8
            self.lively[slot] = (3 * left + min(32 * abs(level), 255) + 2) // 4
            self.period[slot], self.age[slot], self.last[slot] = b, 0, clamp(level, -127, 127)

    def context(self, section):
        plain = section.plain()
        slots = len(self.values)
        must(len(plain) == 4 * slots + 81068, "context")
        reader = Reader(plain, "context")
        self.age, self.period = list(reader.take(slots)), list(reader.take(slots))
        self.last = [byte - 256 if byte > 127 else byte for byte in reader.take(slots)]
        self.lively = list(reader.take(slots))
        must(-128 not in self.last, "context")
        fresh = ChangeModel().words()
        self.model.set_words(iter([reader.number(4) ^ word for word in fresh]))
        must(reader.at == len(plain), "context")

    def hash(self):
        total = 0
        for index in self.geometry:
            digest = int(self.layout.sets[index]["digest"], 16)
            total += term(4, index, [digest & MASK32, digest >> 32, 1])
        for block in filter(lambda block: self.present[block], range(self.layout.blocks)):
            for slot in range(64 * block, 64 * block + self.layout.block_len(block)):
                total += term(5, slot, [self.values[slot] + 1])
        return total & MASK64

    def report(self):
        runs = []
        for block in filter(lambda block: self.present[block], range(self.layout.blocks)):
            if runs and sum(runs[-1]) == block:
                runs[-1][1] += 1
            else:
                runs.append([block, 1])
        values = []
        for instance in range(len(self.layout.members)):
            start, end = self.layout.slots_of(instance)
            values.append(bytes(self.values[start:end]).hex())
        sets = list(range(len(self.layout.sets))) if self.shared else sorted(self.geometry)
        return {"sets": sets, "present": runs, "values": "".join(values)}
