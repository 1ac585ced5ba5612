"""Messages: docs/spec/protocol.md, "Messages". Each is a function from a reader to its fields in their order."""

import math
import struct

from .body import Reader
from .numbers import must

CLOSE = 11


class Fields(Reader):
    """The fields of a message, one after the other."""

    def __init__(self, payload):
        super().__init__(payload, "ended")

    def u8(self):
        return self.number(1)

    def u16(self):
        return self.number(2)

    def u32(self):
        return self.number(4)

    def u64(self):
        return self.number(8)

    def f32(self):
        (value,) = struct.unpack("<f", self.take(4))
        must(math.isfinite(value), "value")
        return value

    def vector(self, count):
        return [self.f32() for _ in range(count)]

    def positive(self):
        value = self.f32()
        must(value > 0, "value")
        return value

    def count(self, least, most):
        """The number of elements of a list or text."""
        count = self.u64()
        must(least <= count <= most, "bound")
        return count

    def text(self, most):
        text = self.take(self.count(0, most))
        try:
            return text.decode("utf-8")
        except UnicodeDecodeError:
            must(False, "utf-8")

    def list(self, least, most, element):
        return [element(self) for _ in range(self.count(least, most))]

    def choice(self, count):
        choice = self.u32()
        must(choice < count, "choice")
        return choice


def limits(fields):
    names = ("frame_bytes", "instances", "buckets", "cells", "points")
    return {name: fields.u32() for name in names}


def hello(fields):
    oldest, newest = fields.u16(), fields.u16()
    must(1 <= oldest <= newest, "value")
    told = {"oldest": oldest, "newest": newest, "profiles": fields.u32(), "coders": fields.u32()}
    return told | {"limits": limits(fields), "name": fields.text(64)}


def accept(fields):
    version = fields.u16()
    must(version >= 1, "value")
    return {"version": version, "profile": fields.u8(), "limits": limits(fields), "name": fields.text(64)}


def why(fields):
    """REJECT and CLOSE."""
    return {"code": fields.u16(), "text": fields.text(512)}


def scene(fields):
    choice = fields.choice(4)
    if choice == 0:
        return {"choice": 0} | scene_info(fields)
    entry = {1: instance, 2: point_set, 3: member}[choice]
    return {"choice": choice, "first": fields.u32(), "entries": fields.list(1, 512, entry)}


def scene_info(fields):
    told = {
        "name": fields.text(64),
        "source": fields.text(512),
        "digest": fields.take(32).hex(),
        "profile": fields.u8(),
        "point_bits": fields.u8(),
        "coder": fields.u8(),
        "geometry": fields.u8(),
        "fps": fields.positive(),
        "frames_hint": fields.u32(),
        "radius_m": fields.positive(),
        "rays": fields.u32(),
        "occlusion": fields.u8(),
        "threshold": fields.u8(),
        "seed": fields.u64(),
        "points_per_m2": fields.positive(),
        "min_points": fields.u32(),
        "cells": fields.u32(),
        "sets": fields.u32(),
        "instances": fields.u32(),
        "points": fields.u32(),
        "table_slots": fields.positive(),
        "view_margin": fields.f32(),
        "quality": fields.f32(),
    }
    must(told["point_bits"] in (16, 24, 32) and told["view_margin"] >= 1, "value")
    must(0 <= told["quality"] <= 1024, "value")
    return told


def instance(fields):
    told = {"origin": fields.vector(3), "edge": fields.positive()}
    told |= {"dims": [fields.u32() for _ in range(3)], "first_bucket": fields.u32(), "buckets": fields.u32()}
    told |= {"kernel_radius": fields.positive(), "points": fields.u32(), "needs": fields.u32()}
    must(all(told["dims"]) and told["buckets"].bit_count() == 1, "value")
    return told


def point_set(fields):
    told = {"origin": fields.vector(3), "step": fields.positive()}
    told |= {"extent": [fields.u32() for _ in range(3)], "normal_bits": fields.u8(), "points": fields.u32()}
    told |= {"charts": fields.u32(), "levels": fields.u8(), "level_ends": [fields.u32() for _ in range(11)]}
    told |= {"kernel_radius": fields.positive(), "digest": f"{fields.u64():016x}"}
    must(2 <= told["normal_bits"] <= 8 and min(told["points"], 1) <= told["charts"] <= 1 << 24, "value")
    must(1 <= told["levels"] <= 12, "value")
    ends, unused = told["level_ends"][: told["levels"] - 1], told["level_ends"][told["levels"] - 1 :]
    must(ends == sorted(ends) and max(ends, default=0) <= told["points"] and not any(unused), "value")
    return told


def member(fields):
    return {"set": fields.u32(), "needs": fields.u32()}


def view(fields):
    told = {name: fields.vector(3) for name in ("eye", "target", "up")}
    told |= {"fov_y_deg": fields.positive(), "aspect": fields.positive()}
    sight = [target - eye for target, eye in zip(told["target"], told["eye"])]
    up = told["up"]
    # 0 as well where the target is the eye.
    side = [sight[a] * up[b] - sight[b] * up[a] for a, b in ((1, 2), (2, 0), (0, 1))]
    must(any(side) and told["fov_y_deg"] < 180, "value")
    return told


def edit(fields):
    told = {"instance": fields.u32(), "choice": fields.choice(4)}
    if told["choice"] == 0:
        told |= {"translation": fields.vector(3), "rotation": fields.vector(4)}
        must(abs(sum(axis * axis for axis in told["rotation"]) - 1) <= 0.001, "value")
    return told


def request(fields):
    choice = fields.choice(3)
    if choice == 0:
        return {"choice": choice, "reason": fields.u8()}
    if choice == 1:
        return {"choice": choice}
    size = fields.u16()
    must(size >= 64, "value")
    return {"choice": choice, "bytes": size}


def report(fields):
    told = {"frame": fields.u32(), "rays": fields.u64()}
    for name in ("visible", "traced", "changed", "cells", "stored"):
        told[name] = fields.u32()
    for name in ("bucket_full", "cell_full", "no_cell", "outside_grid", "id_collisions"):
        told[name] = fields.u32()
    stage = lambda fields: {"stage": fields.u8(), "micros": fields.u32()}
    return told | {"stages": fields.list(0, 32, stage)}


def ack(fields):
    return {"frame": fields.u32(), "hash": f"{fields.u64():016x}"}


def auth(fields):
    return {"token": fields.take(fields.count(16, 256)).hex()}


def ping(fields):
    return {"sent": fields.u64()}


def pong(fields):
    return {name: fields.u64() for name in ("sent", "received", "replied")}


def stamp(fields):
    told = {"frame": fields.u32(), "captured": fields.u64(), "sent": fields.u64()}
    must(told["captured"] <= told["sent"], "value")
    return told


def budget(fields):
    told = {name: fields.u32() for name in ("frame", "budget", "used", "postponed", "oldest", "forced")}
    must(told["postponed"] > 0 or told["oldest"] == 0, "value")
    return told


def gap(fields):
    """Of files: docs/spec/recording.md."""
    told = {name: fields.u32() for name in ("first_lost", "last_lost", "frames")}
    return told | {"bytes": fields.u64(), "reason": fields.u8()}


MESSAGES = {
    1: hello,
    2: accept,
    3: why,
    4: scene,
    5: view,
    6: edit,
    9: request,
    10: report,
    CLOSE: why,
    12: ack,
    13: auth,
    14: ping,
    15: pong,
    16: stamp,
    17: budget,
    65: gap,
}


def read_message(kind, payload):
    """The fields of a message; None when frames of this type carry none, or are not known."""
    if kind not in MESSAGES:
        return None
    fields = Fields(payload)
    told = MESSAGES[kind](fields)
    must(not fields.rest(), "extra")
    return told
