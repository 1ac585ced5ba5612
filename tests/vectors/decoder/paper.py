"""Profile paper: the state, what its records do, and how a cell is found."""

import math
import struct

from .body import BUCKETS, CELLS, PAPER, POSES, Reader, check_follows, point_bytes
from .numbers import MASK32, MASK64, must, term
from .octahedral import octahedral

IDENTITY = (0, 0, 0, 0, 0, 0, 0x3F800000)
# Bits of position, normal and accessibility; largest code of a normal's axis.
PACKINGS = {1: (5, 4, 8, 15), 2: (3, 4, 6, 15), 3: (2, 2, 5, 2)}


def hex_words(words):
    """Words without the zeros at their end."""
    used = max((at + 1 for at, word in enumerate(words) if word), default=0)
    return " ".join(f"{word:08x}" for word in words[:used])


class PaperState:
    def __init__(self, layout):
        self.layout = layout
        self.buckets_total = sum(instance["buckets"] for instance in layout["instances"])
        self.frame = None
        self.clear()

    def clear(self):
        self.poses = [IDENTITY] * len(self.layout["instances"])
        self.buckets = [(0,) * 16] * self.buckets_total
        self.cells = [(0,) * 7] * self.layout["cells"]

    def apply(self, body):
        must(body.profile == PAPER, "profile")
        must(body.packing == self.layout["packing"], "packing")
        check_follows(body, self.frame)
        if body.is_key:
            self.clear()
        for section in body.sections:
            self.read(section, body.packing)
        must(self.hash() == body.hash, "hash")
        self.frame = body.frame

    def read(self, section, packing):
        places = {POSES: self.poses, BUCKETS: self.buckets, CELLS: self.cells}[section.tag]
        must(section.records <= len(places), "records")
        width = point_bytes(packing) if section.tag == CELLS else 4
        count = len(IDENTITY) if section.tag == POSES else 16 if section.tag == BUCKETS else 7
        reader = Reader(section.plain(), "length")
        last = -1
        for _ in range(section.records):
            index = reader.number(4)
            must(last < index < len(places), "offset")
            words = tuple(reader.number(width) for _ in range(count))
            if section.tag == CELLS:
                words = tuple(old ^ new for old, new in zip(places[index], words))
            {POSES: self.check_pose, BUCKETS: self.check_bucket, CELLS: self.check_cell}[section.tag](words)
            places[index], last = words, index

    @staticmethod
    def check_pose(words):
        values = struct.unpack("<7f", struct.pack("<7I", *words))
        must(all(math.isfinite(value) for value in values), "pose")
        must(abs(sum(value * value for value in values[3:]) - 1) <= 0.001, "pose")

    def check_bucket(self, words):
        seconds = words[1::2]
        used = sum(1 for second in seconds if second >> 22 & 31)
        for entry, second in enumerate(seconds):
            if entry >= used:
                must(words[2 * entry] == 0 and second == 0, "bucket")
                continue
            must((second & 0x3FFFFF) < self.layout["cells"], "bucket")
            must(1 <= second >> 22 & 31 <= 7, "bucket")
            must(second >> 27 & 15 == (used if entry == 0 else 0) and second >> 31 == 0, "bucket")

    def check_cell(self, words):
        ended = False
        for word in words:
            if self.is_point(word):
                must(not ended, "cell")
            else:
                must(word == 0, "cell")
                ended = True

    def is_point(self, word):
        return word >> (8 * point_bytes(self.layout["packing"]) - 1) & 1

    def hash(self):
        total = 0
        for kind, records in ((1, self.poses), (2, self.buckets), (3, self.cells)):
            for index, words in enumerate(records):
                last = words[6] ^ 0x3F800000
                total += term(kind, index, words[:6] + (last,) if kind == 1 else words)
        return total & MASK64

    def find(self, instance, cell):
        """The words of a cell's points (Eq. 1)."""
        (x, y, z), (dx, dy, _) = cell, instance["dims"]
        raw_id = (x + y * dx * 17 + z * dx * dy * 31) & MASK32
        bucket = self.buckets[instance["first_bucket"] + raw_id % instance["buckets"]]
        for entry in range(8):
            if bucket[2 * entry] == raw_id and bucket[2 * entry + 1] >> 22 & 31:
                return self.cells[bucket[2 * entry + 1] & 0x3FFFFF]
        return ()

    def point(self, instance, cell, word):
        position_bits, normal_bits, ao_bits, top = PACKINGS[self.layout["packing"]]
        fields = []
        for bits in (ao_bits, normal_bits, normal_bits, position_bits, position_bits, position_bits):
            fields.append(word & (1 << bits) - 1)
            word >>= bits
        ao, u, v = fields[:3]
        edge, largest = instance["edge"], (1 << position_bits) - 1
        position = [
            instance["origin"][axis] + (cell[axis] + fields[3 + axis] / largest) * edge for axis in range(3)
        ]
        a = (1 << ao_bits) - 1
        return {"position": position, "normal": octahedral(u, v, top), "ao": (ao * 510 + a) // (2 * a)}

    def report(self):
        def listed(name, records, empty):
            some = [(index, words) for index, words in enumerate(records) if words != empty]
            return [{name: index, "words": hex_words(words)} for index, words in some]

        points = []
        for number, instance in enumerate(self.layout["instances"]):
            dims = instance["dims"]
            for z in range(dims[2]):
                for y in range(dims[1]):
                    for x in range(dims[0]):
                        for word in filter(self.is_point, self.find(instance, (x, y, z))):
                            place = {"instance": number, "cell": [x, y, z]}
                            points.append(place | self.point(instance, (x, y, z), word))
        return {
            "poses": listed("instance", self.poses, IDENTITY),
            "buckets": listed("bucket", self.buckets, (0,) * 16),
            "cells": listed("cell", self.cells, (0,) * 7),
            "points": points,
        }
