"""Frames: docs/spec/protocol.md, "Frames"."""

from .numbers import crc32c, must

HEADER = 20
KEYFRAME, UPDATE, INDEX = 7, 8, 64
MESSAGE_LIMIT, BODY_LIMIT = 65_536, 512 << 20


class Frame:
    """The frame at the start of some bytes. What is wrong with it is found as early as the bytes allow."""

    def __init__(self, data):
        if len(data) >= 2:
            must(data[:2] == b"\x50\xa0", "magic")
        must(len(data) >= HEADER, "unfinished")
        number = lambda at: int.from_bytes(data[at : at + 4], "little")
        self.type, flags = data[2], data[3]
        self.length, self.group, self.sequence = number(4), number(8), number(12)
        must(flags == 0, "flags")
        carries_more = self.type in (KEYFRAME, UPDATE, INDEX)
        must(self.length <= (BODY_LIMIT if carries_more else MESSAGE_LIMIT), "length")
        self.size = HEADER + self.length
        must(len(data) >= self.size, "unfinished")
        self.payload = data[HEADER : self.size]
        must(number(16) == crc32c(data[:16] + self.payload), "checksum")
