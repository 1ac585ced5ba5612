"""The body: header, section table, blocks."""

import lz4.block
import zstandard

from .numbers import MASK32, Refused, crc32c, must

PAPER, SURFACE = 1, 2
POSES, BUCKETS, CELLS, GEOMETRY, VALUES, CHANGES, CONTEXT, PATCH = range(1, 9)
STORED, LZ4, ZSTD, RANGE = range(4)
MAX_BLOCK = 272 << 20


class Reader:
    """Bytes from front to back; an end in the middle of something is refused for `reason`."""

    def __init__(self, data, reason, bad_varint=None):
        self.data, self.at, self.reason = data, 0, reason
        self.bad_varint = bad_varint or reason

    def take(self, count):
        must(self.at + count <= len(self.data), self.reason)
        self.at += count
        return self.data[self.at - count : self.at]

    def number(self, size):
        return int.from_bytes(self.take(size), "little")

    def varint(self):
        value = 0
        for place in range(5):
            byte = self.number(1)
            value |= (byte & 127) << 7 * place
            if byte < 128:
                must(value <= MASK32 and (byte or not place), self.bad_varint)
                return value
        raise Refused(self.bad_varint)

    def rest(self):
        return self.take(len(self.data) - self.at)


class Section:
    def __init__(self, tag, coder, records, raw, stored):
        self.tag, self.coder, self.records, self.raw, self.stored = tag, coder, records, raw, stored
        self.block = b""

    def plain(self):
        """The plain layout, of a block that is not coded by the range coder."""
        try:
            if self.coder == STORED:
                plain = self.block
            elif self.coder == LZ4:
                plain = lz4.block.decompress(self.block, uncompressed_size=self.raw)
            else:
                must(self.block[:4] == b"\x28\xb5\x2f\xfd", "block")
                must(zstandard.frame_content_size(self.block) == self.raw, "block")
                frame = zstandard.ZstdDecompressor().decompressobj()
                plain = frame.decompress(self.block)
                must(frame.eof and not frame.unused_data, "block")
        except (zstandard.ZstdError, lz4.block.LZ4BlockError) as error:
            raise Refused("block") from error
        must(len(plain) == self.raw, "block")
        return plain


class Body:
    """Header, section table and blocks, each checked as far as that goes without a state."""

    def __init__(self, data):
        reader = Reader(data, "truncated", "varint")
        self.profile, self.packing, self.kind, count = (reader.number(1) for _ in range(4))
        must(self.profile in (PAPER, SURFACE), "profile")
        must(self.packing == 0 if self.profile == SURFACE else self.packing in (1, 2, 3), "packing")
        must(self.kind in (1, 2), "kind")
        self.is_key = self.kind == 1
        self.frame, self.time, self.hash = reader.number(4), reader.number(8), reader.number(8)
        checksum = reader.number(4)
        reader.varint()
        self.sections = []
        for _ in range(count):
            self.sections.append(self.section(reader))
        tags = [section.tag for section in self.sections]
        if not self.is_key and (CONTEXT in tags or PATCH in tags):
            must(tags in ([PATCH], [CONTEXT, PATCH]), "section")
        for section in self.sections:
            section.block = reader.take(section.stored)
        must(reader.at == len(data), "trailing")
        must(crc32c(data[:24] + bytes(4) + data[28:]) == checksum, "checksum")

    def section(self, reader):
        section = Section(
            reader.number(1), reader.number(1), reader.varint(), reader.varint(), reader.varint()
        )
        tag = section.tag
        must(POSES <= tag <= PATCH, "section")
        must((tag <= CELLS) == (self.profile == PAPER), "section")
        must(not (tag in (CHANGES, PATCH) and self.is_key), "section")
        if self.sections:
            last = self.sections[-1].tag
            must(last < tag or {last, tag} <= {GEOMETRY, VALUES}, "section")
        must(section.coder <= (RANGE if tag in (GEOMETRY, VALUES, CHANGES, PATCH) else ZSTD), "coder")
        must(section.records > 0, "records")
        must(section.raw <= MAX_BLOCK, "length")
        if self.profile == PAPER:
            must(section.raw == section.records * record_bytes(tag, self.packing), "length")
        return section


def record_bytes(tag, packing):
    return {POSES: 32, BUCKETS: 68, CELLS: 4 + 7 * point_bytes(packing)}[tag]


def point_bytes(packing):
    return {1: 4, 2: 3, 3: 2}[packing]


def check_follows(body, last):
    if not body.is_key:
        must(last is not None, "keyframe")
        must(body.frame > last, "order")
