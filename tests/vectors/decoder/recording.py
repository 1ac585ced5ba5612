"""Recordings: docs/spec/recording.md."""

from .body import Body
from .frame import HEADER, INDEX, KEYFRAME, UPDATE, Frame
from .messages import CLOSE, read_message
from .numbers import Refused, crc32c, must

MAGIC = b"\x89PSAO\r\n\x1a"
FOOTER_MAGIC = (0x1D0AA05E).to_bytes(4, "little")
SIXTEEN, HEAD, ENTRY = 16, 12, 32
# How often the file's length may be checked in vain.
PATIENCE = 16


def number(data, at, size):
    return int.from_bytes(data[at : at + size], "little")


def sealed(data, at, size):
    """Whether a checksum of what is before it is at the end of `size` bytes."""
    end = at + size
    return end <= len(data) and number(data, end - 4, 4) == crc32c(data[at : end - 4])


def is_footer(data, at):
    return data[at + 8 : at + 12] == FOOTER_MAGIC and sealed(data, at, SIXTEEN)


class Recording:
    """Records and damages of a file, in their order."""

    def __init__(self, data):
        self.data, self.patience = data, PATIENCE * len(data)
        self.records, self.damages = [], []
        if data[:8] == MAGIC and sealed(data, 0, SIXTEEN):
            must(number(data, 8, 2) == 1, "version")
            must(number(data, 10, 2) == 0, "flags")
            self.read(SIXTEEN)
        else:
            must(any(self.is_record(at) for at in range(len(data))), "recording")
            self.patience = PATIENCE * len(data)
            self.read(0)

    def record(self, at):
        """The frame of the record at an offset; refused for what is damaged."""
        data = self.data
        must(len(data) - at >= SIXTEEN, "ends")
        must(sealed(data, at, HEAD), "arrival")
        try:
            return Frame(data[at + HEAD :])
        except Refused as refused:
            if str(refused) == "checksum":
                self.patience -= number(data, at + HEAD + 4, 4)
            raise Refused("ends" if str(refused) == "unfinished" else "frame") from refused

    def is_record(self, at):
        # Most offsets are none, and a checksum takes its time.
        if self.data[at + HEAD : at + HEAD + 2] != b"\x50\xa0" or self.patience <= 0:
            return False
        try:
            self.record(at)
        except Refused:
            return False
        return True

    def read(self, at):
        while at < len(self.data):
            try:
                frame = self.record(at)
                self.records.append((at, number(self.data, at, 8), frame))
                at += HEAD + frame.size
            except Refused as refused:
                if is_footer(self.data, at):
                    at += SIXTEEN
                else:
                    at = self.damaged(at, str(refused))

    def damaged(self, start, kind):
        """Goes to where reading goes on."""
        data = self.data
        places = range(start + 1, len(data))
        end = next((at for at in places if self.is_record(at) or is_footer(data, at)), None)
        if end is None and self.patience <= 0:
            kind = "hopeless"
        elif start < SIXTEEN:
            kind = "file header"
        elif kind == "ends":
            kind = "cut off" if end is None else "length"
        end = len(data) if end is None else end
        self.damages.append({"offset": start, "bytes": end - start, "kind": kind})
        return end

    def entries(self):
        """The index, made anew."""
        entries = []
        for offset, _, frame in self.records:
            if frame.type not in (KEYFRAME, UPDATE):
                continue
            try:
                body = Body(frame.payload)
            except Refused:
                continue
            place = {"group": frame.group, "sequence": frame.sequence, "type": frame.type}
            entries.append({"offset": offset, "time": body.time, "frame": body.frame} | place)
        return entries

    def report(self):
        told, index, close = self.entries(), "none", None
        records = []
        for offset, arrival, frame in self.records:
            place = {"type": frame.type, "group": frame.group, "sequence": frame.sequence}
            records.append({"offset": offset, "arrival": arrival, "length": frame.length} | place)
            if frame.type == INDEX:
                index = "agrees" if read_index(frame.payload) == told else "differs"
            elif frame.type == CLOSE:
                try:
                    close = read_message(CLOSE, frame.payload)["code"]
                except Refused:
                    close = None
        parts = {"records": records, "damages": self.damages}
        return parts | {"entries": told, "index": index, "close": close}


def read_index(payload):
    """The entries of an INDEX frame; None when it is not one."""
    if len(payload) % ENTRY:
        return None
    entries = []
    for at in range(0, len(payload), ENTRY):
        kind = payload[at + 28]
        if kind not in (KEYFRAME, UPDATE) or any(payload[at + 29 : at + ENTRY]):
            return None
        entry = {"offset": number(payload, at, 8), "time": number(payload, at + 8, 8)}
        entry |= {"frame": number(payload, at + 16, 4), "group": number(payload, at + 20, 4)}
        entries.append(entry | {"sequence": number(payload, at + 24, 4), "type": kind})
    return entries
