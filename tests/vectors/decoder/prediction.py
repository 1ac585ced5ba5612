"""Profile surface: the bytes after a frame of changes."""

from .numbers import clamp, must
from .parents import mean_and_spread

NO_VALUE, REMOVAL = 0, -255


def moved(byte, level, quantum):
    """The byte that is `level` quanta from another one."""
    if level == REMOVAL:
        return NO_VALUE
    if byte == NO_VALUE:
        return clamp(1 + (level - 1) * quantum, 1, 255)
    return clamp(byte + level * quantum, 1, 255)


def told_by_parents(state, slot):
    """Mean and spread of the bytes of the parents of a point; None if none of them has a value."""
    return mean_and_spread(state.parents_of(slot), lambda parent: state.values[parent] or None)


class FrameChanges:
    """Makes the changes of a frame, point by point in the order of the slots."""

    def __init__(self, state, quantum):
        self.state, self.quantum = state, quantum
        self.before, self.values = state.values, state.values[:]
        self.levels, self.moved_blocks, self.fits = {}, set(), True

    def moved_parents(self, block):
        """The number of other blocks with parents of its points in which a byte has changed."""
        return len(self.moved_blocks.intersection(self.state.parent_blocks(block)))

    def told(self, slot):
        """Mean and spread of the changes of the parents of a point."""

        def change(parent):
            before, after = self.before[parent], self.values[parent]
            return None if NO_VALUE in (before, after) else after - before

        return mean_and_spread(self.state.parents_of(slot), change) or (0, 0)

    def predicted(self, slot, mean):
        """The byte of a point before its level is added."""
        before = self.before[slot]
        return NO_VALUE if before == NO_VALUE else clamp(before + mean, 1, 255)

    def set(self, slot, predicted, level):
        """Moves a point `level` quanta from its prediction; None: the frame does not name it."""
        byte = predicted
        if level is not None:
            self.levels[slot] = level
            byte = moved(predicted, level, self.quantum)
            upwards = predicted != NO_VALUE or level > 0
            self.fits &= 1 <= abs(level) <= 255 and upwards and byte != predicted
        if byte != self.before[slot]:
            self.values[slot] = byte
            self.moved_blocks.add(slot // 64)

    def follow(self, block, levels=()):
        """Makes the points of a block with the given levels; the others only follow their parents."""
        if not levels and not self.moved_parents(block):
            return
        for slot in range(64 * block, 64 * block + self.state.layout.block_len(block)):
            predicted = self.predicted(slot, self.told(slot)[0])
            self.set(slot, predicted, levels[slot] if slot in levels else None)

    def finish(self):
        """Refuses a frame with a change that has no effect or is out of range."""
        must(self.quantum and self.fits, "changes")
